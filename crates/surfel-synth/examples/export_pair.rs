//! Writes one synthetic stereo pair with its ground truth to disk, to compare matchers on.
//!
//! `export_pair ASSETS_DIR train|val SEED WIDTH HEIGHT OUT`: objects about 650 mm away, cameras 125 mm
//! apart, focal length 1.8 widths. OUT receives `images/`, `cameras.json` (continuous intrinsics, first pixel
//! centre at 0.5; millimetres), `depth/*.pfm` (z-depth), `normal/*.pfm` (camera frame), `mask/` (objects only).

use std::error::Error;
use std::io::Write;
use std::path::{Path, PathBuf};
use surfel_core::Camera;
use surfel_synth::{AssetLibrary, RenderedView, SceneSampler, Split, SynthConfig};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [assets, split, seed, width, height, out] = arguments.as_slice() else {
        return Err("usage: export_pair ASSETS_DIR train|val SEED WIDTH HEIGHT OUT".into());
    };
    let split = match split.as_str() {
        "train" => Split::Train,
        "val" => Split::Val,
        other => return Err(format!("the split is train or val, not {other}").into()),
    };
    let library = AssetLibrary::open(assets, split)?;
    let config = SynthConfig::clean_pair(width.parse()?, height.parse()?);
    let scene = SceneSampler::new(&library, config).scene(seed.parse()?)?;
    let out = PathBuf::from(out);
    for folder in ["images", "depth", "normal", "mask"] {
        std::fs::create_dir_all(out.join(folder))?;
    }
    for i in 0..scene.num_views() {
        write_view(&scene.render(i), i, &out)?;
    }
    let cameras: Vec<_> = scene.cameras.iter().enumerate().map(|(i, camera)| camera_json(camera, i)).collect();
    std::fs::write(out.join("cameras.json"), serde_json::to_string_pretty(&cameras)?)?;
    Ok(())
}

fn write_view(rendered: &RenderedView, index: usize, out: &Path) -> Result<(), Box<dyn Error>> {
    let (width, height) = (rendered.depth.width(), rendered.depth.height());
    let colours = rendered.view.image.as_slice().iter().flatten().map(|v| (255.0 * v).round() as u8).collect();
    let picture = image::RgbImage::from_vec(width as u32, height as u32, colours).ok_or("the picture is too large")?;
    picture.save(out.join(format!("images/{index}.png")))?;
    let mask = rendered.object_mask().map(|&on| if on { 255u8 } else { 0 }).into_vec();
    let mask = image::GrayImage::from_vec(width as u32, height as u32, mask).ok_or("the mask is too large")?;
    mask.save(out.join(format!("mask/{index}.png")))?;
    let depth_rows = (0..height).rev().flat_map(|y| rendered.depth.row(y).to_vec());
    write_pfm(&out.join(format!("depth/{index}.pfm")), "Pf", width, height, depth_rows)?;
    let normal_rows = (0..height).rev().flat_map(|y| rendered.normal.row(y).concat());
    write_pfm(&out.join(format!("normal/{index}.pfm")), "PF", width, height, normal_rows)
}

/// A portable float map: little-endian, rows from the bottom up.
fn write_pfm(
    path: &Path,
    kind: &str,
    width: usize,
    height: usize,
    values: impl Iterator<Item = f32>,
) -> Result<(), Box<dyn Error>> {
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    write!(file, "{kind}\n{width} {height}\n-1.0\n")?;
    for value in values {
        file.write_all(&value.to_le_bytes())?;
    }
    file.flush()?;
    Ok(())
}

fn camera_json(camera: &Camera, index: usize) -> serde_json::Value {
    let k = camera.intrinsics;
    serde_json::json!({
        "image": format!("images/{index}.png"),
        "width": camera.width,
        "height": camera.height,
        "K": [k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0],
        "camera_from_world": camera.camera_from_world.to_mat4().transpose().to_cols_array(),
    })
}
