//! Semi-global aggregation of a cost volume along eight paths (Hirschmüller 2008), edge-aware.
//!
//! Between the raw matching cost and the choice of a depth. Invariant: the result equals the plain
//! recursion ([`crate::twin::aggregate`]) exactly, and does not depend on the number of threads.

use crate::config::Smoothness;
use crate::cost_volume::{CANDIDATE_LANES, COST_ONE, CostVolume};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use surfel_core::Grid;

/// Larger than any path cost, small enough to add a penalty without overflow.
const BORDER: i16 = 16_000;

/// Prices of a change of depth between two neighbouring pixels.
pub(crate) struct JumpPrice {
    /// Of a change by one candidate.
    pub p1: i16,
    smooth: f32,
    edge: f32,
    half: f32,
}

impl JumpPrice {
    pub fn new(s: &Smoothness) -> Self {
        let one = f32::from(COST_ONE);
        Self { p1: (s.p1 * one) as i16, smooth: s.p2 * one, edge: s.p2_edge * one, half: s.edge }
    }

    /// Of a jump between pixels of luma `a` and `b`.
    #[inline(always)]
    pub fn between(&self, a: f32, b: f32) -> i16 {
        let t = (a - b) / self.half;
        (self.edge + (self.smooth - self.edge) / (1.0 + t * t)) as i16
    }
}

/// Calls `chosen` with the sum over eight paths of the aggregated costs of every pixel, one per candidate.
pub fn aggregate<T: Clone + Default + Send>(
    volume: &CostVolume,
    guide: &Grid<f32>,
    smoothness: &Smoothness,
    chosen: impl Fn(&[i16]) -> T + Sync,
) -> Grid<T> {
    let (width, stride, count) = (volume.width, volume.stride(), volume.candidates.count);
    let paths = Paths { volume, guide, price: JumpPrice::new(smoothness) };
    let arch = Arch::new();
    let (down, up) = rayon::join(
        || arch.dispatch(Vertical { paths: &paths, up: false }),
        || arch.dispatch(Vertical { paths: &paths, up: true }),
    );
    let mut result = Grid::filled(width, volume.height, T::default());
    result.as_mut_slice().par_chunks_mut(width).enumerate().for_each_init(
        || (Vec::new(), [Front::new(1, stride), Front::new(1, stride)]),
        |(sum, fronts), (y, result)| {
            let row = y * width * stride..(y + 1) * width * stride;
            sum.clear();
            sum.extend_from_slice(&down[row.clone()]);
            arch.dispatch(Horizontal { paths: &paths, y, up: &up[row], fronts, sum });
            for (result, sum) in result.iter_mut().zip(sum.chunks_exact(stride)) {
                *result = chosen(&sum[..count]);
            }
        },
    );
    result
}

/// What all paths share.
struct Paths<'a> {
    volume: &'a CostVolume,
    guide: &'a Grid<f32>,
    price: JumpPrice,
}

/// Path costs of a row of pixels. Every pixel has a border on either side, so that the inner loop has no branch.
struct Front {
    costs: Vec<i16>,
    smallest: Vec<i16>,
    pitch: usize,
}

/// Values between the path costs of neighbouring pixels.
const GAP: usize = CANDIDATE_LANES;

impl Front {
    fn new(width: usize, stride: usize) -> Self {
        let pitch = stride + GAP;
        Self { costs: vec![BORDER; width * pitch + GAP], smallest: vec![0; width], pitch }
    }

    /// Index of the first path cost of a pixel.
    fn start(&self, x: usize) -> usize {
        x * self.pitch + GAP
    }
}

impl Paths<'_> {
    /// Price of a jump from pixel `from` to pixel `to`.
    #[inline(always)]
    fn jump(&self, from: (usize, usize), to: (usize, usize)) -> i16 {
        self.price.between(self.guide[to], self.guide[from])
    }

    /// `next = cost + min(stay, ±1 + p1, anywhere + jump) - smallest`, added to `sum`; a path that starts
    /// here (`from` is `None`) is the cost itself. `from` is a pixel of `before` and the price of a jump.
    #[inline(always)]
    fn step<S: Simd>(
        &self,
        simd: S,
        cost: &[i16],
        from: Option<(usize, i16)>,
        before: &Front,
        (next, x): (&mut Front, usize),
        sum: &mut [i16],
    ) {
        let count = cost.len();
        let (cost, sum) = (S::as_simd_i16s(cost).0, S::as_mut_simd_i16s(sum).0);
        let to = next.start(x);
        let out = S::as_mut_simd_i16s(&mut next.costs[to..][..count]).0;
        let mut least = simd.splat_i16s(i16::MAX);
        if let Some((from, jump)) = from {
            let smallest = before.smallest[from];
            let anywhere = simd.splat_i16s(smallest.wrapping_add(jump));
            let (smallest, p1) = (simd.splat_i16s(smallest), simd.splat_i16s(self.price.p1));
            let from = before.start(from);
            let below = S::as_simd_i16s(&before.costs[from - 1..][..count]).0;
            let same = S::as_simd_i16s(&before.costs[from..][..count]).0;
            let above = S::as_simd_i16s(&before.costs[from + 1..][..count]).0;
            let before = below.iter().zip(same).zip(above);
            for (((out, sum), &cost), ((&below, &same), &above)) in out.iter_mut().zip(sum).zip(cost).zip(before) {
                let step = simd.add_i16s(simd.min_i16s(below, above), p1);
                let best = simd.min_i16s(simd.min_i16s(same, anywhere), step);
                *out = simd.add_i16s(cost, simd.sub_i16s(best, smallest));
                least = simd.min_i16s(least, *out);
                *sum = simd.add_i16s(*sum, *out);
            }
        } else {
            for ((out, sum), &cost) in out.iter_mut().zip(sum).zip(cost) {
                *out = cost;
                least = simd.min_i16s(least, cost);
                *sum = simd.add_i16s(*sum, cost);
            }
        }
        next.smallest[x] = smallest_lane(simd, least);
    }
}

#[inline(always)]
fn smallest_lane<S: Simd>(_: S, values: S::i16s) -> i16 {
    let mut lanes = [i16::MAX; CANDIDATE_LANES];
    S::as_mut_simd_i16s(&mut lanes).0[0] = values;
    lanes.iter().fold(i16::MAX, |least, &lane| least.min(lane))
}

/// The three paths that come from the row before, downwards or upwards: their sum, laid out as the volume.
struct Vertical<'a> {
    paths: &'a Paths<'a>,
    up: bool,
}

impl WithSimd for Vertical<'_> {
    type Output = Vec<i16>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<i16> {
        let Self { paths, up } = self;
        let volume = paths.volume;
        let (width, height, stride) = (volume.width, volume.height, volume.stride());
        let mut sum = vec![0i16; width * height * stride];
        let fronts = || [0; 3].map(|_| Front::new(width, stride));
        let (mut before, mut next) = (fronts(), fronts());
        for step in 0..height {
            let y = if up { height - 1 - step } else { step };
            let row_before = if up { y + 1 } else { y.wrapping_sub(1) };
            for x in 0..width {
                let cost = volume.padded_at(x, y);
                let sum = &mut sum[(y * width + x) * stride..][..stride];
                for (i, (before, next)) in before.iter().zip(&mut next).enumerate() {
                    // Paths from the left, from straight ahead and from the right.
                    let from = (x + i).wrapping_sub(1);
                    let from = (step > 0 && from < width).then(|| (from, paths.jump((from, row_before), (x, y))));
                    paths.step(simd, cost, from, before, (next, x), sum);
                }
            }
            std::mem::swap(&mut before, &mut next);
        }
        sum
    }
}

/// The paths along row `y`, both ways, added with those from below to the sum of those from above.
struct Horizontal<'a> {
    paths: &'a Paths<'a>,
    y: usize,
    up: &'a [i16],
    fronts: &'a mut [Front; 2],
    sum: &'a mut [i16],
}

impl WithSimd for Horizontal<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { paths, y, up, fronts: [before, next], sum } = self;
        let (width, stride) = (paths.volume.width, paths.volume.stride());
        for (sum, &up) in S::as_mut_simd_i16s(sum).0.iter_mut().zip(S::as_simd_i16s(up).0) {
            *sum = simd.add_i16s(*sum, up);
        }
        for leftwards in [false, true] {
            for step in 0..width {
                let x = if leftwards { width - 1 - step } else { step };
                let from = if leftwards { x + 1 } else { x.wrapping_sub(1) };
                let from = (step > 0).then(|| (0, paths.jump((from, y), (x, y))));
                let sum = &mut sum[x * stride..][..stride];
                paths.step(simd, paths.volume.padded_at(x, y), from, before, (next, 0), sum);
                std::mem::swap(before, next);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::candidates::Candidates;
    use crate::twin;

    #[test]
    fn equals_the_plain_recursion() {
        for (width, height, count) in [(13, 9, 11), (7, 12, 16), (9, 5, 37)] {
            let cost = |x: usize, y: usize, d: usize| ((((y * width + x) * count + d) * 7919 + 13) % 1000) as i16;
            let volume = CostVolume::from_fn((width, height), Candidates::uniform(1.0, 4.0, count), cost);
            let guide = Grid::from_fn(width, height, |x, y| ((x * 31 + y * 17) % 10) as f32 / 10.0);
            let smoothness = Smoothness::default();
            let fast = aggregate(&volume, &guide, &smoothness, |sums| sums.to_vec());
            let fast: Vec<i32> = fast.as_slice().iter().flatten().map(|&sum| i32::from(sum)).collect();
            assert_eq!(fast, twin::aggregate(&volume, &guide, &smoothness), "{width}x{height}, {count} candidates");
        }
    }
}
