//! The truncated signed distance field: one number per voxel, fused from all depth maps (spec 6.2).
//!
//! Sits between the depth maps and marching cubes. The field is the weighted mean over views of
//! `depth(pixel) - z` in local voxels, clipped at `+truncation`; a view says nothing about voxels more than
//! `truncation` behind its surface, and counts voxels in front of it as free. On surfaces seen at a grazing angle the
//! distance counts for less, so that the band stays thick enough across them ([`Observer`]). Invariant: `NaN` exactly
//! where no view has spoken.

use crate::{
    DepthView, MeshError,
    allocate::{BLOCK, BLOCK_VOXELS, order, touched_blocks},
    lattice::Lattice,
    observer::Observer,
};
use glam::{DVec3, IVec3, Vec3};
use rayon::prelude::*;

/// Resolution of the field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TsdfConfig {
    /// Voxel edge near the cameras, scene units.
    pub voxel: f64,
    /// Depth behind a surface up to which a view speaks, scene units; grows with the voxels.
    pub truncation: f64,
    /// Distance from the mean camera centre up to which all voxels have edge `voxel`, scene units; beyond,
    /// they grow in proportion to distance. Infinite: never.
    pub uniform_radius: f64,
    /// Neighbouring depths that differ by more than this fraction, from each other and from a plane, are not
    /// interpolated.
    pub max_depth_jump: f64,
    /// Upper limit of the voxels' memory, bytes.
    pub max_bytes: usize,
}

impl TsdfConfig {
    /// Truncation in voxels: the upper end of spec 6.2, so that surfaces up to 70 degrees from fronto-parallel keep all
    /// corners of a crossed cube inside the band; for steeper ones the band grows.
    pub const TRUNCATION_VOXELS: f64 = 5.0;

    /// Pixels wider than this many voxels carry no detail a voxel could hold; they are cut and counted.
    pub const MAX_FOOTPRINT: f64 = 32.0;

    /// Memory limit unless told otherwise: 2 GiB, about a million blocks of 8x8x8 voxels.
    pub const MAX_BYTES: usize = 2 << 30;

    /// Cubic voxels of edge `voxel` (scene units) everywhere; truncation of five voxels.
    pub fn uniform(voxel: f64) -> Self {
        Self {
            voxel,
            truncation: Self::TRUNCATION_VOXELS * voxel,
            uniform_radius: f64::INFINITY,
            max_depth_jump: 0.02,
            max_bytes: Self::MAX_BYTES,
        }
    }

    /// The automatic choice: the voxel edge is the median over all valid pixels of `depth / focal`, the width
    /// of a pixel on the surface; voxels start to grow at 1.5 times the median distance from the mean
    /// camera centre: beyond an object, before a background. `None` when no pixel has depth.
    pub fn from_pixel_footprint(views: &[DepthView<'_>]) -> Option<Self> {
        let centre = mean_centre(views);
        let (mut footprints, mut distances) = (Vec::new(), Vec::new());
        for view in views {
            let focal = view.camera.intrinsics.mean_focal();
            let to_centre = (view.camera.centre() - centre).length();
            for depth in (0..view.depth.len()).filter_map(|index| view.depth_at(index)) {
                footprints.push(depth / focal);
                distances.push(depth + to_centre);
            }
        }
        let voxel = median(&mut footprints)?;
        Some(Self { uniform_radius: 1.5 * median(&mut distances)?, ..Self::uniform(voxel) })
    }

    fn check(&self) -> Result<(), MeshError> {
        let positive = |name, value: f64| {
            let usable = value > 0.0 && (value.is_finite() || name == "the uniform radius");
            if usable { Ok(()) } else { Err(MeshError::BadLength { name, value }) }
        };
        positive("the voxel edge", self.voxel)?;
        positive("the truncation", self.truncation)?;
        positive("the uniform radius", self.uniform_radius)?;
        positive("the largest depth jump", self.max_depth_jump)
    }
}

/// A fused field on sparse blocks of 8x8x8 voxels; borrows the views to colour the mesh.
#[derive(Clone, Debug)]
pub struct Tsdf<'a> {
    pub(crate) lattice: Lattice,
    /// Truncation in local voxels.
    pub(crate) truncation: f32,
    pub(crate) observers: Vec<Observer<'a>>,
    /// Sorted by [`order`].
    pub(crate) blocks: Vec<IVec3>,
    /// `BLOCK_VOXELS` values per block, x fastest.
    pub(crate) field: Vec<f32>,
    /// One entry per block.
    pub(crate) signs: Vec<Signs>,
    num_cut_pixels: usize,
}

/// Which signs occur in a block, to pass over blocks that cannot hold surface.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Signs {
    /// Some value is negative.
    pub any_inside: bool,
    /// Some value is zero or positive.
    pub any_outside: bool,
}

impl Tsdf<'_> {
    /// Number of allocated blocks of 8x8x8 voxels.
    pub fn num_blocks(&self) -> usize {
        self.blocks.len()
    }

    /// Bytes held by the field.
    pub fn num_bytes(&self) -> usize {
        size_of_val(self.field.as_slice())
    }

    /// Pixels left out because they were wider than [`TsdfConfig::MAX_FOOTPRINT`] voxels.
    pub fn num_cut_pixels(&self) -> usize {
        self.num_cut_pixels
    }

    /// Field value at a voxel, in local voxels, positive towards the cameras; `None` where unobserved.
    pub fn value(&self, voxel: IVec3) -> Option<f32> {
        let block = self.block_index(voxel.div_euclid(IVec3::splat(BLOCK)))?;
        let local = voxel.rem_euclid(IVec3::splat(BLOCK));
        let index = (local.z * BLOCK + local.y) * BLOCK + local.x;
        Some(self.field[block * BLOCK_VOXELS + index as usize]).filter(|value| !value.is_nan())
    }

    /// True when the voxel lies in an allocated block, observed or not.
    pub fn is_allocated(&self, voxel: IVec3) -> bool {
        self.block_index(voxel.div_euclid(IVec3::splat(BLOCK))).is_some()
    }

    /// World position of a voxel, scene units.
    pub fn position(&self, voxel: IVec3) -> DVec3 {
        self.lattice.world_from_offset(self.lattice.offset_from_grid(voxel.as_dvec3()))
    }

    /// First and one past the last voxel of the allocated blocks, per axis.
    pub fn bounds(&self) -> Option<(IVec3, IVec3)> {
        let low = self.blocks.iter().copied().reduce(IVec3::min)?;
        let high = self.blocks.iter().copied().reduce(IVec3::max)?;
        Some((low * BLOCK, (high + 1) * BLOCK))
    }

    pub(crate) fn block_index(&self, block: IVec3) -> Option<usize> {
        self.blocks.binary_search_by_key(&order(&block), order).ok()
    }
}

/// Fuses depth maps into a signed distance field.
///
/// # Errors
/// [`MeshError`] for an empty list, grids that do not fit their camera, unusable settings, no depth at all,
/// or a volume above `config.max_bytes` (found out before it is allocated).
pub fn fuse<'a>(views: &[DepthView<'a>], config: &TsdfConfig) -> Result<Tsdf<'a>, MeshError> {
    config.check()?;
    if views.is_empty() {
        return Err(MeshError::NoViews);
    }
    for (index, view) in views.iter().enumerate() {
        view.check(index)?;
    }
    let lattice = lattice_of(views, config);
    let (observers, cut): (Vec<_>, Vec<_>) = views.par_iter().map(|view| Observer::new(view, &lattice, config)).unzip();
    let blocks = touched_blocks(&observers, &lattice, config)?;
    if blocks.is_empty() {
        return Err(MeshError::NoDepth { num_views: views.len() });
    }
    let truncation = (config.truncation / config.voxel) as f32;
    let mut field = vec![f32::NAN; blocks.len() * BLOCK_VOXELS];
    let signs = field
        .par_chunks_exact_mut(BLOCK_VOXELS)
        .zip(&blocks)
        .map(|(field, block)| integrate(field, *block, &observers, &lattice, truncation))
        .collect();
    Ok(Tsdf { lattice, truncation, observers, blocks, field, signs, num_cut_pixels: cut.iter().sum() })
}

/// The grid of a set of views: origin at the mean camera centre, a choice free of the unit.
pub(crate) fn lattice_of(views: &[DepthView<'_>], config: &TsdfConfig) -> Lattice {
    Lattice { origin: mean_centre(views), voxel: config.voxel, uniform_radius: config.uniform_radius / config.voxel }
}

fn mean_centre(views: &[DepthView<'_>]) -> DVec3 {
    views.iter().map(|view| view.camera.centre()).sum::<DVec3>() / views.len().max(1) as f64
}

fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Weighted sums of a block under construction.
struct Sums {
    distance: [f32; BLOCK_VOXELS],
    weight: [f32; BLOCK_VOXELS],
}

impl Sums {
    #[inline]
    fn add(&mut self, index: usize, distance: f32, weight: f32, truncation: f32) {
        if distance >= -truncation {
            self.distance[index] += weight * distance.min(truncation);
            self.weight[index] += weight;
        }
    }
}

fn integrate(field: &mut [f32], block: IVec3, observers: &[Observer<'_>], lattice: &Lattice, truncation: f32) -> Signs {
    let mut sums = Sums { distance: [0.0; BLOCK_VOXELS], weight: [0.0; BLOCK_VOXELS] };
    let first = (block * BLOCK).as_dvec3();
    let last = first.abs().max((first + f64::from(BLOCK - 1)).abs());
    let cubic = last.length() <= lattice.uniform_radius;
    for observer in observers {
        if cubic {
            integrate_cubic(&mut sums, first, observer, truncation);
        } else {
            integrate_compressed(&mut sums, first, observer, lattice, truncation);
        }
    }
    let mut signs = Signs::default();
    for (value, (distance, weight)) in field.iter_mut().zip(sums.distance.iter().zip(&sums.weight)) {
        if *weight > 0.0 {
            *value = distance / weight;
            signs.any_inside |= *value < 0.0;
            signs.any_outside |= *value >= 0.0;
        }
    }
    signs
}

/// Camera coordinates advance by constant steps, so only the block's corner needs double precision.
fn integrate_cubic(sums: &mut Sums, first: DVec3, observer: &Observer<'_>, truncation: f32) {
    let corner = (observer.rotation * first + observer.translation).as_vec3();
    let [step_x, step_y, step_z] = [0, 1, 2].map(|axis| observer.rotation.col(axis).as_vec3());
    let ([fx, fy], [cx, cy]) = (observer.focal, observer.principal);
    for row in 0..BLOCK * BLOCK {
        let start = corner + step_y * (row % BLOCK) as f32 + step_z * (row / BLOCK) as f32;
        let points: [Vec3; BLOCK as usize] = std::array::from_fn(|x| start + step_x * x as f32);
        let scale = points.map(|p| 1.0 / p.z);
        for (x, (p, scale)) in points.iter().zip(scale).enumerate() {
            if p.z <= 0.0 {
                continue;
            }
            if let Some(sample) = observer.sample(fx * p.x * scale + cx, fy * p.y * scale + cy) {
                let index = row as usize * BLOCK as usize + x;
                sums.add(index, (sample.depth - p.z) * sample.shrink, sample.weight, truncation);
            }
        }
    }
}

fn integrate_compressed(sums: &mut Sums, first: DVec3, observer: &Observer<'_>, lattice: &Lattice, truncation: f32) {
    for index in 0..BLOCK_VOXELS {
        let local = IVec3::new(index as i32 % BLOCK, index as i32 / BLOCK % BLOCK, index as i32 / (BLOCK * BLOCK));
        let offset = lattice.offset_from_grid(first + local.as_dvec3());
        let Some(([u, v], z)) = observer.project(offset) else {
            continue;
        };
        if let Some(sample) = observer.sample(u, v) {
            let distance = (sample.depth - z) * sample.shrink / lattice.spacing(offset) as f32;
            sums.add(index, distance, sample.weight, truncation);
        }
    }
}
