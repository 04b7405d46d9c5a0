//! What matching already knows of a view: the coarse depth of a network that has no cost volume of its own.
//!
//! Sits between the matcher and the refinement (`depth::seeded`). A surface is a plane per pixel in inverse
//! depth, which stays a plane under perspective. Invariant: lengths leave this module in *steps*, the inverse
//! depth that moves a neighbour's pixel by about one, so the network sees neither unit nor depth range.

use surfel_core::Grid;
use surfel_stereo::DepthEstimate;

/// Matching's answer for one view, at the size of its image.
#[derive(Clone, Debug)]
pub struct Seed {
    /// Inverse z-depth (1 / scene unit) and its change per pixel to the right and down.
    pub planes: Grid<[f32; 3]>,
    /// Inverse depth at which the photographs agree best near the plane, and the weight of that finding (>= 0).
    pub evidence: Grid<[f32; 2]>,
    /// Correlation of the photographs at the plane, in \[-1, 1\].
    pub correlation: Grid<f32>,
    /// 0 = a guess, 1 = seen sharply and confirmed by another view.
    pub confidence: Grid<f32>,
    /// Inverse depth that moves a neighbour's pixel by about one, 1 / scene unit.
    pub step: f32,
}

impl From<&DepthEstimate> for Seed {
    fn from(estimate: &DepthEstimate) -> Self {
        Self {
            planes: estimate.planes.map(|plane| [plane.w, plane.w_x, plane.w_y]),
            evidence: estimate.correction.map(|c| [c.evidence.w, c.evidence.weight]),
            correlation: estimate.correction.map(|c| c.correlation),
            confidence: estimate.confidence.clone(),
            step: estimate.step,
        }
    }
}

impl Seed {
    /// Columns and rows of the maps, or `None` when they differ.
    pub fn size(&self) -> Option<(usize, usize)> {
        let size = (self.planes.width(), self.planes.height());
        let sizes = [
            (self.evidence.width(), self.evidence.height()),
            (self.correlation.width(), self.correlation.height()),
            (self.confidence.width(), self.confidence.height()),
        ];
        sizes.iter().all(|other| *other == size).then_some(size)
    }

    /// True when every value is a finite number and the step can be divided by.
    pub fn is_finite(&self) -> bool {
        let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
        self.step > 0.0
            && self.step.is_finite()
            && finite(self.planes.as_slice().as_flattened())
            && finite(self.evidence.as_slice().as_flattened())
            && finite(self.correlation.as_slice())
            && finite(self.confidence.as_slice())
    }

    /// The maps extended right and down by repeating their border.
    pub(crate) fn padded(&self, width: usize, height: usize) -> Self {
        fn extend<T: Copy>(grid: &Grid<T>, width: usize, height: usize) -> Grid<T> {
            let last = (grid.width() - 1, grid.height() - 1);
            Grid::from_fn(width, height, |x, y| grid[(x.min(last.0), y.min(last.1))])
        }
        Self {
            planes: extend(&self.planes, width, height),
            evidence: extend(&self.evidence, width, height),
            correlation: extend(&self.correlation, width, height),
            confidence: extend(&self.confidence, width, height),
            step: self.step,
        }
    }

    /// The planes in steps and steps per pixel.
    pub(crate) fn planes_in_steps(&self) -> Vec<[f32; 3]> {
        self.planes.as_slice().iter().map(|plane| plane.map(|value| value / self.step)).collect()
    }
}
