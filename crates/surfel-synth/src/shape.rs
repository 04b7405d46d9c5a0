//! Shapes with exact ray intersections.
//!
//! Each shape lives in its own frame about its origin; [`crate::scene::Object`] places it. Invariant:
//! a [`Hit`] lies on the surface to `f64` rounding, and its normal is the surface's outward unit normal.

use crate::root::first_root;
use crate::sdf::Sdf;
use glam::{DVec2, DVec3};

/// A ray `origin + t * direction`; `direction` need not be a unit vector, `t` counts in its length.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Start, scene units.
    pub origin: DVec3,
    /// Direction; for camera rays its camera-frame z is 1, which makes `t` the z-depth.
    pub direction: DVec3,
}

impl Ray {
    /// The point at parameter `t`.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }
}

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Ray parameter.
    pub t: f64,
    /// Outward unit normal, in the frame of the ray.
    pub normal: DVec3,
}

/// A sum of plane waves `height(x, y) = sum of amplitude * sin(frequency . (x, y) + phase)`.
#[derive(Clone, Debug, PartialEq)]
pub struct Waves(pub Vec<Wave>);

/// One plane wave of a height field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    /// Height, scene units.
    pub amplitude: f64,
    /// Wave vector, radians per scene unit.
    pub frequency: DVec2,
    /// Phase, radians.
    pub phase: f64,
}

impl Waves {
    /// Height at `p`.
    pub fn height(&self, p: DVec2) -> f64 {
        self.0.iter().map(|w| w.amplitude * (w.frequency.dot(p) + w.phase).sin()).sum()
    }

    /// Derivatives of the height by x and y.
    pub fn gradient(&self, p: DVec2) -> DVec2 {
        self.0.iter().map(|w| w.frequency * (w.amplitude * (w.frequency.dot(p) + w.phase).cos())).sum()
    }

    fn height_max(&self) -> f64 {
        self.0.iter().map(|w| w.amplitude.abs()).sum()
    }

    fn slope_max(&self) -> f64 {
        self.0.iter().map(|w| w.amplitude.abs() * w.frequency.length()).sum()
    }
}

/// A surface in its own frame, scene units.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A sphere about the origin.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// The rectangle `|x| <= half.x, |y| <= half.y` of the plane z = 0, outward +Z.
    Plane {
        /// Half of the edge lengths.
        half: DVec2,
    },
    /// An axis-aligned box about the origin.
    Box {
        /// Half of the edge lengths.
        half: DVec3,
    },
    /// The surface `z = waves.height(x, y)` over a rectangle, outward +Z.
    HeightField {
        /// Half of the edge lengths of the rectangle.
        half: DVec2,
        /// The height.
        waves: Waves,
    },
    /// A solid given by its signed distance; tori and blended unions.
    Solid(Sdf),
}

impl Shape {
    /// A torus about the Z axis.
    pub fn torus(major: f64, minor: f64) -> Self {
        Self::Solid(Sdf::Torus { centre: DVec3::ZERO, major, minor })
    }

    /// Radius about the origin that holds the whole shape.
    pub fn radius(&self) -> f64 {
        match self {
            Self::Sphere { radius } => *radius,
            Self::Plane { half } => half.length(),
            Self::Box { half } => half.length(),
            Self::HeightField { half, waves } => half.length().hypot(waves.height_max()),
            Self::Solid(sdf) => sdf.radius(),
        }
    }

    /// First intersection with `t > t_min`, from outside or inside.
    pub fn intersect(&self, ray: &Ray, t_min: f64) -> Option<Hit> {
        match self {
            Self::Sphere { radius } => {
                let (enter, leave) = sphere_interval(ray, *radius)?;
                let t = [enter, leave].into_iter().find(|&t| t > t_min)?;
                Some(Hit { t, normal: ray.at(t) / *radius })
            }
            Self::Plane { half } => {
                let t = -ray.origin.z / ray.direction.z;
                let p = ray.at(t);
                let inside = t.is_finite() && t > t_min && p.x.abs() <= half.x && p.y.abs() <= half.y;
                inside.then_some(Hit { t, normal: DVec3::Z })
            }
            Self::Box { half } => {
                let (enter, leave) = box_interval(ray, *half)?;
                let t = [enter, leave].into_iter().find(|&t| t > t_min)?;
                Some(Hit { t, normal: box_normal(ray.at(t), *half) })
            }
            Self::HeightField { half, waves } => {
                let speed = ray.direction.length();
                let slack = 1e-9 * self.radius();
                let bounds = half.extend(waves.height_max() + slack);
                let (enter, leave) = box_interval(ray, bounds)?;
                // |height - z| over this is a lower bound of the distance to the surface.
                let steepness = (1.0 + waves.slope_max().powi(2)).sqrt() * speed;
                let bound = |t: f64| {
                    let p = ray.at(t);
                    (p.z - waves.height(p.truncate())) / steepness
                };
                let t = first_root(bound, enter.max(t_min), leave, 1e-5 * self.radius() / speed)?;
                let slope = waves.gradient(ray.at(t).truncate());
                Some(Hit { t, normal: DVec3::new(-slope.x, -slope.y, 1.0).normalize() })
            }
            Self::Solid(sdf) => {
                let speed = ray.direction.length();
                let (enter, leave) = sphere_interval(ray, sdf.radius() * (1.0 + 1e-9))?;
                let bound = |t: f64| sdf.distance(ray.at(t)) / speed;
                let t = first_root(bound, enter.max(t_min), leave, 1e-5 * sdf.radius() / speed)?;
                Some(Hit { t, normal: sdf.normal(ray.at(t)) })
            }
        }
    }
}

/// Parameters where the ray enters and leaves the sphere of `radius` about the origin.
fn sphere_interval(ray: &Ray, radius: f64) -> Option<(f64, f64)> {
    let a = ray.direction.length_squared();
    let b = ray.origin.dot(ray.direction);
    // The perpendicular form loses no digits when the ray starts far away.
    let nearest = ray.origin - ray.direction * (b / a);
    let discriminant = radius * radius - nearest.length_squared();
    (discriminant >= 0.0).then(|| {
        let half_chord = (discriminant / a).sqrt();
        (-b / a - half_chord, -b / a + half_chord)
    })
}

/// Parameters where the ray enters and leaves the box `|p| <= half`.
fn box_interval(ray: &Ray, half: DVec3) -> Option<(f64, f64)> {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..3 {
        let (o, d, h) = (ray.origin[axis], ray.direction[axis], half[axis]);
        if d == 0.0 {
            if o.abs() > h {
                return None;
            }
            continue;
        }
        let (a, b) = ((-h - o) / d, (h - o) / d);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    (enter <= leave).then_some((enter, leave))
}

fn box_normal(p: DVec3, half: DVec3) -> DVec3 {
    let q = (p / half).abs();
    let axis = if q.x >= q.y && q.x >= q.z {
        DVec3::X
    } else if q.y >= q.z {
        DVec3::Y
    } else {
        DVec3::Z
    };
    axis * p.dot(axis).signum()
}
