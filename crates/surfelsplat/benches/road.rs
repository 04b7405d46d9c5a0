//! Where the time of the road goes: the shipped example at 320x256, the share of each stage and peak memory.
//!
//! `cargo bench -p surfelsplat --bench road`

use std::path::Path;
use surfelsplat::reconstruct::{Options, Report, Silent, reconstruct};

const RUNS: usize = 5;

fn main() {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/redwood");
    let out = tempfile::tempdir().expect("a temporary folder");
    let options = Options { size: Some((320, 256)), ..Options::default() };
    let mut runs: Vec<Report> = (0..RUNS)
        .map(|_| reconstruct(&scene, out.path(), &options, &Silent).expect("the shipped example reconstructs"))
        .collect();
    runs.sort_by(|a, b| a.total_ms.total_cmp(&b.total_ms));
    let median = &runs[RUNS / 2];
    println!("{} threads, two views at 320x256, median of {RUNS} runs: {:.0} ms", median.threads, median.total_ms);
    for timing in &median.timings {
        let share = 100.0 * timing.ms / median.total_ms;
        println!("{:>10} {:>7.0} ms {share:>5.1} %", format!("{:?}", timing.stage).to_lowercase(), timing.ms);
    }
    match median.peak_memory_mib {
        Some(mib) => println!("peak memory of the process {mib:.0} MiB"),
        None => println!("peak memory is not told by this system"),
    }
}
