//! Rendering times on pixel-aligned surfels, beside what the machine can do at best, measured in the same run.
//!
//! `compute` is the share of the vector arithmetic rate that the useful operations (those on pixels a surfel is
//! blended into) reach; `memory` the share of the copy bandwidth that reading every surfel and writing every map
//! once would take. Processor time is printed beside wall time because benches often share their machine. An
//! argument picks the scenes whose name contains it.

mod bound;
mod scene;

use std::hint::black_box;
use surfel_core::{Camera, Grid, Surfels};
use surfel_raster::{MapGrads, Maps, RenderConfig, SurfelSlices, backward, forward};

/// Arithmetic operations per pixel and blended surfel, counted in the source of the pixel loops.
const FORWARD_OPS: f64 = 80.0;
const BACKWARD_OPS: f64 = 190.0;

fn main() {
    let bound = bound::Bound::measure();
    println!(
        "machine: {:.0} Gop/s f32, {:.1} GB/s copy, {} threads",
        bound.ops / 1e9,
        bound.bytes / 1e9,
        bound.threads
    );
    let wanted = std::env::args().skip(1).find(|arg| !arg.starts_with('-')).unwrap_or_default();
    // The last two: the time per surfel must stay what it was at one million surfels.
    let scenes = [(320, 256, 1.0), (320, 256, 2.0), (320, 256, 3.0), (1024, 512, 2.0), (724, 724, 2.0)];
    for (width, height, footprint) in scenes {
        let (surfels, mut camera) = scene::two_views(width, height, footprint);
        if width == 724 {
            camera = camera.resized(1024, 1024);
        }
        let name = format!("{}x{}, footprint {footprint} px", camera.width, camera.height);
        if name.contains(&wanted) {
            println!("{name}, {} surfels", surfels.len());
            report(&bound, &surfels, &camera);
        }
    }
}

fn report(bound: &bound::Bound, surfels: &Surfels, camera: &Camera) {
    let slices = SurfelSlices::from(surfels);
    let config = RenderConfig::for_depth_range(2.0, 6.0);
    let (maps, _) = forward(&slices, camera, &config).expect("a sound scene");
    let grads = grads_like(&maps);
    let blended: f64 = maps.num_contributors.as_slice().iter().map(|&n| f64::from(n)).sum();
    let pixels = maps.alpha.len() as f64;
    let rounds = if surfels.len() > 500_000 { 5 } else { 15 };
    let ahead = bound::time(rounds, || {
        black_box(forward(&slices, camera, &config).expect("a sound scene"));
    });
    let both = bound::time(rounds, || {
        let (_, tape) = forward(&slices, camera, &config).expect("a sound scene");
        black_box(backward(&slices, &tape, &grads).expect("a sound scene"));
    });
    println!("  {:.0} surfels blended per pixel", blended / pixels);
    let surfel_bytes = (10 + 3 * surfels.num_coefficients()) as f64 * 4.0 * surfels.len() as f64;
    let map_bytes = 12.0 * 4.0 * pixels;
    for (name, time, ops, bytes) in [
        ("forward", ahead, FORWARD_OPS, surfel_bytes + map_bytes),
        ("forward+backward", both, FORWARD_OPS + BACKWARD_OPS, 3.0 * surfel_bytes + 2.0 * map_bytes),
    ] {
        println!(
            "  {name:<17} {:7.1} ms ({:7.1} ms of processor), {:5.2} M surfels/s, compute {:4.1} %, memory {:4.1} %",
            time.wall * 1e3,
            time.processor * 1e3,
            surfels.len() as f64 / time.wall / 1e6,
            100.0 * blended * ops / bound.ops / time.wall,
            100.0 * bytes / bound.bytes / time.wall,
        );
    }
}

fn grads_like(maps: &Maps) -> MapGrads {
    let (width, height) = (maps.alpha.width(), maps.alpha.height());
    let wave = |x: usize, y: usize| ((x * 13 + y * 7) % 17) as f32 / 17.0 - 0.5;
    let vector = |x: usize, y: usize| [wave(x, y), wave(y, x), wave(x + y, x)];
    MapGrads {
        colour: Some(Grid::from_fn(width, height, vector)),
        alpha: Some(Grid::from_fn(width, height, wave)),
        depth_sum: Some(Grid::from_fn(width, height, wave)),
        depth_expected: Some(Grid::from_fn(width, height, wave)),
        depth_median: Some(Grid::from_fn(width, height, wave)),
        normal: Some(Grid::from_fn(width, height, vector)),
        distortion: Some(Grid::from_fn(width, height, wave)),
    }
}
