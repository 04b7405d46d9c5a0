//! `surfelsplat inspect`: what is in a scene, and can its cameras be right?

use super::args::InspectArgs;
use super::print_line;
use anyhow::{Result, bail};
use serde_json::json;
use std::process::ExitCode;
use surfel_core::Camera;
use surfel_io::scene::{Frame, Scene};
use surfel_io::write::write_atomically;
use surfel_pair::plausible::oddities;
use surfel_pair::{Features, Status, check_pair, epipolar_picture, match_features};
use surfelsplat::reconstruct::choice::{choose, preview};

/// Matches drawn in the picture.
const NUM_DRAWN: usize = 12;

pub fn run(args: &InspectArgs, json: bool, quiet: bool) -> Result<ExitCode> {
    let mut scene = match args.format {
        Some(kind) => Scene::open_as(&args.scene, kind)?,
        None => Scene::open(&args.scene)?,
    };
    if let Some(axes) = args.axes {
        axes.turn(&mut scene);
    }
    let pair = match args.views.len() {
        0 => choose(&scene, 2)?.0,
        2 => scene.select(&args.views)?,
        n => bail!("--views names {n} photographs; inspect checks two against each other"),
    };
    let (a, b) = (&scene.frames[pair[0]], &scene.frames[pair[1]]);
    let (view_a, view_b) = (preview(a)?, preview(b)?);
    let matches = match_features(&Features::of(&view_a), &Features::of(&view_b));
    let verdict = check_pair(&view_a.camera, &view_b.camera, &matches);
    let picture = epipolar_picture(&view_a, &view_b, &matches, NUM_DRAWN);
    write_atomically(&args.output, |out| surfel_io::write::picture_png::write_rgb_png(out, &picture))?;
    let notes: Vec<String> = oddities(&view_a.camera, &view_b.camera).into_iter().map(|o| o.sentence()).collect();
    if json {
        let document = json!({
            "scene": scene.root, "format": scene.format.to_string(), "num_frames": scene.frames.len(),
            "num_points": scene.points.len(), "warnings": scene.warnings, "views": [a.name, b.name],
            "status": format!("{:?}", verdict.status), "sentence": verdict.sentence, "oddities": notes,
            "num_matches": verdict.num_matches, "num_inliers": verdict.num_inliers,
            "median_epipolar_px": verdict.median_epipolar_px, "picture": args.output,
        });
        print_line(&serde_json::to_string_pretty(&document)?);
    } else if !quiet {
        print_line(&format!("{}: {}", scene.root.display(), scene.format));
        print_line(&format!("{} sparse points; {}", scene.points.len(), sizes(&scene)));
        scene.warnings.iter().chain(&notes).for_each(|warning| print_line(&format!("warning: {warning}")));
        print_line(&format!("{} and {}: {}", a.name, b.name, verdict.sentence));
        print_line(&format!("{}: the matches and their epipolar lines", args.output.display()));
    }
    let code = if verdict.status == Status::Wrong { 1 } else { 0 };
    Ok(ExitCode::from(code))
}

fn sizes(scene: &Scene) -> String {
    let cameras: Vec<Camera> = scene.frames.iter().map(Frame::pinhole).collect();
    let (w, h, f) = (cameras[0].width, cameras[0].height, cameras[0].intrinsics.mean_focal());
    let field = 2.0 * (w as f64 / (2.0 * f)).atan().to_degrees();
    let same = cameras.iter().all(|c| (c.width, c.height) == (w, h));
    let which = if same { "photographs are" } else { "the first photograph is" };
    format!("{which} {w}x{h} with a horizontal field of view of {field:.0} degrees")
}
