//! A block of the field with a rim from its 26 neighbours, so that marching cubes and gradients read one
//! small dense array.
//!
//! Invariant: local voxel `(x, y, z)` is readable for -1 <= x, y, z <= 9; `NaN` where unobserved.

use crate::{
    Tsdf,
    allocate::{BLOCK, BLOCK_VOXELS},
};
use glam::IVec3;

/// Voxels along the padded edge: one before the block and two after it.
const SIDE: usize = BLOCK as usize + 3;

/// The padded copy of one block.
pub(crate) struct Neighbourhood {
    values: [f32; SIDE * SIDE * SIDE],
    /// Index of each neighbouring block, see [`Self::neighbour`].
    pub neighbours: [Option<usize>; 27],
}

impl Neighbourhood {
    /// Position in `neighbours` of the block `step` blocks away, each component -1, 0 or 1.
    pub fn neighbour(step: IVec3) -> usize {
        (((step.z + 1) * 3 + step.y + 1) * 3 + step.x + 1) as usize
    }

    /// Copies a block and its rim; `None` when the field cannot cross zero there.
    pub fn gather(tsdf: &Tsdf<'_>, block: usize) -> Option<Self> {
        let mut neighbours = [None; 27];
        let (mut any_inside, mut any_outside) = (false, false);
        for dz in -1..=1 {
            for dy in -1..=1 {
                for dx in -1..=1 {
                    let step = IVec3::new(dx, dy, dz);
                    let neighbour = tsdf.block_index(tsdf.blocks[block] + step);
                    neighbours[Self::neighbour(step)] = neighbour;
                    if let Some(neighbour) = neighbour {
                        any_inside |= tsdf.signs[neighbour].any_inside;
                        any_outside |= tsdf.signs[neighbour].any_outside;
                    }
                }
            }
        }
        if !(any_inside && any_outside) {
            return None;
        }
        let mut values = [f32::NAN; SIDE * SIDE * SIDE];
        for z in -1..=BLOCK + 1 {
            for y in -1..=BLOCK + 1 {
                let row = ((z + 1) as usize * SIDE + (y + 1) as usize) * SIDE;
                let start = (z.rem_euclid(BLOCK) * BLOCK + y.rem_euclid(BLOCK)) as usize * BLOCK as usize;
                for (dx, from, to) in
                    [(-1, BLOCK as usize - 1..BLOCK as usize, 0), (0, 0..BLOCK as usize, 1), (1, 0..2, SIDE - 2)]
                {
                    let step = IVec3::new(dx, y.div_euclid(BLOCK), z.div_euclid(BLOCK));
                    if let Some(source) = neighbours[Self::neighbour(step)] {
                        let source = &tsdf.field[source * BLOCK_VOXELS + start..][from];
                        values[row + to..][..source.len()].copy_from_slice(source);
                    }
                }
            }
        }
        Some(Self { values, neighbours })
    }

    /// Value at a local voxel.
    pub fn at(&self, voxel: IVec3) -> f32 {
        self.values[Self::index(voxel)]
    }

    /// Values at the corners of the cube that starts at a local voxel, in corner order.
    #[inline]
    pub fn cube(&self, voxel: IVec3) -> [f32; 8] {
        let base = Self::index(voxel);
        let values = &self.values[base..][..SIDE * SIDE + SIDE + 2];
        let pair = |start: usize| [values[start], values[start + 1]];
        let ([a, b], [c, d]) = (pair(0), pair(SIDE));
        let ([e, f], [g, h]) = (pair(SIDE * SIDE), pair(SIDE * SIDE + SIDE));
        [a, b, c, d, e, f, g, h]
    }

    #[inline]
    fn index(voxel: IVec3) -> usize {
        ((voxel.z + 1) as usize * SIDE + (voxel.y + 1) as usize) * SIDE + (voxel.x + 1) as usize
    }
}
