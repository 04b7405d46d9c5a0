//! Buildings under an open sky, seen by someone who walks past: what photographs of architecture show.
//!
//! Millimetres, ground at z = 0, the first camera over the origin, the main building in front of it along +Y.
//! Invariant: no camera stands in a building or at arm's length of one, and what rays miss is sky.

use super::arrange::{Resting, choose_paint};
use super::backdrop::Backdrop;
use super::building;
use super::error::AssetError;
use super::foliage::Plant;
use super::instance::Instance;
use super::library::AssetLibrary;
use super::light::Lamp;
use super::masonry::{Masonry, Side};
use super::panel::Panel;
use super::plot::Plot;
use super::sampler::{Draft, SynthConfig};
use super::stone;
use crate::random::Random;
use crate::rig::WalkRig;
use glam::{DVec2, DVec3, Vec2, Vec3};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;
use surfel_core::Camera;

/// Half of the edge of the ground.
const GROUND_HALF: f64 = 90e3;
/// Nothing stands nearer to a camera.
const ARMS_LENGTH: f64 = 2500.0;

/// Draws buildings, monuments, ground, light and cameras.
pub(super) fn draft(library: &AssetLibrary, config: &SynthConfig, random: &mut Random) -> Result<Draft, AssetError> {
    let distance = random.range(5e3, 26e3);
    let cameras = cameras(config, distance, random);
    let is_clear = |place: DVec2, plot: &Plot| plot.is_clear_of(place, ARMS_LENGTH);
    let mut plots = plots(distance, random);
    plots.retain(|plot| cameras.iter().all(|camera| is_clear(camera.centre().truncate(), plot)));
    let mut instances = Vec::new();
    for plot in &plots {
        instances.extend(building::build(library, plot, random)?);
    }
    let free = Free { plots: &plots, cameras: &cameras, distance };
    instances.extend(monuments(library, config, &free, random)?);
    instances.extend(garden(&free, random));
    let panels = vec![ground(library, random)?];
    let azimuth = random.range(0.0, TAU);
    let elevation = random.range(0.35, 1.2);
    let sun = (DVec2::from_angle(azimuth) * elevation.cos()).extend(elevation.sin());
    let colour = Vec3::new(1.0, random.range(0.9, 1.0) as f32, random.range(0.8, 0.95) as f32);
    let lamp = Lamp {
        direction: sun.as_vec3(),
        spread: random.range(0.01, 0.1) as f32,
        // From under clouds to full sun.
        colour: colour * random.range(0.1, 2.5) as f32,
    };
    let backdrop = sky(library, random)?;
    Ok(Draft { instances, panels, lamps: vec![lamp], backdrop, cameras, radius: 4000.0 })
}

/// A walk past the main building that keeps it in view; neighbours see it under an angle of the configuration.
fn cameras(config: &SynthConfig, distance: f64, random: &mut Random) -> Vec<Camera> {
    let angle_deg = random.range(config.pair_angle_deg[0], config.pair_angle_deg[1]);
    let length = 2.0 * distance * (0.5 * angle_deg.to_radians()).tan();
    let to_the_right = random.chance(0.5);
    let heading = random.range(-0.4, 0.4);
    let step = DVec2::from_angle(if to_the_right { heading } else { std::f64::consts::PI + heading }) * length;
    // From looking straight on to keeping the same point in the middle.
    let turn_deg = random.range(0.2, 1.0) * if to_the_right { angle_deg } else { -angle_deg };
    let rig = WalkRig {
        width: config.width,
        height: config.height,
        focal_per_width: random.range(0.7, 1.4),
        start: DVec3::Z * random.range(1400.0, 2400.0),
        target: DVec3::new(random.range(-0.25, 0.25), 1.0, random.range(0.05, 0.45)) * distance,
        step: step.extend(random.range(-0.03, 0.03) * length),
        turn_deg,
    };
    let further = config.further_places.iter().map(|place| rig.camera_at(*place));
    rig.cameras(config.num_views.max(1)).into_iter().chain(further).collect()
}

/// A main building; wings, neighbours and what rises behind come by chance.
fn plots(distance: f64, random: &mut Random) -> Vec<Plot> {
    let mut range = |low: f64, high: f64| random.range(low, high);
    let heading = range(-0.45, 0.45);
    let (width, depth) = (range(8e3, 40e3), range(7e3, 14e3));
    let middle = DVec2::new(range(-0.2, 0.2) * distance, distance);
    let corner = middle - DVec2::from_angle(heading) * (width * range(0.3, 0.7));
    let main = Plot { corner, heading, width, depth };
    let (wing, wing_depth) = (range(5e3, 20e3), range(6e3, 12e3));
    let (gap, set_back) = (range(0.0, 4e3).max(1e3) - 1e3, range(-3e3, 3e3));
    let (next, next_depth) = (range(6e3, 25e3), range(7e3, 14e3));
    // Fronts of wings face each other across the court before the main building.
    let left = Plot { corner: main.at(0.0, -wing), heading: heading + FRAC_PI_2, width: wing, depth: wing_depth };
    let right = Plot { corner: main.at(width, 0.0), heading: heading - FRAC_PI_2, width: wing, depth: wing_depth };
    let beside_right = Plot { corner: main.at(width + gap, set_back), heading, width: next, depth: next_depth };
    let beside_left = Plot { corner: main.at(-gap - next, -set_back), ..beside_right };
    let behind = Plot {
        corner: DVec2::new(range(-60e3, -10e3), distance * range(2.0, 3.5) + 10e3),
        heading: range(-0.2, 0.2),
        width: range(30e3, 80e3),
        depth: 14e3,
    };
    let mut plots = vec![main];
    plots.push(if random.chance(0.45) { left } else { beside_left });
    plots.push(if random.chance(0.45) { right } else { beside_right });
    if random.chance(0.4) {
        plots.push(behind);
    }
    plots
}

/// The ground between cameras and buildings.
struct Free<'a> {
    plots: &'a [Plot],
    cameras: &'a [Camera],
    distance: f64,
}

impl Free<'_> {
    /// A place for a circle of a radius; none when the first that was drawn is taken.
    fn place(&self, radius: f64, random: &mut Random) -> Option<DVec2> {
        let place = DVec2::new(random.range(-0.45, 0.45), random.range(0.3, 1.0)) * self.distance;
        let far_enough = |camera: &Camera| camera.centre().truncate().distance(place) > radius + ARMS_LENGTH;
        let is_free =
            self.plots.iter().all(|plot| plot.is_clear_of(place, radius)) && self.cameras.iter().all(far_enough);
        is_free.then_some(place)
    }
}

/// Bushes and trees, in two gardens of five.
fn garden(free: &Free<'_>, random: &mut Random) -> Vec<Instance> {
    let count = if random.chance(0.4) { 1 + random.below(5) } else { 0 };
    let plants: Vec<Plant> = (0..count).map(|_| Plant::draw(random)).collect();
    let planted = plants.into_iter().flat_map(|plant| {
        free.place(plant.reach(), random).map(|place| plant.stand(place, random)).unwrap_or_default()
    });
    planted.collect()
}

/// Objects of the library, grown to the size of people and monuments, some on pedestals.
fn monuments(
    library: &AssetLibrary,
    config: &SynthConfig,
    free: &Free<'_>,
    random: &mut Random,
) -> Result<Vec<Instance>, AssetError> {
    let mut instances = Vec::new();
    for _ in 0..random.below(6) {
        let mesh = library.mesh(&library.meshes()[random.below(library.meshes().len())].name)?;
        let resting = Resting::new(mesh, random.range(300.0, 1400.0), false, random);
        let paint = choose_paint(library, &resting.mesh, config.random_texture_share, random)?;
        let pedestal = if random.chance(0.5) { random.range(300.0, 1500.0) } else { 0.0 };
        let (tile, heading) = (random.range(800.0, 3000.0), random.range(0.0, TAU));
        let stone = stone::masonry_paint(library, tile, random)?;
        let Some(place) = free.place(resting.footprint, random) else { continue };
        if pedestal > 0.0 {
            let half = (0.8 * resting.footprint) as f32;
            let mut masonry = Masonry::default();
            masonry.block(&Side::FRONT, [-half, half], [-half, half], [0.0, pedestal as f32]);
            let plinth = 1.15 * half;
            masonry.block(&Side::FRONT, [-plinth, plinth], [-plinth, plinth], [0.0, 0.2 * pedestal as f32]);
            instances.extend(masonry.stand(place, heading, stone));
        }
        instances.push(resting.stand(place, pedestal, 1.0, paint, random));
    }
    Ok(instances)
}

/// Pavement, or now and then whatever else the library has, grass among it.
fn ground(library: &AssetLibrary, random: &mut Random) -> Result<Panel, AssetError> {
    let files = library.materials();
    let any = &files[random.below(files.len())];
    let file = if random.chance(0.7) { stone::masonry_file(library, random) } else { any };
    let repeat = random.range(1000.0, 4000.0);
    Ok(Panel {
        centre: DVec3::ZERO,
        half: [DVec3::X * GROUND_HALF, DVec3::Y * GROUND_HALF],
        image: library.image(file)?,
        repeats: Vec2::splat((2.0 * GROUND_HALF / repeat) as f32),
        tint: Vec3::splat(random.range(0.5, 1.0) as f32),
        openness: None,
    })
}

/// The sky of a place, or one colour from overcast to blue.
fn sky(library: &AssetLibrary, random: &mut Random) -> Result<Backdrop, AssetError> {
    if random.chance(0.6) {
        let place = library.environment(random.below(library.num_environments()))?;
        let gain = random.range(0.5, 1.2) as f32;
        return Ok(Backdrop::Environment(Arc::clone(&place.panorama), random.unit() as f32, gain));
    }
    let (blue, level) = (random.range(0.0, 0.6) as f32, random.range(0.5, 1.0) as f32);
    Ok(Backdrop::Flat(Vec3::new(1.0 - blue, 1.0 - 0.6 * blue, 1.0) * level))
}
