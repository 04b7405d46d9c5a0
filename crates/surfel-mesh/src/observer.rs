//! A depth map made ready for lookups from the voxel grid.
//!
//! Depths are stored inverted and in voxels: inverse depth is affine in the pixel for any plane, so bilinear
//! interpolation reproduces planes exactly. Invariant: stored inverse depths are finite and >= 0, 0 = none.

use crate::{DepthView, TsdfConfig, lattice::Lattice};
use glam::{DMat3, DVec3};
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
    /// Largest ratio of depths within a 2x2 cell that is still one surface.
    max_ratio: f32,
}

/// A depth lookup.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// z-depth, voxels.
    pub depth: f32,
    /// Confidence of the nearest pixel.
    pub weight: f32,
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
        let inverse_depth = (0..view.depth.len())
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
        let observer = Self {
            rotation: pose.rotation,
            translation,
            focal: [camera.intrinsics.fx as f32, camera.intrinsics.fy as f32],
            principal: [principal.x as f32, principal.y as f32],
            width: camera.width,
            height: camera.height,
            inverse_depth,
            weight: view.weight,
            colour: view.colour,
            max_ratio: 1.0 + config.max_depth_jump as f32,
        };
        (observer, num_cut)
    }

    /// z-depth of a pixel in voxels, if it has one.
    pub fn pixel_depth(&self, x: usize, y: usize) -> Option<f64> {
        let inverse = self.inverse_depth[y * self.width + x];
        (inverse > 0.0).then(|| 1.0 / f64::from(inverse))
    }

    /// True when two depths belong to one surface.
    pub fn same_surface(&self, a: f64, b: f64) -> bool {
        a.max(b) <= a.min(b) * f64::from(self.max_ratio)
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
        (inverse > 0.0).then(|| Sample { depth: 1.0 / inverse, weight })
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
            let [a, b, c, d] = self.square(corner);
            let (low, high) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
            if low > 0.0 && high <= low * self.max_ratio {
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
        let (x, y) = (pixel % self.width, pixel / self.width);
        let rise = |inside: bool, neighbour: usize| {
            let there = if inside { self.inverse_depth[neighbour] } else { 0.0 };
            let same = there > 0.0 && there.max(here) <= there.min(here) * self.max_ratio;
            same.then_some(there - here)
        };
        let slope = |before: Option<f32>, after: Option<f32>| match (before, after) {
            (Some(before), Some(after)) => (after - before) / 2.0,
            (None, Some(after)) => after,
            (Some(before), None) => -before,
            (None, None) => 0.0,
        };
        let across = slope(rise(x > 0, pixel.wrapping_sub(1)), rise(x + 1 < self.width, pixel + 1));
        let down = slope(rise(y > 0, pixel.wrapping_sub(self.width)), rise(y + 1 < self.height, pixel + self.width));
        here + across * du + down * dv
    }
}

#[inline]
fn bilinear([a, b, c, d]: [f32; 4], [fx, fy]: [f32; 2]) -> f32 {
    let (top, bottom) = (a + (b - a) * fx, c + (d - c) * fx);
    top + (bottom - top) * fy
}
