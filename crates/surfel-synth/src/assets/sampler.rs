//! Endless posed scenes from an asset library: one seed, one scene.
//!
//! Invariant: a scene depends on the library's content, the configuration and the seed alone; views can be
//! rendered in any order, on any number of threads.

use super::backdrop::Backdrop;
use super::error::AssetError;
use super::instance::Instance;
use super::library::AssetLibrary;
use super::light::Lamp;
use super::panel::Panel;
use super::photograph::photograph;
use super::sensor::Sensor;
use super::stage::Stage;
use super::{openness, room, street, tabletop};
use crate::random::Random;
use crate::render::{RenderedView, pixel_ray};
use glam::{DVec2, Vec3};
use surfel_core::Camera;

/// What scenes to draw. Lengths in millimetres.
#[derive(Clone, Debug, PartialEq)]
pub struct SynthConfig {
    /// Image columns.
    pub width: usize,
    /// Image rows.
    pub height: usize,
    /// Cameras per scene.
    pub num_views: usize,
    /// Further cameras after those, by their place on the path: 0.5 is halfway from the first to the second.
    pub further_places: Vec<f64>,
    /// Share of furnished rooms among the scenes.
    pub room_share: f64,
    /// Share of buildings under an open sky among those that are no rooms; the rest are tabletops.
    pub street_share: f64,
    /// Fewest and most objects on a table.
    pub num_objects: [usize; 2],
    /// Distance of the cameras from the objects' middle, millimetres (tabletops).
    pub object_distance: f64,
    /// That distance in radii of the objects together, least and most.
    pub distance_in_radii: [f64; 2],
    /// Angle between neighbouring cameras, degrees, least and most (tabletops and streets).
    pub pair_angle_deg: [f64; 2],
    /// Focal length over image width (tabletops).
    pub focal_per_width: f64,
    /// Share of textured objects that are repainted.
    pub random_texture_share: f64,
    /// Largest change of exposure between views, in stops to either side.
    pub exposure_stops: f64,
    /// Largest read noise, linear units; shot noise goes with it.
    pub noise: f64,
    /// Sharpening by the camera, least and most; all views of a scene have the same.
    pub sharpening: [f64; 2],
    /// Share of views stored as JPEG, and the least quality.
    pub jpeg: (f64, u8),
}

impl Default for SynthConfig {
    fn default() -> Self {
        Self {
            width: 320,
            height: 256,
            num_views: 2,
            further_places: Vec::new(),
            room_share: 0.25,
            street_share: 0.0,
            num_objects: [1, 6],
            object_distance: 650.0,
            distance_in_radii: [2.5, 3.0],
            pair_angle_deg: [5.0, 30.0],
            focal_per_width: 1.8,
            random_texture_share: 1.0 / 3.0,
            exposure_stops: 0.25,
            noise: 0.006,
            sharpening: [0.0, 0.0],
            jpeg: (0.5, 70),
        }
    }
}

impl SynthConfig {
    /// DTU-like pairs without camera defects: objects 650 mm away, cameras 125 mm apart.
    pub fn clean_pair(width: usize, height: usize) -> Self {
        let angle = 2.0 * (62.5f64 / 650.0).asin().to_degrees();
        Self {
            width,
            height,
            room_share: 0.0,
            pair_angle_deg: [angle, angle],
            exposure_stops: 0.0,
            noise: 0.0,
            jpeg: (0.0, 100),
            ..Self::default()
        }
    }
}

/// Names the stream of chance that sharpening is drawn from; streams of sensors are numbered from 1.
const SHARPENING_STREAM: u64 = u64::MAX;
/// Names the stream of chance that decides whether a scene is a street.
const STREET_STREAM: u64 = u64::MAX - 1;

/// What a kind of scene decides before light is measured.
pub(super) struct Draft {
    pub instances: Vec<Instance>,
    pub panels: Vec<Panel>,
    pub lamps: Vec<Lamp>,
    pub backdrop: Backdrop,
    pub cameras: Vec<Camera>,
    pub radius: f64,
}

/// Draws scenes from a library.
pub struct SceneSampler<'a> {
    library: &'a AssetLibrary,
    config: SynthConfig,
}

/// A scene ready to be photographed; independent of the library it came from.
pub struct SynthScene {
    /// Geometry and light.
    pub stage: Stage,
    /// The cameras, left to right or along the walk, then the further ones; millimetres.
    pub cameras: Vec<Camera>,
    /// One sensor per camera.
    pub sensors: Vec<Sensor>,
}

impl<'a> SceneSampler<'a> {
    /// A sampler with a configuration.
    pub fn new(library: &'a AssetLibrary, config: SynthConfig) -> Self {
        Self { library, config }
    }

    /// The scene named by `seed`.
    ///
    /// # Errors
    /// When an asset it needs cannot be read.
    pub fn scene(&self, seed: u64) -> Result<SynthScene, AssetError> {
        let mut random = Random::new(seed);
        let is_room = random.chance(self.config.room_share);
        // A stream of its own, so that without streets scenes are what they were.
        let is_street = !is_room && Random::fork(seed, STREET_STREAM).chance(self.config.street_share);
        let draw = match (is_room, is_street) {
            (true, _) => room::draft,
            (false, true) => street::draft,
            (false, false) => tabletop::draft,
        };
        let Draft { instances, panels, lamps, backdrop, cameras, radius } =
            draw(self.library, &self.config, &mut random)?;
        let environment = self.library.environment(random.below(self.library.num_environments()))?;
        let irradiance = environment.irradiance.clone();
        let bounce = panels.first().map_or(0.3 * irradiance.on(Vec3::NEG_Z), |ground| {
            let lamp_light: Vec3 = lamps.iter().map(|lamp| lamp.colour * lamp.direction.z.max(0.0)).sum();
            ground.image.mean() * ground.tint * (irradiance.on(Vec3::Z) + lamp_light) * 0.7
        });
        let mut stage = Stage { instances, panels, lamps, irradiance, bounce, backdrop, radius };
        for i in 0..stage.panels.len() {
            stage.panels[i].openness = openness::measure(&stage, i, 0.8 * radius);
        }
        let exposure = exposure(&stage, &cameras[0]);
        stage.backdrop = stage.backdrop.dimmed(1.0 / exposure);
        let [least, most] = self.config.sharpening;
        // A stream of its own, so that scenes without sharpening stay what they were.
        let sharpening = Random::fork(seed, SHARPENING_STREAM).range(least, most) as f32;
        let sensor = |i: usize| self.sensor(exposure, sharpening, Random::fork(seed, i as u64 + 1));
        let sensors = (0..cameras.len()).map(sensor).collect();
        Ok(SynthScene { stage, cameras, sensors })
    }

    fn sensor(&self, exposure: f32, sharpening: f32, mut random: Random) -> Sensor {
        let config = &self.config;
        let stops = random.range(-1.0, 1.0) * config.exposure_stops;
        let tint = |random: &mut Random| 1.0 + (0.1 * config.exposure_stops * random.normal()) as f32;
        let balance = Vec3::new(tint(&mut random), 1.0, tint(&mut random));
        let read_noise = (random.unit() * config.noise) as f32;
        let (share, least) = config.jpeg;
        let jpeg_quality = random.chance(share).then(|| random.range(f64::from(least), 98.0) as u8);
        Sensor {
            gain: balance * exposure * stops.exp2() as f32,
            read_noise,
            shot_noise: 0.05 * read_noise,
            vignetting: if config.exposure_stops > 0.0 { random.range(0.0, 0.15) as f32 } else { 0.0 },
            sharpening,
            jpeg_quality,
            seed: random.bits(),
        }
    }
}

impl SynthScene {
    /// Number of cameras.
    pub fn num_views(&self) -> usize {
        self.cameras.len()
    }

    /// The photograph of camera `index`, named by its number, with exact depth, normal and object.
    ///
    /// # Panics
    /// If there is no such camera.
    pub fn render(&self, index: usize) -> RenderedView {
        let mut rendered = photograph(&self.stage, &self.cameras[index], &index.to_string());
        rendered.view.image = self.sensors[index].record(&rendered.view.image);
        rendered
    }
}

/// Gain that brings the brighter parts of what `camera` sees to a well exposed level.
fn exposure(stage: &Stage, camera: &Camera) -> f32 {
    const COLUMNS: usize = 24;
    const ROWS: usize = 18;
    /// Linear value of the 85th percentile: sRGB 0.73.
    const BRIGHT: f32 = 0.5;
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    let mut levels: Vec<f32> = (0..COLUMNS * ROWS)
        .filter_map(|i| {
            let cell = DVec2::new((i % COLUMNS) as f64 + 0.5, (i / COLUMNS) as f64 + 0.5);
            let ray = pixel_ray(camera, cell / DVec2::new(COLUMNS as f64, ROWS as f64) * size);
            let hit = stage.trace(&ray)?;
            let light = stage.radiance(&ray, Some(&hit), size.x / (COLUMNS as f64 * camera.intrinsics.fx), 0.0);
            Some(light.dot(Vec3::new(0.21, 0.72, 0.07)))
        })
        .collect();
    levels.sort_by(f32::total_cmp);
    let bright = levels.get(levels.len() * 85 / 100).copied().unwrap_or(BRIGHT);
    (BRIGHT / bright.max(1e-3)).clamp(0.2, 5.0)
}
