//! A few objects on a table, seen by cameras on an arc: DTU's world.
//!
//! Millimetres; the objects' middle is the origin. Invariant: the sphere about the origin that holds all
//! objects has `distance / ratio` as its radius, with the ratio drawn from the configuration.

use super::arrange::{Resting, choose_paint, cluster};
use super::error::AssetError;
use super::sampler::{Draft, SynthConfig};
use super::{backdrop::Backdrop, instance::Instance, panel::Panel};
use super::{library::AssetLibrary, light::Lamp};
use crate::random::Random;
use crate::rig::OrbitRig;
use glam::{DVec2, DVec3, Vec2, Vec3};
use surfel_core::Camera;

/// Draws objects, table, light and cameras.
pub(super) fn draft(library: &AssetLibrary, config: &SynthConfig, random: &mut Random) -> Result<Draft, AssetError> {
    let [fewest, most] = config.num_objects;
    let count = fewest.max(1) + random.below(most.saturating_sub(fewest.max(1)) + 1);
    let mut resting = Vec::new();
    let small: Vec<_> = library.meshes().iter().filter(|entry| !entry.has_tag("furniture")).collect();
    let candidates = if small.is_empty() { library.meshes().iter().collect() } else { small };
    for i in 0..count {
        let mesh = library.mesh(&candidates[random.below(candidates.len())].name)?;
        let scale = if i == 0 { 1.0 } else { random.range(0.4, 1.0) };
        let tumbled = random.chance(0.15);
        resting.push(Resting::new(mesh, scale, tumbled, random));
    }
    let radii: Vec<f64> = resting.iter().map(|r| r.footprint).collect();
    let places = cluster(&radii, random);
    let (middle, radius) = enclosing(&resting, &places);
    let ratio = random.range(config.distance_in_radii[0], config.distance_in_radii[1]);
    let wanted = config.object_distance / ratio;
    let factor = wanted / radius;
    let ground = -middle.z * factor;

    let mut instances: Vec<Instance> = Vec::new();
    for (object, place) in resting.into_iter().zip(places) {
        let paint = choose_paint(library, &object.mesh, config.random_texture_share, random)?;
        instances.push(object.stand(place - middle.truncate(), ground, factor, paint, random));
    }
    let azimuth_deg = random.range(0.0, 360.0);
    let cameras = cameras(config, azimuth_deg, wanted, random);
    let panels = surroundings(library, azimuth_deg, wanted, ground, random)?;
    let lamps = lamps(azimuth_deg, random);
    let backdrop = backdrop(library, &cameras[0], random)?;
    Ok(Draft { instances, panels, lamps, backdrop, cameras, radius: wanted })
}

/// Middle and radius of a sphere about all objects, before magnification.
fn enclosing(resting: &[Resting], places: &[DVec2]) -> (DVec3, f64) {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (object, place) in resting.iter().zip(places) {
        let side = DVec2::splat(object.footprint);
        low = low.min((place - side).extend(0.0));
        high = high.max((place + side).extend(object.height));
    }
    let middle = 0.5 * (low + high);
    let reach = resting.iter().zip(places).map(|(object, place)| {
        let flat = place.distance(middle.truncate()) + object.footprint;
        flat.hypot(0.5 * object.height)
    });
    // The corner of the cylinder is rarely filled: nine tenths of it is nearer to the objects' true radius.
    (middle, (0.9 * reach.fold(0.0, f64::max)).max(1e-9))
}

fn cameras(config: &SynthConfig, azimuth_deg: f64, radius: f64, random: &mut Random) -> Vec<Camera> {
    let jitter = random.direction() * (0.08 * radius * random.unit());
    let rig = OrbitRig {
        width: config.width,
        height: config.height,
        focal_per_width: config.focal_per_width,
        target: jitter,
        distance: config.object_distance,
        pair_angle_deg: random.range(config.pair_angle_deg[0], config.pair_angle_deg[1]),
        azimuth_deg,
        elevation_deg: random.range(12.0, 52.0),
    };
    let num_views = config.num_views.max(1);
    let further = config.further_places.iter().map(|place| rig.camera_at(*place, num_views));
    rig.cameras(num_views).into_iter().chain(further).collect()
}

/// A table, now and then with a wall behind it.
fn surroundings(
    library: &AssetLibrary,
    azimuth_deg: f64,
    radius: f64,
    ground: f64,
    random: &mut Random,
) -> Result<Vec<Panel>, AssetError> {
    let material = |random: &mut Random| {
        let files = library.materials();
        library.image(&files[random.below(files.len())])
    };
    let mut panels = Vec::new();
    if !random.chance(0.9) {
        return Ok(panels);
    }
    let azimuth = azimuth_deg.to_radians();
    let turn = DVec2::from_angle(azimuth + random.range(-0.5, 0.5));
    let size = radius * random.range(1.4, 4.0);
    let [u, v] = [turn.extend(0.0) * size, turn.perp().extend(0.0) * (size * random.range(0.8, 1.4))];
    // One repeat spans one to three object radii.
    let repeat = radius * random.range(1.0, 3.0);
    let repeats =
        |edges: [DVec3; 2]| Vec2::new(edges[0].length() as f32, edges[1].length() as f32) * (2.0 / repeat as f32);
    let tint = Vec3::splat(random.range(0.6, 1.0) as f32);
    let image = material(random)?;
    panels.push(Panel {
        centre: DVec3::Z * ground,
        half: [u, v],
        image,
        repeats: repeats([u, v]),
        tint,
        openness: None,
    });
    if random.chance(0.25) {
        let away = -DVec2::from_angle(azimuth + random.range(-0.3, 0.3)).extend(0.0);
        let half = [away.cross(DVec3::Z) * (4.0 * radius), DVec3::Z * (3.0 * radius)];
        let centre = away * (radius * random.range(1.2, 2.5)) + DVec3::Z * (ground + 3.0 * radius);
        let image = material(random)?;
        panels.push(Panel { centre, half, image, repeats: repeats(half), tint: Vec3::ONE, openness: None });
    }
    Ok(panels)
}

fn lamps(azimuth_deg: f64, random: &mut Random) -> Vec<Lamp> {
    let count = 1 + usize::from(random.chance(0.4));
    let mut strength = random.range(0.5, 2.2);
    (0..count)
        .map(|_| {
            let azimuth = (azimuth_deg + random.range(-120.0, 120.0)).to_radians();
            let elevation = random.range(25.0, 75.0f64).to_radians();
            let flat = DVec2::from_angle(azimuth) * elevation.cos();
            let warmth = random.range(-0.12, 0.12) as f32;
            let colour = Vec3::new(1.0 + warmth, 1.0, 1.0 - warmth) * strength as f32;
            strength *= 0.5;
            let spread = random.range(0.03, 0.25) as f32;
            Lamp { direction: flat.extend(elevation.sin()).as_vec3().normalize(), spread, colour }
        })
        .collect()
}

/// White, dark, a place or a photograph; values are those wanted in the picture, linear.
fn backdrop(library: &AssetLibrary, camera: &Camera, random: &mut Random) -> Result<Backdrop, AssetError> {
    let kind = random.unit();
    if kind < 0.25 {
        return Ok(Backdrop::Flat(Vec3::splat(random.range(0.75, 1.0) as f32)));
    }
    if kind < 0.55 {
        return Ok(Backdrop::Flat(Vec3::splat(random.range(0.0, 0.04) as f32)));
    }
    if kind < 0.8 {
        let place = library.environment(random.below(library.num_environments()))?;
        let image = std::sync::Arc::clone(&place.panorama);
        return Ok(Backdrop::Environment(image, random.unit() as f32, random.range(0.4, 1.0) as f32));
    }
    let files = library.photos();
    let image = library.image(&files[random.below(files.len())])?;
    let gain = random.range(0.3, 0.9) as f32;
    Ok(Backdrop::Photo { image, towards: camera.forward().as_vec3(), spread: 0.45, gain })
}
