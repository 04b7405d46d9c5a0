//! Signed distance functions: solids that melt into one another.
//!
//! Invariant: [`Sdf::distance`] never exceeds the true distance to the surface (it is exact for the
//! primitives, a lower bound for unions), which is what makes sphere tracing safe.

use glam::{DVec2, DVec3};

/// A solid given by its signed distance, negative inside; own frame, scene units.
#[derive(Clone, Debug, PartialEq)]
pub enum Sdf {
    /// A ball.
    Sphere {
        /// Centre.
        centre: DVec3,
        /// Radius.
        radius: f64,
    },
    /// An axis-aligned box with rounded edges.
    RoundedBox {
        /// Centre.
        centre: DVec3,
        /// Half of the outer edge lengths.
        half: DVec3,
        /// Radius of the edges, at most the smallest half edge.
        rounding: f64,
    },
    /// A torus about the Z axis.
    Torus {
        /// Centre.
        centre: DVec3,
        /// Radius of the ring's middle circle.
        major: f64,
        /// Radius of the tube.
        minor: f64,
    },
    /// A segment thickened by a radius.
    Capsule {
        /// Ends of the segment.
        ends: [DVec3; 2],
        /// Radius.
        radius: f64,
    },
    /// The union of solids, their seams filleted over a length `blend` (0: sharp).
    Union {
        /// The solids.
        parts: Vec<Sdf>,
        /// Width of the fillet, scene units.
        blend: f64,
    },
}

impl Sdf {
    /// Signed distance bound at `p`, scene units.
    pub fn distance(&self, p: DVec3) -> f64 {
        match self {
            Self::Sphere { centre, radius } => (p - centre).length() - radius,
            Self::RoundedBox { centre, half, rounding } => {
                let q = (p - centre).abs() - (*half - DVec3::splat(*rounding));
                q.max(DVec3::ZERO).length() + q.max_element().min(0.0) - rounding
            }
            Self::Torus { centre, major, minor } => {
                let q = p - centre;
                DVec2::new(DVec2::new(q.x, q.y).length() - major, q.z).length() - minor
            }
            Self::Capsule { ends: [a, b], radius } => {
                let along = ((p - a).dot(b - a) / (b - a).length_squared().max(1e-300)).clamp(0.0, 1.0);
                (p - (a + (b - a) * along)).length() - radius
            }
            Self::Union { parts, blend } => {
                parts.iter().map(|part| part.distance(p)).fold(f64::INFINITY, |a, b| smooth_min(a, b, *blend))
            }
        }
    }

    /// Outward unit normal at a surface point, by central differences over `1e-5 * radius`.
    pub fn normal(&self, p: DVec3) -> DVec3 {
        let h = 1e-5 * self.radius();
        let slope = |axis: DVec3| self.distance(p + axis * h) - self.distance(p - axis * h);
        DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z)).normalize_or(DVec3::Z)
    }

    /// Radius about the origin that holds the whole solid.
    pub fn radius(&self) -> f64 {
        match self {
            Self::Sphere { centre, radius } => centre.length() + radius,
            Self::RoundedBox { centre, half, .. } => centre.length() + half.length(),
            Self::Torus { centre, major, minor } => centre.length() + major + minor,
            Self::Capsule { ends, radius } => ends[0].length().max(ends[1].length()) + radius,
            // A fillet swells the union by at most a quarter of its width per seam.
            Self::Union { parts, blend } => {
                parts.iter().map(Self::radius).fold(0.0, f64::max) + 0.25 * blend * parts.len() as f64
            }
        }
    }
}

/// Quadratic smooth minimum; 1-Lipschitz in both arguments, never above their minimum.
fn smooth_min(a: f64, b: f64, width: f64) -> f64 {
    if width <= 0.0 || !a.is_finite() {
        return a.min(b);
    }
    let overlap = (width - (a - b).abs()).max(0.0) / width;
    a.min(b) - 0.25 * overlap * overlap * width
}
