//! `surfelsplat reconstruct`.

use super::args::{DepthMethod, ReconstructArgs};
use super::console::Console;
use super::print_line;
use anyhow::Result;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use surfel_net::{Device, SurfelNet};
use surfelsplat::reconstruct::{DepthSource, Options, Report, reconstruct};

pub fn run(args: &ReconstructArgs, json: bool, quiet: bool) -> Result<ExitCode> {
    let depth = match args.depth {
        DepthMethod::Matching => DepthSource::Matching,
        DepthMethod::Network => {
            let device = args.device.open()?;
            DepthSource::Network(Arc::new(network(args.weights.as_deref(), args.dino.as_deref(), &device)?))
        }
    };
    let options = Options {
        views: args.views.clone(),
        num_views: Some(args.num_views),
        size: args.size,
        format: args.format,
        axes: args.axes,
        near: args.near,
        far: args.far,
        voxel: args.voxel,
        keep_components: args.keep_components,
        trust_cameras: args.trust_cameras,
        depth,
        ..Options::default()
    };
    let console = Console::new(quiet);
    let result = reconstruct(&args.scene, &args.output, &options, &console);
    console.finish();
    let report = result?;
    if json {
        print_line(&serde_json::to_string_pretty(&report)?);
    } else if !quiet {
        print_line(&summary(&report, &args.output.display().to_string()));
    }
    Ok(ExitCode::SUCCESS)
}

/// The network of a weights file, or the one that ships.
fn network(weights: Option<&Path>, dino: Option<&Path>, device: &Device) -> Result<SurfelNet> {
    let net = match weights {
        Some(path) => SurfelNet::from_file(path, device)?,
        None => SurfelNet::shipped(device)?,
    };
    Ok(match dino {
        Some(file) => net.with_dino(file, device)?,
        None => net,
    })
}

fn summary(report: &Report, out: &str) -> String {
    let stages: Vec<String> = report
        .timings
        .iter()
        .map(|t| format!("{} {:.2}", format!("{:?}", t.stage).to_lowercase(), t.ms / 1e3))
        .collect();
    format!(
        "{out}: mesh of {} triangles, {} surfels, {} files; look at {out}/preview.png first\n{:.2} s ({})",
        report.mesh.triangles,
        report.surfels.count,
        report.files.len() + 1,
        report.total_ms / 1e3,
        stages.join(", ")
    )
}
