//! Time of the small network on a pair against its PyTorch twin (`bench/peers/torch_small.py`), and of the plane
//! sweep against the same sweep made of burn's own grid sampling, in one run.
//!
//! `cargo bench -p surfel-net --bench network`; SURFELSPLAT_PYTHON names a Python with torch.

use burn::tensor::ops::{GridSampleOptions, InterpolateMode};
use burn::tensor::{Device, Distribution, Tensor, TensorData};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::Instant;
use surfel_net::cost_volume::{sweep, uniform_candidates, warps};
use surfel_net::example_scene::ExampleScene;
use surfel_net::ops::plane_sweep;
use surfel_net::ops::plane_sweep::Base;
use surfel_net::{NetConfig, Preset, SceneInput, SurfelNet};

const WIDTH: usize = 320;
const HEIGHT: usize = 256;

/// The best of several runs: what the code costs when the machine does nothing else.
fn best_ms(runs: usize, mut work: impl FnMut()) -> f64 {
    work();
    (0..runs)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e3
        })
        .fold(f64::INFINITY, f64::min)
}

fn main() {
    // As the program does.
    surfel_net::keep_freed_memory();
    let device = Device::flex();
    let example = ExampleScene::new(WIDTH, HEIGHT);
    let scene = example.input(true);
    let net = SurfelNet::new(NetConfig::preset(Preset::Small), &device).expect("the shipped weights load");
    println!("small network: {:?}", net.parts());
    let whole = best_ms(5, || {
        let prediction = net.forward(&scene, &device).expect("the scene is usable");
        std::hint::black_box(prediction.surfels.to_surfels());
    });
    println!("small network, two views of {WIDTH} x {HEIGHT}, without gradients: {whole:.0} ms");
    print_peak_memory();
    let training = training_ms(&scene);
    println!("the same, forward and backward: {training:.0} ms");
    print_peak_memory();
    print_peer(whole, training);
    print_narrow(&example.input(false));

    let (width, height, channels, candidates) = (WIDTH / 4, HEIGHT / 4, 64, 64);
    let features = Tensor::<4>::random([2, channels, height, width], Distribution::Default, &device);
    let warps = warps(scene.cameras, &[vec![1], vec![0]], 4);
    let disparities: Vec<Vec<f32>> = scene.ranges.iter().map(|range| uniform_candidates(range, candidates)).collect();
    let geometry = Arc::new(sweep(warps.clone(), (width, height), disparities.clone(), Base::Zero));
    let ours = best_ms(9, || {
        std::hint::black_box(plane_sweep(features.clone(), geometry.clone()).into_data());
    });
    let burn = best_ms(2, || {
        for view in 0..2 {
            let warp = &warps[view][0];
            let (reference, other) = (features.clone().narrow(0, view, 1), features.clone().narrow(0, 1 - view, 1));
            for &disparity in &disparities[view] {
                let mut grid = Vec::with_capacity(2 * width * height);
                for i in 0..width * height {
                    let p = [(i % width) as f32, (i / width) as f32, 1.0];
                    let q: [f32; 3] = std::array::from_fn(|r| {
                        warp.rotation[r].iter().zip(p).map(|(a, b)| a * b).sum::<f32>()
                            + disparity * warp.translation[r]
                    });
                    grid.push(2.0 * (q[0] / q[2]) / (width - 1) as f32 - 1.0);
                    grid.push(2.0 * (q[1] / q[2]) / (height - 1) as f32 - 1.0);
                }
                let grid = Tensor::from_data(TensorData::new(grid, [1, height, width, 2]), &device);
                let options = GridSampleOptions::new(InterpolateMode::Bilinear).with_align_corners(true);
                let sampled = other.clone().grid_sample_2d(grid, options);
                std::hint::black_box((reference.clone() * sampled).sum_dim(1).into_data());
            }
        }
    });
    println!("plane sweep, {candidates} candidates of {channels} channels: {ours:.1} ms");
    println!("the same from burn's grid sampling: {burn:.1} ms, {:.1} times ours", burn / ours);
}

/// The network that finds depth itself: what its cost volume does here, matching does before the small one.
fn print_narrow(scene: &SceneInput) {
    let device = Device::flex();
    let net = SurfelNet::new(NetConfig::preset(Preset::Narrow), &device).expect("the shipped features load");
    let ms = best_ms(3, || {
        let prediction = net.forward(scene, &device).expect("the scene is usable");
        std::hint::black_box(prediction.surfels.to_surfels());
    });
    println!("narrow network, {:?}: {ms:.0} ms", net.parts());
}

fn training_ms(scene: &SceneInput) -> f64 {
    let device = Device::flex().autodiff();
    let net = SurfelNet::new(NetConfig::preset(Preset::Small), &device).expect("the shipped weights load");
    best_ms(3, || {
        let prediction = net.forward(scene, &device).expect("the scene is usable");
        let surfels = prediction.surfels;
        let loss = prediction.maps.depth.sum()
            + surfels.centres.powi_scalar(2).sum()
            + surfels.scales.powi_scalar(2).sum()
            + surfels.rotations.powi_scalar(2).sum()
            + surfels.opacities.powi_scalar(2).sum()
            + surfels.sh.powi_scalar(2).sum();
        std::hint::black_box(loss.backward());
    })
}

/// Of the process so far, where the system says it.
fn print_peak_memory() {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    if let Some(kib) = line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok()) {
        println!("peak memory: {:.0} MiB", kib / 1024.0);
    }
}

/// Runs the PyTorch peer on as many threads as this bench and prints how its times compare.
fn print_peer(forward: f64, training: f64) {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bench/peers/torch_small.py");
    let python = std::env::var("SURFELSPLAT_PYTHON").unwrap_or_else(|_| "python3".into());
    let threads = rayon::current_num_threads().to_string();
    let output = Command::new(&python).arg(script).args(["--backward", "--threads", &threads]).output();
    let text = match output {
        Ok(output) if output.status.success() => String::from_utf8_lossy(&output.stdout).into_owned(),
        _ => return eprintln!("SKIPPED: `{python}` cannot run the PyTorch peer; set SURFELSPLAT_PYTHON"),
    };
    print!("{text}");
    let ms_of = |label: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(label));
        line.and_then(|rest| rest.trim_end_matches(" ms").parse::<f64>().ok()).expect("the peer prints its times")
    };
    println!("ours over PyTorch, forward: {:.2}", forward / ms_of("forward: "));
    println!("ours over PyTorch, forward and backward: {:.2}", training / ms_of("forward and backward: "));
}
