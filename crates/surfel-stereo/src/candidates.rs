//! Depth candidates of the plane sweep: uniform in inverse depth, from far (index 0) to near (spec 1.2).
//!
//! Invariant: neighbouring candidates are at most about `step_px` apart in every source view, so the
//! sweep never steps over a match.

use crate::warp::Warp;
use surfel_core::Camera;

/// Inverse depths `1/far + j (1/near - 1/far) / (count - 1)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidates {
    /// Inverse depth of candidate 0 (the far plane).
    pub first: f64,
    /// Inverse-depth step between candidates.
    pub step: f64,
    /// Number of candidates, at least 2.
    pub count: usize,
}

/// Fewest and most candidates of a sweep: below, sub-pixel interpolation has nothing to stand on; above,
/// the volume outgrows its use and the refinement takes over.
pub const COUNT_RANGE: (usize, usize) = (16, 256);

impl Candidates {
    /// `count` planes between `near` and `far` (scene units, `0 < near < far`).
    pub fn uniform(near: f64, far: f64, count: usize) -> Self {
        let count = count.max(2);
        Self { first: 1.0 / far, step: (1.0 / near - 1.0 / far) / (count - 1) as f64, count }
    }

    /// As many planes as keep one step under `step_px` pixels in the source view where it moves most; of several
    /// sources in the middle one, the slower of two. Finer steps for the sake of a far source would make the surface
    /// cross more of them, which smoothing counts as roughness.
    pub fn for_pair(reference: &Camera, sources: &[Camera], near: f64, far: f64, step_px: f64) -> Self {
        let travels = sources.iter().map(|source| longest_travel(reference, source, near, far));
        let mut travels: Vec<f64> = travels.filter(|travel| *travel > 0.0).collect();
        travels.sort_by(f64::total_cmp);
        let travel = travels.get(travels.len().saturating_sub(1) / 2).copied().unwrap_or(0.0);
        let count = (travel / step_px).ceil() as usize + 1;
        Self::uniform(near, far, count.clamp(COUNT_RANGE.0, COUNT_RANGE.1))
    }

    /// Inverse depth of (fractional) candidate `index`.
    pub fn inverse_depth(&self, index: f64) -> f64 {
        self.first + self.step * index
    }

    /// Inverse depth of the near plane.
    pub fn last(&self) -> f64 {
        self.inverse_depth((self.count - 1) as f64)
    }
}

/// Longest path, in source pixels, that a reference pixel travels from far to near inside the source image.
fn longest_travel(reference: &Camera, source: &Camera, near: f64, far: f64) -> f64 {
    const GRID: usize = 5;
    const SEGMENTS: usize = 64;
    let warp = Warp::new(reference, source);
    let margin = 0.1 * (source.width + source.height) as f64;
    let mut longest = 0.0f64;
    for gy in 0..GRID {
        for gx in 0..GRID {
            let x = (gx as f64 + 0.5) / GRID as f64 * reference.width as f64 - 0.5;
            let y = (gy as f64 + 0.5) / GRID as f64 * reference.height as f64 - 0.5;
            let mut fastest = 0.0f64;
            for s in 0..=SEGMENTS {
                let w = 1.0 / far + (1.0 / near - 1.0 / far) * s as f64 / SEGMENTS as f64;
                let landing = warp.land(x, y, w);
                let inside = landing.relative_depth > 0.0
                    && landing.x > -margin
                    && landing.y > -margin
                    && landing.x < source.width as f64 + margin
                    && landing.y < source.height as f64 + margin;
                if let (true, Some(speed)) = (inside, warp.pixels_per_inverse_depth(x, y, w)) {
                    fastest = fastest.max(speed);
                }
            }
            longest = longest.max(fastest * (1.0 / near - 1.0 / far));
        }
    }
    longest
}
