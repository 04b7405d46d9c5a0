//! The photographs at the size of the sweep and at every size up to their own.
//!
//! The cost volume grows with the third power of the image size, so large photographs are swept at a
//! reduced size and refined upwards. Invariant: image, mask, colours and camera of a level show the same
//! field of view.

use crate::cost_volume::MatchImage;
use crate::estimate::MatchView;
use crate::feature_costs::FeatureGrid;
use crate::plane_fit::Plane;
use surfel_core::{Camera, Grid};

/// One view at one size.
pub struct Level {
    gray: Grid<f32>,
    valid: Grid<bool>,
    /// Colours, guide of the edge-aware steps.
    pub colour: Grid<[f32; 3]>,
    camera: Camera,
}

impl Level {
    /// The view as it was given.
    pub fn of(view: &MatchView) -> Self {
        Self {
            gray: view.image.gray.clone(),
            valid: view.image.valid.clone(),
            colour: view.colour.clone(),
            camera: *view.image.camera,
        }
    }

    /// Half the size, by averaging 2x2 pixels; an odd last row or column is left out.
    pub fn halved(&self) -> Self {
        let (width, height) = (self.gray.width() / 2, self.gray.height() / 2);
        let corners =
            |x: usize, y: usize| [(2 * x, 2 * y), (2 * x + 1, 2 * y), (2 * x, 2 * y + 1), (2 * x + 1, 2 * y + 1)];
        Self {
            gray: Grid::from_fn(width, height, |x, y| corners(x, y).iter().map(|&at| self.gray[at]).sum::<f32>() / 4.0),
            valid: Grid::from_fn(width, height, |x, y| corners(x, y).iter().all(|&at| self.valid[at])),
            colour: Grid::from_fn(width, height, |x, y| {
                std::array::from_fn(|c| corners(x, y).iter().map(|&at| self.colour[at][c]).sum::<f32>() / 4.0)
            }),
            camera: self.camera.cropped(0, 0, 2 * width, 2 * height).resized(width, height),
        }
    }

    /// The level as an image to match; `features` belong to the full size and `halvings` lead here from it.
    pub fn image<'a>(&'a self, features: Option<FeatureGrid<'a>>, halvings: usize) -> MatchImage<'a> {
        let scale = 0.5f64.powi(halvings as i32);
        let features =
            features.map(|f| FeatureGrid { stride: f.stride * scale, origin: (f.origin + 0.5) * scale - 0.5, ..f });
        MatchImage { gray: &self.gray, valid: &self.valid, camera: &self.camera, features }
    }
}

/// Planes of the next finer level: every pixel continues, out of the four coarse planes around it, the one
/// whose colour is nearest its own, so that edges sharpen instead of smearing.
pub fn upsampled(planes: &Grid<Plane>, coarse: &Level, fine: &Level) -> Grid<Plane> {
    let (last_x, last_y) = (planes.width() as isize - 1, planes.height() as isize - 1);
    Grid::from_fn(fine.gray.width(), fine.gray.height(), |x, y| {
        let (cx, cy) = ((x as f32 + 0.5) / 2.0 - 0.5, (y as f32 + 0.5) / 2.0 - 0.5);
        let own = fine.colour[(x, y)];
        let (x0, y0) = (cx.floor() as isize, cy.floor() as isize);
        let around = [(x0, y0), (x0 + 1, y0), (x0, y0 + 1), (x0 + 1, y0 + 1)];
        let clamped = around.map(|(x, y)| (x.clamp(0, last_x) as usize, y.clamp(0, last_y) as usize));
        let price = |at: (usize, usize)| {
            let colour = coarse.colour[at];
            let colour_sq: f32 = (0..3).map(|c| (colour[c] - own[c]).powi(2)).sum();
            let distance_sq = (at.0 as f32 - cx).powi(2) + (at.1 as f32 - cy).powi(2);
            // A tenth of the colour range weighs as much as one coarse pixel.
            colour_sq / 0.01 + distance_sq
        };
        let best = clamped.into_iter().min_by(|&a, &b| price(a).total_cmp(&price(b))).unwrap_or((0, 0));
        let plane = planes[best];
        let w = plane.at(cx - best.0 as f32, cy - best.1 as f32);
        Plane { w, w_x: plane.w_x / 2.0, w_y: plane.w_y / 2.0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_core::{Intrinsics, Rigid};

    #[test]
    fn a_plane_survives_upsampling() {
        let camera = Camera {
            intrinsics: Intrinsics { fx: 20.0, fy: 20.0, cx: 8.0, cy: 6.0 },
            width: 17,
            height: 12,
            camera_from_world: Rigid::IDENTITY,
        };
        let gray = Grid::filled(17, 12, 0.5);
        let (valid, colour) = (Grid::filled(17, 12, true), Grid::filled(17, 12, [0.5; 3]));
        let image = MatchImage { gray: &gray, valid: &valid, camera: &camera, features: None };
        let fine = Level::of(&MatchView { image, colour: &colour, near: 1.0, far: 2.0 });
        let coarse = fine.halved();
        assert_eq!((coarse.camera.width, coarse.camera.intrinsics.fx), (8, 10.0));
        // w as a function of the continuous fine pixel.
        let w = |x: f32, y: f32| 0.5 + 0.01 * x - 0.02 * y;
        let planes = Grid::from_fn(8, 6, |x, y| Plane {
            w: w(2.0 * x as f32 + 1.0, 2.0 * y as f32 + 1.0),
            w_x: 0.02,
            w_y: -0.04,
        });
        let up = upsampled(&planes, &coarse, &fine);
        for y in 0..12 {
            for x in 0..17 {
                assert!((up[(x, y)].w - w(x as f32 + 0.5, y as f32 + 0.5)).abs() < 1e-6);
            }
        }
        assert!((up[(3, 3)].w_x - 0.01).abs() < 1e-7);
    }
}
