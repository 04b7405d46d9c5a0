//! One options struct that makes a whole analytic scene: objects, paint, light and cameras.
//!
//! The habit of COLMAP's `scene/synthetic.h`: a test states what matters to it and takes the rest from
//! `Default`. Invariant: equal options give equal scenes, and lengths scale with `object_radius`.

use crate::random::Random;
use crate::render::{RenderOptions, RenderedView};
use crate::rig::OrbitRig;
use crate::scene::{Lighting, Object, Scene};
use crate::sdf::Sdf;
use crate::shape::{Shape, Wave, Waves};
use crate::texture::Texture;
use glam::{DQuat, DVec2, DVec3};
use std::f64::consts::TAU;
use surfel_core::{Camera, Rigid};

/// What stands in the middle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneKind {
    /// A sphere of the object radius about the origin.
    Sphere,
    /// A torus about a tilted axis.
    Torus,
    /// Three boxes, one leaning.
    Boxes,
    /// A rolling height field instead of objects on a ground.
    HeightField,
    /// A plane facing the cameras, tilted by 25 degrees.
    Plane,
    /// Solids melted into one figure.
    StillLife,
}

impl SceneKind {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Sphere, Self::Torus, Self::Boxes, Self::HeightField, Self::Plane, Self::StillLife];

    /// The short name, as typed on a command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sphere => "sphere",
            Self::Torus => "torus",
            Self::Boxes => "boxes",
            Self::HeightField => "height-field",
            Self::Plane => "plane",
            Self::StillLife => "still-life",
        }
    }
}

/// A whole scene in one struct.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneOptions {
    /// What stands in the middle.
    pub kind: SceneKind,
    /// Names paint, light and arrangement.
    pub seed: u64,
    /// Radius of what stands in the middle, scene units; everything else follows it.
    pub object_radius: f64,
    /// Whether it stands on a ground.
    pub ground: bool,
    /// Image columns.
    pub width: usize,
    /// Image rows.
    pub height: usize,
    /// Number of cameras.
    pub num_views: usize,
    /// Camera distance in object radii.
    pub distance_in_radii: f64,
    /// Angle between neighbouring cameras, degrees.
    pub pair_angle_deg: f64,
    /// Further cameras after those, by their place on the arc: 0.5 is halfway from the first to the second.
    pub further_places: Vec<f64>,
    /// Colour rays per pixel along each axis.
    pub supersampling: usize,
    /// Standard deviation of the sensor noise, sRGB units.
    pub noise: f32,
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self {
            kind: SceneKind::StillLife,
            seed: 0,
            object_radius: 200.0,
            ground: true,
            width: 320,
            height: 256,
            num_views: 2,
            distance_in_radii: 3.25,
            pair_angle_deg: 11.0,
            further_places: Vec::new(),
            supersampling: 2,
            noise: 0.0,
        }
    }
}

impl SceneOptions {
    /// The rig its cameras stand on.
    pub fn rig(&self) -> OrbitRig {
        OrbitRig {
            distance: self.distance_in_radii * self.object_radius,
            pair_angle_deg: self.pair_angle_deg,
            ..OrbitRig::dtu(self.width, self.height)
        }
    }

    /// Its cameras, left to right, then the further ones.
    pub fn cameras(&self) -> Vec<Camera> {
        let rig = self.rig();
        let further = self.further_places.iter().map(|place| rig.camera_at(*place, self.num_views));
        rig.cameras(self.num_views).into_iter().chain(further).collect()
    }

    /// The scene.
    pub fn scene(&self) -> Scene {
        let mut random = Random::new(self.seed);
        let r = self.object_radius;
        let mut objects = self.middle(&mut random);
        if self.ground && !matches!(self.kind, SceneKind::HeightField | SceneKind::Plane) {
            let lowest = if self.kind == SceneKind::Sphere { -r } else { -0.55 * r };
            let ground = Shape::Plane { half: DVec2::splat(12.0 * r) };
            let texture = self.paint(&mut random);
            objects.push(Object::at(DVec3::Z * lowest, ground, texture).surroundings());
        }
        let key_direction = DVec3::new(random.range(-0.7, 0.7), -0.6, random.range(0.5, 1.0)).normalize();
        let lighting = Lighting { key_direction, ..Lighting::default() };
        Scene { objects, lighting, backdrop: [0.08, 0.08, 0.1] }
    }

    /// Photographs the scene from all cameras; views are named "0", "1", ...
    pub fn render(&self) -> Vec<RenderedView> {
        let scene = self.scene();
        let photograph = |(i, camera): (usize, &Camera)| {
            let noise_seed = self.seed.wrapping_mul(1009).wrapping_add(i as u64);
            let options = RenderOptions { supersampling: self.supersampling, noise: self.noise, noise_seed };
            scene.render(camera, i.to_string(), &options)
        };
        self.cameras().iter().enumerate().map(photograph).collect()
    }

    /// Noise in two random colours, its finest octave near two pixels wide at the object.
    fn paint(&self, random: &mut Random) -> Texture {
        let size = 0.5 * self.object_radius;
        let rig = self.rig();
        let pixel = rig.distance / (rig.focal_per_width * self.width as f64);
        let octaves = (size / (2.0 * pixel)).log2().floor().clamp(0.0, 12.0) as u32 + 1;
        let mut colour = |low: f64, high: f64| std::array::from_fn(|_| random.range(low, high) as f32);
        let colours = [colour(0.15, 0.5), colour(0.5, 0.95)];
        Texture::Noise { seed: random.bits(), size, octaves, colours }
    }

    fn middle(&self, random: &mut Random) -> Vec<Object> {
        let r = self.object_radius;
        let place = |centre: DVec3, turn: DQuat, shape: Shape, random: &mut Random| Object {
            world_from_shape: Rigid::from_quat(turn, centre * r),
            ..Object::at(DVec3::ZERO, shape, self.paint(random))
        };
        match self.kind {
            SceneKind::Sphere => vec![place(DVec3::ZERO, DQuat::IDENTITY, Shape::Sphere { radius: r }, random)],
            SceneKind::Torus => {
                let turn = DQuat::from_rotation_x(0.4);
                vec![place(DVec3::Z * 0.05, turn, Shape::torus(0.7 * r, 0.28 * r), random)]
            }
            SceneKind::Boxes => {
                let turn = |z: f64, x: f64| DQuat::from_rotation_z(z) * DQuat::from_rotation_x(x);
                let cuboid = |x: f64, y: f64, z: f64| Shape::Box { half: DVec3::new(x, y, z) * r };
                vec![
                    place(DVec3::new(-0.35, 0.1, -0.15), turn(0.5, 0.0), cuboid(0.3, 0.25, 0.4), random),
                    place(DVec3::new(0.4, -0.1, -0.3), turn(-0.3, 0.0), cuboid(0.25, 0.25, 0.25), random),
                    place(DVec3::new(0.1, 0.35, 0.0), turn(0.2, 0.5), cuboid(0.5, 0.12, 0.4), random),
                ]
            }
            SceneKind::HeightField => {
                let wave = |amplitude: f64, radians: f64, random: &mut Random| Wave {
                    amplitude: amplitude * r,
                    frequency: DVec2::from_angle(random.range(0.0, TAU)) * (radians / r),
                    phase: random.range(0.0, TAU),
                };
                let waves = [(0.12, 2.5), (0.07, 4.5), (0.03, 9.0)].map(|(a, k)| wave(a, k, random));
                let field = Shape::HeightField { half: DVec2::splat(1.3 * r), waves: Waves(waves.to_vec()) };
                vec![place(DVec3::ZERO, DQuat::IDENTITY, field, random)]
            }
            SceneKind::Plane => {
                // The cameras look down by the rig's elevation; 25 degrees more than square to them.
                let turn = DQuat::from_rotation_x((90.0 - self.rig().elevation_deg - 25.0).to_radians());
                vec![place(DVec3::ZERO, turn, Shape::Plane { half: DVec2::splat(3.0 * r) }, random)]
            }
            SceneKind::StillLife => {
                let parts = vec![
                    Sdf::Sphere { centre: DVec3::new(-0.25, 0.0, -0.1) * r, radius: 0.45 * r },
                    Sdf::Torus { centre: DVec3::new(0.3, -0.1, -0.42) * r, major: 0.35 * r, minor: 0.13 * r },
                    Sdf::Capsule {
                        ends: [DVec3::new(0.1, 0.2, -0.4) * r, DVec3::new(0.5, 0.35, 0.5) * r],
                        radius: 0.14 * r,
                    },
                    Sdf::RoundedBox {
                        centre: DVec3::new(0.1, 0.1, -0.43) * r,
                        half: DVec3::new(0.6, 0.35, 0.12) * r,
                        rounding: 0.04 * r,
                    },
                ];
                let figure = Shape::Solid(Sdf::Union { parts, blend: 0.12 * r });
                vec![place(DVec3::ZERO, DQuat::from_rotation_z(random.range(-0.4, 0.4)), figure, random)]
            }
        }
    }
}
