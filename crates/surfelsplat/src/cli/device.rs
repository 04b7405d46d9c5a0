//! `surfelsplat device`: does the network compute right on a device, and how fast.
//!
//! Also `--device`, which `train` and `reconstruct` share. Invariant: a device is tried before any work begins.

use super::args::parse_size;
use super::print_line;
use anyhow::{Result, bail};
use clap::Args;
use std::process::ExitCode;
use surfel_net::Device;
use surfel_net::device::{self, Check};

/// Where the network computes.
#[derive(Debug, Args)]
pub struct DeviceArg {
    /// Where the network computes: cpu, cuda (cuda:1 for the second card), vulkan or wgpu, as far as the build knows
    /// them.
    #[arg(long, value_name = "DEVICE", default_value = "cpu")]
    device: String,
}

impl DeviceArg {
    /// The device, tried.
    pub fn open(&self) -> Result<Device> {
        Ok(device::named(&self.device)?)
    }
}

#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  surfelsplat device --device cuda

Exit code 0: every operator answers as on the CPU; 1: one does not.")]
pub struct DeviceArgs {
    #[command(flatten)]
    device: DeviceArg,

    /// Size of the two photographs that operators are sized for; multiples of 16.
    #[arg(long, value_name = "WxH", default_value = "320x256", value_parser = parse_size)]
    size: (usize, usize),

    /// Runs of each operator, of which the fastest counts.
    #[arg(long, value_name = "N", default_value_t = 5)]
    runs: usize,
}

pub fn run(args: &DeviceArgs, json: bool, quiet: bool) -> Result<ExitCode> {
    let (width, height) = args.size;
    if width == 0 || height == 0 || width % 16 != 0 || height % 16 != 0 {
        bail!("--size {width}x{height}: both must be multiples of 16");
    }
    let device = args.device.open()?;
    let name = &args.device.device;
    let say = |check: &Check| {
        if !quiet && !json {
            print_line(&sentence(check, name));
        }
    };
    let checks = device::check(&device, args.size, args.runs, say);
    if json {
        let one = |check: &Check| {
            serde_json::json!({
                "operator": check.name, "holds": check.holds(), "relative_difference": check.difference,
                "tolerance": check.tolerance, "device_ms": check.device_ms, "cpu_ms": check.cpu_ms,
            })
        };
        let document = serde_json::json!({ "device": name, "checks": checks.iter().map(one).collect::<Vec<_>>() });
        print_line(&serde_json::to_string_pretty(&document)?);
    }
    Ok(if checks.iter().all(Check::holds) { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn sentence(check: &Check, device: &str) -> String {
    let verdict = if check.holds() { "right" } else { "WRONG" };
    format!(
        "{:20} {verdict}, differs by {:.1e} (at most {:.0e}); {:9.2} ms on {device}, {:9.2} ms on the CPU: {:.1} times \
         as fast",
        check.name,
        check.difference,
        check.tolerance,
        check.device_ms,
        check.cpu_ms,
        check.cpu_ms / check.device_ms
    )
}
