//! Left-right check: does the depth of one view agree with that of the others?
//!
//! Invariant: the disagreement is measured in pixels of the checked view, so its meaning does not depend on
//! the scene's unit.

use crate::warp::Warp;
use rayon::prelude::*;
use surfel_core::{Camera, Grid};

/// What the other views say about a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Agreement {
    /// At least one other view places the same surface there; smallest disagreement, pixels.
    Within(f32),
    /// Every view that looks there sees something else; smallest disagreement, pixels.
    Contradicted(f32),
    /// Outside every other view.
    Unseen,
}

/// Disagreement up to which a pixel counts as confirmed, pixels.
pub const CONFIRMED_PX: f32 = 1.5;

/// Checks the inverse depths `own` of `camera` against those of the other views.
pub fn check(camera: &Camera, own: &Grid<f32>, others: &[(&Camera, &Grid<f32>)]) -> Grid<Agreement> {
    let warps: Vec<(Warp, Warp)> =
        others.iter().map(|(other, _)| (Warp::new(camera, other), Warp::new(other, camera))).collect();
    let mut agreement = Grid::filled(own.width(), own.height(), Agreement::Unseen);
    agreement.as_mut_slice().par_chunks_mut(own.width()).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            let w = own[(x, y)];
            let disagreement = warps
                .iter()
                .zip(others)
                .filter_map(|((there, back), (_, depths))| disagreement_px(there, back, depths, x, y, w))
                .min_by(f32::total_cmp);
            *out = match disagreement {
                None => Agreement::Unseen,
                Some(px) if px <= CONFIRMED_PX => Agreement::Within(px),
                Some(px) => Agreement::Contradicted(px),
            };
        }
    });
    agreement
}

/// Distance, in pixels of this view, between the pixel and where the other view's surface at the
/// corresponding place would appear; `None` when the other view does not look there.
fn disagreement_px(there: &Warp, back: &Warp, other: &Grid<f32>, x: usize, y: usize, w: f32) -> Option<f32> {
    if w <= 0.0 {
        return None;
    }
    let landing = there.land(x as f64, y as f64, f64::from(w));
    if landing.relative_depth <= 1e-9 {
        return None;
    }
    let expected = f64::from(w) / landing.relative_depth;
    let speed = back.pixels_per_inverse_depth(landing.x, landing.y, expected)?;
    let (x0, y0) = (landing.x.floor() as isize, landing.y.floor() as isize);
    let neighbours = [(x0, y0), (x0 + 1, y0), (x0, y0 + 1), (x0 + 1, y0 + 1)];
    neighbours
        .iter()
        .filter_map(|&(x, y)| other.get(x, y).filter(|&&w| w > 0.0))
        .map(|&w| ((f64::from(w) - expected).abs() * speed) as f32)
        .min_by(f32::total_cmp)
}
