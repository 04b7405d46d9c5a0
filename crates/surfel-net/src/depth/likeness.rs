//! How alike a photograph is at a pixel and where a plane is proposed from.
//!
//! What belongs to one surface mostly looks alike, and between two surfaces there mostly is an edge: for a pixel that
//! no other view sees, all there is to go by. Invariant: both values lie in \[0, 1), and are 0 for the pixel itself.

use crate::ops::propagate::clamped;
use rayon::prelude::*;
use surfel_core::Grid;

/// Values known of a proposer: difference of colours, largest step of colour on the way.
pub(super) const LIKENESS: usize = 2;
/// Distance of colours, of sRGB in \[0, 1\], that counts half of what one could.
const SOFT_COLOUR: f32 = 0.1;

/// A photograph, in means over 2 x 2 pixels, so that noise is not taken for an edge.
pub(super) struct Likeness {
    means: Grid<[f32; 3]>,
}

impl Likeness {
    pub(super) fn new(image: &Grid<[f32; 3]>) -> Self {
        let (width, height) = (image.width(), image.height());
        let means = Grid::from_fn(width, height, |x, y| {
            let (right, below) = ((x + 1).min(width - 1), (y + 1).min(height - 1));
            let [a, b, c, d] = [(x, y), (right, y), (x, below), (right, below)].map(|at| image[at]);
            std::array::from_fn(|i| 0.25 * (a[i] + b[i] + c[i] + d[i]))
        });
        Self { means }
    }

    /// Of the first pixel of every block of `stride` x `stride` and those `offsets` away; block by block.
    pub(super) fn of_blocks(&self, stride: usize, offsets: &[[i32; 2]]) -> Vec<[f32; LIKENESS]> {
        let (columns, rows) = (self.means.width() / stride, self.means.height() / stride);
        let mut alike = vec![[0.0; LIKENESS]; rows * columns * offsets.len()];
        alike.par_chunks_mut(columns * offsets.len()).enumerate().for_each(|(row, alike)| {
            for (column, alike) in alike.chunks_exact_mut(offsets.len()).enumerate() {
                let pixel = (column * stride, row * stride);
                alike.iter_mut().zip(offsets).for_each(|(alike, offset)| *alike = self.of(pixel, *offset));
            }
        });
        alike
    }

    /// Of pixel `(x, y)` and the one `offset` (columns, rows) away, or at the border; the way goes straight or along
    /// a diagonal.
    fn of(&self, (x, y): (usize, usize), [dx, dy]: [i32; 2]) -> [f32; LIKENESS] {
        let own = self.means[(x, y)];
        let count = dx.abs().max(dy.abs());
        let (mut last, mut largest) = (own, 0.0f32);
        for i in 1..=count {
            let column = clamped(x, dx * i / count, self.means.width());
            let next = self.means[(column, clamped(y, dy * i / count, self.means.height()))];
            largest = largest.max(apart(last, next));
            last = next;
        }
        [soft(apart(own, last)), soft(largest)]
    }
}

fn apart(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt()
}

fn soft(distance: f32) -> f32 {
    distance / (SOFT_COLOUR + distance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_on_the_way_is_seen_though_both_ends_look_alike() {
        let stripe = Grid::from_fn(24, 8, |x, _| if (10..14).contains(&x) { [0.9, 0.1, 0.1] } else { [0.2, 0.3, 0.4] });
        let likeness = Likeness::new(&stripe);
        let [difference, edge] = likeness.of((5, 3), [12, 0]);
        assert!(difference == 0.0 && edge > 0.7, "{difference} {edge}");
        let [difference, edge] = likeness.of((5, 3), [6, 0]);
        assert!(difference > 0.8 && edge > 0.7, "{difference} {edge}");
        assert_eq!(likeness.of((5, 3), [-4, 4]), [0.0; LIKENESS], "one colour all the way");
        assert_eq!(likeness.of((9, 3), [0, 0]), [0.0; LIKENESS], "the pixel itself");
        assert_eq!(likeness.of((20, 3), [12, 0]), [0.0; LIKENESS], "the way ends at the border");
    }
}
