//! Where the epipolar lines of a map's pixels run in its neighbours, sampled at candidates of depth.
//!
//! The geometry of the operator `epipolar_attention`. Invariant: a landing lies inside the neighbour's map and in front
//! of its camera; what does not is left out, not moved to the border.

use super::plane_sweep::{MIN_DEPTH_RATIO, Warp};

/// The lines of all pixels of all views.
#[derive(Clone, Debug, PartialEq)]
pub struct EpipolarLines {
    /// Columns of the feature maps.
    pub width: usize,
    /// Rows of the feature maps.
    pub height: usize,
    /// For each view, where its pixels land in each of its neighbours.
    pub warps: Vec<Vec<Warp>>,
    /// For each view, inverse z-depths at which its rays are sampled, 1 / scene units; equally many for all.
    pub disparities: Vec<Vec<f32>>,
}

/// One sample of a line: between four pixels of the neighbour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landing {
    /// Index of the candidate of depth.
    pub candidate: usize,
    /// The pixels, view-major over the scene; one may appear twice at the border, once with weight 0.
    pub pixels: [usize; 4],
    /// Their bilinear weights, which sum to 1.
    pub weights: [f32; 4],
}

impl EpipolarLines {
    /// Number of views.
    pub fn num_views(&self) -> usize {
        self.warps.len()
    }

    /// Pixels of one view.
    pub fn num_pixels(&self) -> usize {
        self.width * self.height
    }

    /// Candidates of depth of each pixel.
    pub fn num_candidates(&self) -> usize {
        self.disparities.first().map_or(0, Vec::len)
    }

    /// Lists the landings of a pixel (view-major over the scene) in all neighbours of its view, far to near in each.
    /// Listed rather than visited: vector code inside a callback would not be compiled for the machine's vectors.
    pub fn landings(&self, pixel: usize, landings: &mut Vec<Landing>) {
        landings.clear();
        let view = pixel / self.num_pixels();
        for slot in 0..self.warps[view].len() {
            self.append_landings(pixel, slot, landings);
        }
    }

    /// Appends those in one neighbour.
    pub(super) fn append_landings(&self, pixel: usize, slot: usize, landings: &mut Vec<Landing>) {
        let (view, local) = (pixel / self.num_pixels(), pixel % self.num_pixels());
        let (x, y) = ((local % self.width) as f32, (local / self.width) as f32);
        let warp = &self.warps[view][slot];
        let far: [f32; 3] = warp.rotation.map(|row| row[0] * x + row[1] * y + row[2]);
        for (candidate, disparity) in self.disparities[view].iter().enumerate() {
            let q: [f32; 3] = std::array::from_fn(|i| far[i] + disparity * warp.translation[i]);
            if q[2] > MIN_DEPTH_RATIO {
                landings.extend(self.landing(candidate, warp.other, q[0] / q[2], q[1] / q[2]));
            }
        }
    }

    fn landing(&self, candidate: usize, view: usize, x: f32, y: f32) -> Option<Landing> {
        let (last_x, last_y) = ((self.width - 1) as f32, (self.height - 1) as f32);
        if !((0.0..=last_x).contains(&x) && (0.0..=last_y).contains(&y)) {
            return None;
        }
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let (fx, fy) = (x - x0 as f32, y - y0 as f32);
        let pixels = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| (view * self.height + y) * self.width + x);
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        Some(Landing { candidate, pixels, weights })
    }
}
