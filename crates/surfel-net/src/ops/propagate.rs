//! Plane propagation: each pixel joins one of the surfaces that its surroundings propose for it.
//!
//! A proposal is a neighbour's plane in inverse depth, continued to the pixel. The weights are a softmax over
//! the proposals of scores that blocks of `stride` x `stride` pixels share, and of each pixel's own lean towards the
//! nearer or the farther of them: an edge may run through a block. Proposals within [`REACH`] of each other are one
//! surface; the pixel takes the weighted mean of the surface with the most weight. A mean over all would put an
//! undecided pixel between two surfaces, where nothing is. Invariant: equal planes everywhere come back unchanged,
//! whatever the weights, and what comes back lies within [`REACH`] of a proposal.

use super::activation::exp;
use super::vector::each;
use pulp::Arch;
use rayon::prelude::*;

/// Pixels of a row that choose side by side, as many as the usual vector has numbers.
const LANES: usize = 8;
/// A number for each of them.
type Lanes = [f32; LANES];

/// Proposals farther than this from the pixel's own plane are drawn in, steps.
pub(super) const FARTHEST: f32 = 64.0;

/// Proposals this far from the one in their middle are of its surface, steps.
pub const REACH: f32 = 4.0;

/// Steps at which a difference of inverse depth counts half of what it could.
pub(super) const SOFT_STEPS: f32 = 2.0;

/// Odd, in (-1, 1), steepest at zero: small differences keep their size, large ones only their sign.
pub(crate) fn soft(steps: f32) -> f32 {
    steps / (SOFT_STEPS + steps.abs())
}

/// Index `by` away from `at`, or at the border of `len`.
pub(crate) fn clamped(at: usize, by: i32, len: usize) -> usize {
    (at as i64 + i64::from(by)).clamp(0, len as i64 - 1) as usize
}

/// The planes of all views and where proposals come from.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposals {
    /// Columns of an image.
    pub width: usize,
    /// Rows of an image.
    pub height: usize,
    /// Pixels that share weights, along each axis; divides both sides.
    pub stride: usize,
    /// Inverse depth in steps, and its change per pixel to the right and down; `[views, height, width]`.
    pub planes: Vec<[f32; 3]>,
    /// Offsets of the proposing pixels, columns and rows.
    pub offsets: Vec<[i32; 2]>,
}

impl Proposals {
    /// Number of views.
    pub fn num_views(&self) -> usize {
        self.planes.len() / (self.width * self.height).max(1)
    }

    /// Columns and rows of the weights.
    pub fn weight_size(&self) -> (usize, usize) {
        (self.width / self.stride, self.height / self.stride)
    }

    /// The plane of pixel `(x, y)` itself.
    pub(crate) fn own(&self, view: usize, x: usize, y: usize) -> [f32; 3] {
        self.planes[(view * self.height + y) * self.width + x]
    }

    /// Column and row of the pixel that makes proposal `k` to pixel `(x, y)`.
    pub(crate) fn proposer(&self, x: usize, y: usize, k: usize) -> (usize, usize) {
        let [dx, dy] = self.offsets[k];
        (clamped(x, dx, self.width), clamped(y, dy, self.height))
    }

    /// What proposal `k` says of pixel `(x, y)`: inverse depth relative to the pixel's own, and its slopes.
    pub fn at(&self, view: usize, x: usize, y: usize, k: usize) -> [f32; 3] {
        let (nx, ny) = self.proposer(x, y, k);
        let own = self.own(view, x, y);
        let [w, w_x, w_y] = self.own(view, nx, ny);
        let (dx, dy) = (x as f32 - nx as f32, y as f32 - ny as f32);
        [(w + w_x * dx + w_y * dy - own[0]).clamp(-FARTHEST, FARTHEST), w_x, w_y]
    }
}

/// Planes `[views, 3, height, width]` (inverse depth relative to the pixel's own, slopes) of scores
/// `[views, proposals, height / stride, width / stride]` and leans `[views, height, width]`, above zero to the nearer:
/// a lean of one adds a proposal's difference, softly in (-1, 1), to its score.
pub fn forward(scores: &[f32], leans: &[f32], proposals: &Proposals) -> Vec<f32> {
    let (arch, width, pixels) = (Arch::new(), proposals.width, proposals.width * proposals.height);
    let mut planes = vec![0.0; 3 * pixels * proposals.num_views()];
    for (view, planes) in planes.chunks_exact_mut(3 * pixels).enumerate() {
        let (w, slopes) = planes.split_at_mut(pixels);
        let (w_x, w_y) = slopes.split_at_mut(pixels);
        let rows = w.par_chunks_mut(width).zip(w_x.par_chunks_mut(width)).zip(w_y.par_chunks_mut(width));
        rows.enumerate().for_each(|(y, ((w, w_x), w_y))| {
            let mut group = Group::new(proposals.offsets.len());
            for first in (0..width).step_by(LANES) {
                let sums = arch.dispatch(
                    #[inline(always)]
                    || {
                        group.choose(scores, leans, proposals, view, first, y);
                        group.means()
                    },
                );
                for (values, sum) in [&mut *w, &mut *w_x, &mut *w_y].into_iter().zip(sums) {
                    let values = &mut values[first..width.min(first + LANES)];
                    values.copy_from_slice(&sum[..values.len()]);
                }
            }
        });
    }
    planes
}

/// Gradients of the scores and of the leans from that of the planes; same layouts as [`forward`].
pub fn backward(scores: &[f32], leans: &[f32], proposals: &Proposals, grad: &[f32]) -> (Vec<f32>, Vec<f32>) {
    let (arch, width, stride) = (Arch::new(), proposals.width, proposals.stride);
    let (pixels, count) = (width * proposals.height, proposals.offsets.len());
    let (columns, rows) = proposals.weight_size();
    let mut leans_grad = vec![0.0f32; leans.len()];
    // Rows first, so that each task owns what it writes; turned to the layout of the scores afterwards.
    let mut by_row = vec![0.0f32; proposals.num_views() * rows * count * columns];
    let tasks = by_row.par_chunks_mut(count * columns).zip(leans_grad.par_chunks_mut(stride * width));
    tasks.enumerate().for_each(|(row, (of_scores, of_leans))| {
        let (view, first_y) = (row / rows, row % rows * stride);
        let grad = &grad[view * 3 * pixels..][..3 * pixels];
        let mut group = Group::new(count);
        for (y, of_leans) in (first_y..).zip(of_leans.chunks_exact_mut(width)) {
            for first in (0..width).step_by(LANES) {
                let of_leans = &mut of_leans[first..width.min(first + LANES)];
                // Lanes past the border get no gradient.
                let mut g = [[0.0; LANES]; 3];
                for (map, g) in g.iter_mut().enumerate() {
                    g[..of_leans.len()].copy_from_slice(&grad[map * pixels + y * width + first..][..of_leans.len()]);
                }
                let lean = arch.dispatch(
                    #[inline(always)]
                    || {
                        group.choose(scores, leans, proposals, view, first, y);
                        group.gradients(&g)
                    },
                );
                for (k, of_weights) in group.weights.iter().enumerate() {
                    for (lane, of_weight) in of_weights[..of_leans.len()].iter().enumerate() {
                        of_scores[k * columns + (first + lane) / stride] += of_weight;
                    }
                }
                of_leans.copy_from_slice(&lean[..of_leans.len()]);
            }
        }
    });
    let mut scores_grad = vec![0.0f32; by_row.len()];
    for (row, values) in by_row.chunks_exact(count * columns).enumerate() {
        let (view, block_y) = (row / rows, row % rows);
        for (k, values) in values.chunks_exact(columns).enumerate() {
            scores_grad[((view * count + k) * rows + block_y) * columns..][..columns].copy_from_slice(values);
        }
    }
    (scores_grad, leans_grad)
}

/// What is proposed to [`LANES`] neighbours in a row, and how each chooses; by proposal.
struct Group {
    /// Inverse depth relative to the pixel's own, and slopes.
    planes: Vec<[Lanes; 3]>,
    /// Weights, later shares within the surface chosen, which sum to one; 0 outside. After [`Self::gradients`], theirs.
    weights: Vec<Lanes>,
}

impl Group {
    fn new(count: usize) -> Self {
        Self { planes: vec![[[0.0; LANES]; 3]; count], weights: vec![[0.0; LANES]; count] }
    }

    /// Each pixel's surface with the most weight; of equal ones, that around the first. The pixels are those from `first`
    /// on; lanes past the border repeat the last.
    #[inline(always)]
    fn choose(&mut self, scores: &[f32], leans: &[f32], proposals: &Proposals, view: usize, first: usize, y: usize) {
        self.propose(scores, leans, proposals, view, first, y);
        let mut largest = [f32::NEG_INFINITY; LANES];
        for weights in &self.weights {
            each::<LANES>(|lane| largest[lane] = largest[lane].max(weights[lane]));
        }
        for weights in &mut self.weights {
            each::<LANES>(|lane| weights[lane] = exp(weights[lane] - largest[lane]));
        }
        let (mut most, mut middle) = ([f32::NEG_INFINITY; LANES], [0.0; LANES]);
        for [to, ..] in &self.planes {
            let mut mass = [0.0; LANES];
            for ([from, ..], weights) in self.planes.iter().zip(&self.weights) {
                each::<LANES>(|lane| {
                    mass[lane] += if (from[lane] - to[lane]).abs() <= REACH { weights[lane] } else { 0.0 }
                });
            }
            each::<LANES>(|lane| {
                let is_more = mass[lane] > most[lane];
                most[lane] = if is_more { mass[lane] } else { most[lane] };
                middle[lane] = if is_more { to[lane] } else { middle[lane] };
            });
        }
        for ([depths, ..], weights) in self.planes.iter().zip(&mut self.weights) {
            each::<LANES>(|lane| {
                let is_near = (depths[lane] - middle[lane]).abs() <= REACH;
                weights[lane] = if is_near { weights[lane] / most[lane] } else { 0.0 };
            });
        }
    }

    /// Planes and scores of all proposals.
    #[inline(always)]
    fn propose(&mut self, scores: &[f32], leans: &[f32], proposals: &Proposals, view: usize, first: usize, y: usize) {
        let Proposals { width, height, stride, ref planes, ref offsets } = *proposals;
        let ((columns, rows), count) = (proposals.weight_size(), offsets.len());
        let xs: [usize; LANES] = std::array::from_fn(|lane| (first + lane).min(width - 1));
        let row = |y: usize| (view * height + y) * width;
        let (own, leans) = (&planes[row(y)..][..width], &leans[row(y)..][..width]);
        let own: Lanes = xs.map(|x| own[x][0]);
        let leans: Lanes = xs.map(|x| leans[x]);
        for (k, &[right, down]) in offsets.iter().enumerate() {
            let ny = clamped(y, down, height);
            let proposing = &planes[row(ny)..][..width];
            let scores = &scores[((view * count + k) * rows + y / stride) * columns..][..columns];
            let dy = y as f32 - ny as f32;
            let [depths, slopes_x, slopes_y] = &mut self.planes[k];
            let mut dx = [0.0; LANES];
            each::<LANES>(|lane| {
                let nx = clamped(xs[lane], right, width);
                [depths[lane], slopes_x[lane], slopes_y[lane]] = proposing[nx];
                dx[lane] = xs[lane] as f32 - nx as f32;
                self.weights[k][lane] = scores[xs[lane] / stride];
            });
            each::<LANES>(|lane| {
                let depth = depths[lane] + slopes_x[lane] * dx[lane] + slopes_y[lane] * dy - own[lane];
                depths[lane] = depth.clamp(-FARTHEST, FARTHEST);
                self.weights[k][lane] += leans[lane] * soft(depths[lane]);
            });
        }
    }

    /// The planes chosen.
    #[inline(always)]
    fn means(&self) -> [Lanes; 3] {
        let mut sums = [[0.0; LANES]; 3];
        for (planes, shares) in self.planes.iter().zip(&self.weights) {
            for (sum, values) in sums.iter_mut().zip(planes) {
                each::<LANES>(|lane| sum[lane] += shares[lane] * values[lane]);
            }
        }
        sums
    }

    /// Puts the gradients of the scores in the place of the shares, given those of [`Self::means`]; returns those of the
    /// leans.
    #[inline(always)]
    fn gradients(&mut self, of_means: &[Lanes; 3]) -> Lanes {
        let gain = |planes: &[Lanes; 3], lane: usize| {
            of_means[0][lane] * planes[0][lane]
                + of_means[1][lane] * planes[1][lane]
                + of_means[2][lane] * planes[2][lane]
        };
        let (mut mean, mut of_leans) = ([0.0; LANES], [0.0; LANES]);
        for (planes, shares) in self.planes.iter().zip(&self.weights) {
            each::<LANES>(|lane| mean[lane] += shares[lane] * gain(planes, lane));
        }
        for (planes, shares) in self.planes.iter().zip(&mut self.weights) {
            each::<LANES>(|lane| {
                shares[lane] *= gain(planes, lane) - mean[lane];
                of_leans[lane] += shares[lane] * soft(planes[0][lane]);
            });
        }
        of_leans
    }
}
