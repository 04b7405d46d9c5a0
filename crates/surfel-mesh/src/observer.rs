//! A depth map made ready for lookups from the voxel grid.
//!
//! Depths are stored inverted and in voxels: inverse depth is affine in the pixel for any plane, so bilinear
//! interpolation reproduces planes exactly. Invariant: stored inverse depths are finite and >= 0, 0 = none; a pixel
//! without depth joins no neighbour.

use crate::{DepthView, TsdfConfig, continuity::Continuity, lattice::Lattice};
use glam::{DMat3, DVec3, Vec3};
use surfel_core::Grid;

/// A view in the units and origin of the lattice.
#[derive(Clone, Debug)]
pub(crate) struct Observer<'a> {
    /// Camera from offset (see [`Lattice`]): rotation.
    pub rotation: DMat3,
    /// Camera from offset: translation, voxels.
    pub translation: DVec3,
    /// Focal lengths, pixels.
    pub focal: [f32; 2],
    /// Principal point in index coordinates, pixels.
    pub principal: [f32; 2],
    pub width: usize,
    pub height: usize,
    inverse_depth: Vec<f32>,
    weight: Option<&'a Grid<f32>>,
    colour: &'a Grid<[f32; 3]>,
    /// Per pixel whether it and its neighbour to the right, below, are one surface.
    joins: Vec<[bool; 2]>,
    /// Per pixel the factor from distance along z to what the field holds, see [`Observer::shrink_of`].
    shrink: Vec<f32>,
}

/// Smallest cosine between line of sight and normal that [`Observer::shrink_of`] tells apart: 87 degrees.
const LEAST_COSINE: f32 = 0.05;

/// A depth lookup.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// z-depth, voxels.
    pub depth: f32,
    /// Confidence of the nearest pixel.
    pub weight: f32,
    /// Of the nearest pixel: what a distance along z counts in the field, at most 1.
    pub shrink: f32,
}

/// How to interpolate at an image position.
enum Cell {
    /// The 2x2 cell from this pixel on is one surface; the position inside it.
    Smooth(usize, [f32; 2]),
    /// It is not: the nearest pixel, with the position relative to it.
    Edge(usize, [f32; 2]),
}

impl<'a> Observer<'a> {
    /// Prepares a checked view; also gives the number of pixels with depth that were cut because they are
    /// wider than [`TsdfConfig::MAX_FOOTPRINT`] voxels.
    pub fn new(view: &DepthView<'a>, lattice: &Lattice, config: &TsdfConfig) -> (Self, usize) {
        let camera = view.camera;
        let pose = &camera.camera_from_world;
        let translation = pose.transform(lattice.origin) / lattice.voxel;
        let centre = -(pose.rotation.transpose() * translation);
        let focal = camera.intrinsics.mean_focal();
        let mut num_cut = 0;
        let inverse_depth: Vec<f32> = (0..view.depth.len())
            .map(|index| {
                let Some(depth) = view.depth_at(index) else {
                    return 0.0;
                };
                let depth = depth / lattice.voxel;
                // Distance to the grid origin is at most this; a bound is enough to judge the footprint.
                let spacing = lattice.spacing(DVec3::X * (depth + centre.length()));
                let inverse = (1.0 / depth) as f32;
                if depth / focal > TsdfConfig::MAX_FOOTPRINT * spacing || !inverse.is_finite() {
                    num_cut += 1;
                    return 0.0;
                }
                inverse
            })
            .collect();
        let principal = camera.intrinsics.principal_index();
        let mut observer = Self {
            rotation: pose.rotation,
            translation,
            focal: [camera.intrinsics.fx as f32, camera.intrinsics.fy as f32],
            principal: [principal.x as f32, principal.y as f32],
            width: camera.width,
            height: camera.height,
            inverse_depth,
            weight: view.weight,
            colour: view.colour,
            joins: Vec::new(),
            shrink: Vec::new(),
        };
        let continuity = Continuity::new(config.max_depth_jump, focal);
        observer.joins = observer.pixels().map(|(x, y)| observer.joins_of(x, y, continuity)).collect();
        let truncation = (config.truncation / config.voxel) as f32;
        observer.shrink = observer.pixels().map(|(x, y)| observer.shrink_of(x, y, truncation)).collect();
        (observer, num_cut)
    }

    /// z-depth of a pixel in voxels, if it has one.
    pub fn pixel_depth(&self, x: usize, y: usize) -> Option<f64> {
        let inverse = self.inverse_depth[y * self.width + x];
        (inverse > 0.0).then(|| 1.0 / f64::from(inverse))
    }

    fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let width = self.width;
        (0..width * self.height).map(move |index| (index % width, index / width))
    }

    fn joins_of(&self, x: usize, y: usize, continuity: Continuity) -> [bool; 2] {
        let along = |[before, after]: [bool; 2], step: usize| {
            let inverse = |pixel: usize| f64::from(self.inverse_depth[pixel]);
            let pixel = y * self.width + x;
            let beside = || {
                [if before { inverse(pixel - step) } else { 0.0 }, if after { inverse(pixel + 2 * step) } else { 0.0 }]
            };
            continuity.joins(inverse(pixel), inverse(pixel + step), beside)
        };
        let (right, below) = (x + 1 < self.width, y + 1 < self.height);
        [right && along([x > 0, x + 2 < self.width], 1), below && along([y > 0, y + 2 < self.height], self.width)]
    }

    /// Rises of inverse depth from a pixel to those of its neighbours before and after it that are on its surface; along
    /// x, then along y.
    pub fn rises(&self, x: usize, y: usize) -> [[Option<f32>; 2]; 2] {
        let pixel = y * self.width + x;
        let rise = |there: usize| self.inverse_depth[there] - self.inverse_depth[pixel];
        let along = |axis: usize, place: usize, step: usize| {
            let before = place > 0 && self.joins[pixel - step][axis];
            [before.then(|| rise(pixel - step)), self.joins[pixel][axis].then(|| rise(pixel + step))]
        };
        [along(0, x, 1), along(1, y, self.width)]
    }

    /// What a distance along z counts in the field: 1 on most surfaces, less on those that are seen at a grazing angle.
    ///
    /// The band of `truncation` voxels along z is `truncation * cosine` thick across the surface, and marching cubes needs
    /// the diagonal of a voxel. Counting less along z makes the band longer there, so that across it has its diagonal.
    fn shrink_of(&self, x: usize, y: usize, truncation: f32) -> f32 {
        let here = self.inverse_depth[y * self.width + x];
        let [Some(across), Some(down)] = self.rises(x, y).map(slope_of) else { return 1.0 };
        let ([fx, fy], [cx, cy]) = (self.focal, self.principal);
        // Normal over distance to the origin of the plane whose inverse depth is affine with these slopes.
        let normal = Vec3::new(fx * across, fy * down, here - across * (x as f32 - cx) - down * (y as f32 - cy));
        let cosine = (here / normal.length()).max(LEAST_COSINE);
        (cosine * truncation / 3.0_f32.sqrt()).min(1.0)
    }

    /// Of a pixel, see [`Self::shrink_of`].
    pub fn shrink(&self, x: usize, y: usize) -> f32 {
        self.shrink[y * self.width + x]
    }

    /// Image position (index coordinates) and z-depth (voxels) of an offset in front of the camera.
    pub fn project(&self, offset: DVec3) -> Option<([f32; 2], f32)> {
        let p = self.rotation * offset + self.translation;
        let position = |axis: usize| (f64::from(self.focal[axis]) * p[axis] / p.z) as f32 + self.principal[axis];
        (p.z > 0.0).then(|| ([position(0), position(1)], p.z as f32))
    }

    /// Depth at an image position (index coordinates): bilinear in inverse depth within one surface, else on
    /// the tangent plane of the nearest pixel; `None` outside the image or where that pixel has none.
    #[inline]
    pub fn sample(&self, u: f32, v: f32) -> Option<Sample> {
        let (nearest, cell) = self.cell(u, v)?;
        let inverse = match cell {
            Cell::Smooth(corner, at) => bilinear(self.square(corner), at),
            Cell::Edge(pixel, at) => self.on_tangent_plane(pixel, at),
        };
        let weight = self.weight.map_or(1.0, |w| w.as_slice()[nearest]);
        (inverse > 0.0).then(|| Sample { depth: 1.0 / inverse, weight, shrink: self.shrink[nearest] })
    }

    /// Colour at an image position, bilinear within one surface, else that of the nearest pixel; `None`
    /// outside the image or where the photograph is not finite.
    pub fn colour(&self, u: f32, v: f32) -> Option<[f32; 3]> {
        let pixels = self.colour.as_slice();
        let colour = match self.cell(u, v)?.1 {
            Cell::Smooth(corner, at) => {
                let [top, bottom] = [&pixels[corner..][..2], &pixels[corner + self.width..][..2]];
                std::array::from_fn(|i| bilinear([top[0][i], top[1][i], bottom[0][i], bottom[1][i]], at))
            }
            Cell::Edge(pixel, _) => pixels[pixel],
        };
        colour.iter().all(|c| c.is_finite()).then_some(colour)
    }

    /// Nearest pixel and cell of an image position; `None` outside the image.
    #[inline]
    fn cell(&self, u: f32, v: f32) -> Option<(usize, Cell)> {
        let (width, height) = (self.width as f32, self.height as f32);
        let inside = u >= -0.5 && v >= -0.5 && u < width - 0.5 && v < height - 0.5;
        if !inside {
            return None;
        }
        let (x, y) = ((u + 0.5) as usize, (v + 0.5) as usize);
        let nearest = y * self.width + x;
        if u >= 0.0 && v >= 0.0 && u < width - 1.0 && v < height - 1.0 {
            let (left, top) = (u as usize, v as usize);
            let corner = top * self.width + left;
            let below = corner + self.width;
            let ([right, down], [right_below, _]) = (self.joins[corner], self.joins[below]);
            if right && down && right_below && self.joins[corner + 1][1] {
                return Some((nearest, Cell::Smooth(corner, [u - left as f32, v - top as f32])));
            }
        }
        Some((nearest, Cell::Edge(nearest, [u - x as f32, v - y as f32])))
    }

    /// Inverse depth of a pixel and the 2x2 cell it starts.
    #[inline]
    fn square(&self, corner: usize) -> [f32; 4] {
        let [top, bottom] = [&self.inverse_depth[corner..][..2], &self.inverse_depth[corner + self.width..][..2]];
        [top[0], top[1], bottom[0], bottom[1]]
    }

    /// Inverse depth beside a pixel, by the slope to those neighbours that are on its surface.
    fn on_tangent_plane(&self, pixel: usize, [du, dv]: [f32; 2]) -> f32 {
        let here = self.inverse_depth[pixel];
        if here <= 0.0 {
            return 0.0;
        }
        let [across, down] =
            self.rises(pixel % self.width, pixel / self.width).map(|rises| slope_of(rises).unwrap_or(0.0));
        here + across * du + down * dv
    }
}

/// Slope per pixel from the rises to the neighbours before and after, those that there are.
fn slope_of(rises: [Option<f32>; 2]) -> Option<f32> {
    match rises {
        [Some(before), Some(after)] => Some((after - before) / 2.0),
        [None, Some(after)] => Some(after),
        [Some(before), None] => Some(-before),
        [None, None] => None,
    }
}

#[inline]
fn bilinear([a, b, c, d]: [f32; 4], [fx, fy]: [f32; 2]) -> f32 {
    let (top, bottom) = (a + (b - a) * fx, c + (d - c) * fx);
    top + (bottom - top) * fy
}
