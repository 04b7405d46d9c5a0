//! A furnished room seen from a slow walk: RealEstate10K's world.
//!
//! Millimetres, floor at z = 0, the walk along the near wall looking at the far one. Invariant: every ray
//! of every camera meets something (floor, walls and ceiling are closed towards the view).

use super::arrange::{Resting, choose_paint};
use super::backdrop::Backdrop;
use super::error::AssetError;
use super::instance::{Instance, Paint};
use super::library::{AssetLibrary, MeshEntry};
use super::light::Lamp;
use super::panel::Panel;
use super::sampler::{Draft, SynthConfig};
use crate::random::Random;
use crate::rig::WalkRig;
use crate::shape::Ray;
use glam::{DVec2, DVec3, Vec2, Vec3};
use surfel_core::Camera;

/// File units above which an object of the library is itself a room (metres).
const LARGEST_FURNITURE: f32 = 4.0;
/// Millimetres of radius per metre of a piece's longest edge; a little more than half a metre for its diagonal.
const METRES_TO_RADIUS: f64 = 620.0;

/// Draws room, furniture, light and cameras.
pub(super) fn draft(library: &AssetLibrary, config: &SynthConfig, random: &mut Random) -> Result<Draft, AssetError> {
    let size = DVec3::new(random.range(3000.0, 5000.0), random.range(3500.0, 6000.0), random.range(2400.0, 3000.0));
    let mut panels = walls(library, size, random)?;
    panels.extend(posters(library, size, random)?);
    let instances = furniture(library, config, size, random)?;
    let cameras = cameras(config, size, random);
    let lamp = Lamp {
        direction: Vec3::new(random.range(-0.6, 0.6) as f32, random.range(-0.8, 0.2) as f32, 1.0).normalize(),
        spread: random.range(0.15, 0.35) as f32,
        colour: Vec3::splat(random.range(0.4, 1.2) as f32),
    };
    Ok(Draft { instances, panels, lamps: vec![lamp], backdrop: Backdrop::Flat(Vec3::ZERO), cameras, radius: 1000.0 })
}

fn cameras(config: &SynthConfig, size: DVec3, random: &mut Random) -> Vec<Camera> {
    let start = DVec3::new(
        random.range(-0.25, 0.25) * size.x,
        -0.5 * size.y + random.range(250.0, 900.0),
        random.range(1100.0, 1700.0),
    );
    let target = DVec3::new(random.range(-0.2, 0.2) * size.x, 0.35 * size.y, random.range(500.0, 1200.0));
    let heading = random.range(-0.6, 0.6) + if random.chance(0.5) { std::f64::consts::PI } else { 0.0 };
    let step = DVec2::from_angle(heading).extend(random.range(-0.1, 0.1)) * random.range(60.0, 350.0);
    let rig = WalkRig {
        width: config.width,
        height: config.height,
        focal_per_width: random.range(0.75, 1.0),
        start,
        target,
        step,
        turn_deg: random.range(-3.0, 3.0),
    };
    let further = config.further_places.iter().map(|place| rig.camera_at(*place));
    rig.cameras(config.num_views.max(1)).into_iter().chain(further).collect()
}

/// Floor first (it throws light back), then three walls and the ceiling.
fn walls(library: &AssetLibrary, size: DVec3, random: &mut Random) -> Result<Vec<Panel>, AssetError> {
    let [x, y, z] = [DVec3::X * (0.5 * size.x), DVec3::Y * (0.5 * size.y), DVec3::Z * (0.5 * size.z)];
    let files = library.materials();
    let panel = |centre: DVec3, half: [DVec3; 2], file: usize, tint: Vec3, random: &mut Random| {
        let repeat = random.range(700.0, 1800.0) as f32;
        let repeats = Vec2::new(half[0].length() as f32, half[1].length() as f32) * (2.0 / repeat);
        let image = library.image(&files[file])?;
        Ok::<_, AssetError>(Panel { centre, half, image, repeats, tint, openness: None })
    };
    let pick = |random: &mut Random| random.below(files.len());
    let (floor, wall, ceiling) = (pick(random), pick(random), pick(random));
    let light = Vec3::splat(random.range(0.8, 1.0) as f32);
    // The walls reach behind the walk, so that no camera of it sees their end.
    let back = DVec3::Y * -600.0;
    let deep = y + DVec3::Y * 600.0;
    Ok(vec![
        panel(back, [x, deep], floor, Vec3::ONE, random)?,
        panel(y + z, [x, z], wall, light, random)?,
        panel(-x + z + back, [deep, z], wall, light * 0.9, random)?,
        panel(x + z + back, [deep, z], wall, light * 0.95, random)?,
        panel(2.0 * z + back, [x, deep], ceiling, light, random)?,
    ])
}

/// Photographs hung on the far wall and the side walls, a hand's breadth in front of them.
fn posters(library: &AssetLibrary, size: DVec3, random: &mut Random) -> Result<Vec<Panel>, AssetError> {
    let files = library.photos();
    let mut posters = Vec::new();
    for _ in 0..1 + random.below(4) {
        let image = library.image(&files[random.below(files.len())])?;
        let half_width = random.range(200.0, 700.0);
        let half_height = half_width * f64::from(image.size().y / image.size().x);
        let centre_height = random.range(0.45, 0.7) * size.z;
        let (centre, right) = match random.below(3) {
            0 => (DVec3::new(-0.5 * size.x + 25.0, random.range(-0.2, 0.4) * size.y, 0.0), DVec3::Y),
            1 => (DVec3::new(0.5 * size.x - 25.0, random.range(-0.2, 0.4) * size.y, 0.0), DVec3::NEG_Y),
            _ => (DVec3::new(random.range(-0.35, 0.35) * size.x, 0.5 * size.y - 25.0, 0.0), DVec3::X),
        };
        posters.push(Panel {
            centre: centre + DVec3::Z * centre_height,
            half: [right * half_width, DVec3::NEG_Z * half_height],
            image,
            repeats: Vec2::ONE,
            tint: Vec3::ONE,
            openness: None,
        });
    }
    Ok(posters)
}

/// Pieces on the floor, then small things on the floor or on top of the pieces.
fn furniture(
    library: &AssetLibrary,
    config: &SynthConfig,
    size: DVec3,
    random: &mut Random,
) -> Result<Vec<Instance>, AssetError> {
    let is_small = |entry: &&MeshEntry| !entry.has_tag("furniture");
    let (things, pieces): (Vec<_>, Vec<_>) = library.meshes().iter().partition(is_small);
    let mut pieces: Vec<_> = pieces.into_iter().filter(|p| p.extent.iter().all(|&e| e < LARGEST_FURNITURE)).collect();
    let mut floor = Floor { size, instances: Vec::new(), taken: Vec::new() };
    for _ in 0..2 + random.below(4) {
        if pieces.is_empty() {
            break;
        }
        // Each piece once: a room of five equal shelves looks like a warehouse.
        let mesh = library.mesh(&pieces.swap_remove(random.below(pieces.len())).name)?;
        let radius = METRES_TO_RADIUS * f64::from(mesh.extent) * random.range(0.8, 1.2);
        let paint = choose_paint(library, &mesh, config.random_texture_share, random)?;
        floor.place(Resting::new(mesh, radius, false, random), paint, random);
    }
    for _ in 0..if things.is_empty() { 0 } else { 3 + random.below(6) } {
        let mesh = library.mesh(&things[random.below(things.len())].name)?;
        let paint = choose_paint(library, &mesh, config.random_texture_share, random)?;
        let on_top = random.chance(0.6);
        let radius = if on_top { random.range(90.0, 220.0) } else { random.range(200.0, 550.0) };
        let resting = Resting::new(mesh, radius, false, random);
        match floor.table_top(&resting, random).filter(|_| on_top) {
            Some((place, height)) => floor.instances.push(resting.stand(place, height, 1.0, paint, random)),
            None => floor.place(resting, paint, random),
        }
    }
    Ok(floor.instances)
}

/// A room being filled.
struct Floor {
    size: DVec3,
    instances: Vec<Instance>,
    taken: Vec<(DVec2, f64)>,
}

impl Floor {
    /// Stands an object where nothing else stands, in front of the walk; leaves it out when there is no room.
    fn place(&mut self, resting: Resting, paint: Paint, random: &mut Random) {
        let margin = DVec2::splat(resting.footprint);
        let low = DVec2::new(-0.5 * self.size.x, -0.15 * self.size.y) + margin;
        let high = DVec2::new(0.5 * self.size.x, 0.5 * self.size.y) - margin;
        if !low.cmplt(high).all() || resting.height > self.size.z {
            return;
        }
        let is_free = |place: DVec2| self.taken.iter().all(|(p, r)| p.distance(place) > 0.85 * (r + resting.footprint));
        let tries = (0..40).map(|_| DVec2::new(random.range(low.x, high.x), random.range(low.y, high.y)));
        let Some(place) = tries.collect::<Vec<_>>().into_iter().find(|&place| is_free(place)) else { return };
        self.taken.push((place, resting.footprint));
        self.instances.push(resting.stand(place, 0.0, 1.0, paint, random));
    }

    /// A level place on top of something: five rays from above must agree to a centimetre.
    fn table_top(&self, resting: &Resting, random: &mut Random) -> Option<(DVec2, f64)> {
        let reach = 0.7 * resting.footprint;
        let around = [DVec2::ZERO, DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y].map(|d| d * reach);
        for _ in 0..12 {
            let (middle, radius) = self.taken.get(random.below(self.taken.len()))?;
            let place =
                *middle + DVec2::from_angle(random.range(0.0, std::f64::consts::TAU)) * (radius * 0.6 * random.unit());
            let heights = around.map(|offset| self.height_below((place + offset).extend(self.size.z)));
            let (low, high) = heights.iter().fold((f64::INFINITY, 0.0f64), |(a, b), &h| (a.min(h), b.max(h)));
            if high - low < 10.0 && low > 200.0 && high + resting.height < self.size.z {
                return Some((place, high));
            }
        }
        None
    }

    fn height_below(&self, point: DVec3) -> f64 {
        let down = Ray { origin: point, direction: DVec3::NEG_Z };
        let hits = self.instances.iter().filter_map(|instance| instance.intersect(&down, point.z));
        hits.map(|hit| point.z - f64::from(hit.t)).fold(0.0, f64::max)
    }
}
