//! Where the voxel centres stand in the world.
//!
//! Voxel `(i, j, k)` is the grid point `(i, j, k)`; within [`Lattice::uniform_radius`] of the origin (the mean
//! camera centre) the grid is an ordinary cubic lattice. Beyond, radial distance is compressed
//! logarithmically, so that voxels grow in proportion to distance as the footprint of a pixel does, and a
//! scene from 1 to 100 costs as many voxels as it has pixels. Invariant: lengths only enter divided by the
//! voxel edge, so a scene in other units gets the same grid.

use glam::DVec3;

/// The map between grid coordinates (voxel indices), *offsets* (world axes, from the origin, in units of the
/// voxel edge) and the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lattice {
    /// World position of voxel (0, 0, 0), scene units.
    pub origin: DVec3,
    /// Voxel edge near the origin, scene units.
    pub voxel: f64,
    /// Radius of the cubic part, in voxels; infinite for a cubic lattice everywhere.
    pub uniform_radius: f64,
}

impl Lattice {
    /// Offset of a grid point.
    pub fn offset_from_grid(&self, grid: DVec3) -> DVec3 {
        let radius = grid.length();
        if radius <= self.uniform_radius {
            return grid;
        }
        grid * ((radius / self.uniform_radius - 1.0).exp() * self.uniform_radius / radius)
    }

    /// Grid point of an offset; inverse of [`Self::offset_from_grid`].
    pub fn grid_from_offset(&self, offset: DVec3) -> DVec3 {
        let distance = offset.length();
        if distance <= self.uniform_radius {
            return offset;
        }
        offset * (self.uniform_radius * (1.0 + (distance / self.uniform_radius).ln()) / distance)
    }

    /// Radial distance between voxels at an offset, in units of the voxel edge (1 in the cubic part).
    pub fn spacing(&self, offset: DVec3) -> f64 {
        (offset.length() / self.uniform_radius).max(1.0)
    }

    /// World position of an offset.
    pub fn world_from_offset(&self, offset: DVec3) -> DVec3 {
        self.origin + offset * self.voxel
    }

    /// Unit world direction of a field gradient taken along the grid axes at `grid`.
    pub fn world_gradient(&self, grid: DVec3, gradient: DVec3) -> Option<DVec3> {
        let stretch = grid.length() / self.uniform_radius;
        let gradient = if stretch <= 1.0 {
            gradient
        } else {
            // Transpose of d grid / d offset: radially R/r, tangentially (R/r) * stretch.
            let radial = gradient.project_onto(grid);
            radial + (gradient - radial) * stretch
        };
        gradient.try_normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LATTICE: Lattice = Lattice { origin: DVec3::new(3.0, 1.0, -2.0), voxel: 0.5, uniform_radius: 20.0 };

    #[test]
    fn warp_is_continuous_and_undone() {
        for scale in [0.1, 0.999, 1.001, 3.0, 50.0] {
            let offset = DVec3::new(12.0, -16.0, 0.0) * scale;
            let back = LATTICE.offset_from_grid(LATTICE.grid_from_offset(offset));
            assert!((back - offset).length() < 1e-9 * offset.length(), "{offset} came back as {back}");
        }
        let (inside, outside) = (DVec3::X * 19.999_999, DVec3::X * 20.000_001);
        assert!((LATTICE.grid_from_offset(outside) - LATTICE.grid_from_offset(inside)).length() < 3e-6);
    }

    #[test]
    fn gradient_of_a_plane_is_its_normal_in_the_compressed_part() {
        let normal = DVec3::new(0.3, -0.8, 0.52).normalize();
        let field = |grid: DVec3| normal.dot(LATTICE.offset_from_grid(grid));
        let grid = LATTICE.grid_from_offset(DVec3::new(70.0, 110.0, -40.0));
        let step = 1e-4;
        let gradient = DVec3::from_array(DVec3::AXES.map(|a| field(grid + a * step) - field(grid - a * step)));
        assert!((LATTICE.world_gradient(grid, gradient).unwrap() - normal).length() < 1e-6);
    }
}
