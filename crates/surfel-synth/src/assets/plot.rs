//! The ground of one building: a rectangle, and what lies clear of it.
//!
//! Millimetres. Invariant: seen from before the front, the corner is on its left and the building behind it.

use glam::DVec2;

/// Where a building stands, millimetres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plot {
    /// Left end of the front as seen from before it, world frame.
    pub corner: DVec2,
    /// Direction of the front from left to right, radians from +X.
    pub heading: f64,
    /// Along the front.
    pub width: f64,
    /// Away from the front.
    pub depth: f64,
}

impl Plot {
    /// Directions to the right and into the building, world frame.
    fn axes(&self) -> [DVec2; 2] {
        let right = DVec2::from_angle(self.heading);
        [right, right.perp()]
    }

    /// A point in the plane of the ground, by its distance along the front and into the building.
    pub fn at(&self, along: f64, into: f64) -> DVec2 {
        let [right, inwards] = self.axes();
        self.corner + right * along + inwards * into
    }

    /// True when a point of the ground is at least `margin` outside.
    pub fn is_clear_of(&self, point: DVec2, margin: f64) -> bool {
        let [along, into] = self.axes().map(|axis| axis.dot(point - self.corner));
        along < -margin || along > self.width + margin || into < -margin || into > self.depth + margin
    }
}
