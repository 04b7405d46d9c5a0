//! Scores of proposals by two layers, without ever writing down what is between them.
//!
//! Every proposal of every pixel has as many hidden values as a map has channels, so as maps of their own they would be
//! the largest of the network by far. Invariant: sums run in an order that the sizes alone decide.

use super::vector::each;
use pulp::Arch;
use rayon::prelude::*;

/// Pixels that are judged side by side, as many as two of the usual vectors have numbers.
const LANES: usize = 16;
/// A number for each of them.
type Lanes = [f32; LANES];
/// Pixels of a task.
const RUN: usize = 32 * LANES;

/// The sizes of a judge and of what it is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Judge {
    /// Scenes' views.
    pub views: usize,
    /// Proposals of each pixel.
    pub proposals: usize,
    /// What is known of each proposal.
    pub channels: usize,
    /// Values between the layers.
    pub hidden: usize,
    /// Pixels of a map.
    pub pixels: usize,
}

/// What is asked, and the weights of the layers.
#[derive(Clone, Copy, Debug)]
pub struct Inputs<'a> {
    /// What is known of every proposal, `[views, proposals, channels, pixels]`.
    pub known: &'a [f32],
    /// What the pixel itself adds to the hidden values, `[views, hidden, pixels]`.
    pub context: &'a [f32],
    /// Of the first layer, `[hidden, channels]`.
    pub weights: &'a [f32],
    /// Of the second layer, `[hidden]`.
    pub score: &'a [f32],
}

/// Gradients of all inputs, in their layouts.
#[derive(Clone, Debug, PartialEq)]
pub struct Gradients {
    /// See [`Inputs::known`].
    pub known: Vec<f32>,
    /// See [`Inputs::context`].
    pub context: Vec<f32>,
    /// See [`Inputs::weights`].
    pub weights: Vec<f32>,
    /// See [`Inputs::score`].
    pub score: Vec<f32>,
}

impl Judge {
    fn check(&self, inputs: &Inputs) {
        let Self { views, proposals, channels, hidden, pixels } = *self;
        assert_eq!(inputs.known.len(), views * proposals * channels * pixels, "what is known, {self:?}");
        assert_eq!(inputs.context.len(), views * hidden * pixels, "context, {self:?}");
        assert_eq!((inputs.weights.len(), inputs.score.len()), (hidden * channels, hidden), "weights, {self:?}");
    }

    /// Runs of pixels of one view, each a task: the view, the first pixel, how many there are.
    fn runs(&self) -> Vec<(usize, usize, usize)> {
        let of_view =
            |view| (0..self.pixels).step_by(RUN).map(move |first| (view, first, RUN.min(self.pixels - first)));
        (0..self.views).flat_map(of_view).collect()
    }
}

/// Scores `[views, proposals, pixels]`.
pub fn forward(judge: &Judge, inputs: &Inputs) -> Vec<f32> {
    judge.check(inputs);
    let (arch, runs) = (Arch::new(), judge.runs());
    let of_run = |&(view, first, length): &(usize, usize, usize)| {
        let mut scores = vec![0.0; judge.proposals * length];
        let mut group = Group::new(judge);
        for start in (0..length).step_by(LANES) {
            let count = LANES.min(length - start);
            group.read_context(judge, inputs, view, first + start, count);
            for k in 0..judge.proposals {
                group.read_known(judge, inputs, view, k, first + start, count);
                let of_lanes = arch.dispatch(
                    #[inline(always)]
                    || group.scores(inputs),
                );
                scores[k * length + start..][..count].copy_from_slice(&of_lanes[..count]);
            }
        }
        scores
    };
    let found: Vec<Vec<f32>> = runs.par_iter().map(of_run).collect();
    placed(judge, judge.proposals, &runs, found.iter().map(Vec::as_slice))
}

/// The gradients of all inputs, given that of the scores.
pub fn backward(judge: &Judge, inputs: &Inputs, grad: &[f32]) -> Gradients {
    judge.check(inputs);
    let Judge { proposals, channels, hidden, pixels, .. } = *judge;
    assert_eq!(grad.len(), judge.views * proposals * pixels, "gradient of {judge:?}");
    let (arch, runs) = (Arch::new(), judge.runs());
    let of_run = |&(view, first, length): &(usize, usize, usize)| {
        let mut of = Gradients {
            known: vec![0.0; proposals * channels * length],
            context: vec![0.0; hidden * length],
            weights: vec![0.0; hidden * channels],
            score: vec![0.0; hidden],
        };
        let mut group = Group::new(judge);
        for start in (0..length).step_by(LANES) {
            let count = LANES.min(length - start);
            group.read_context(judge, inputs, view, first + start, count);
            for k in 0..proposals {
                group.read_known(judge, inputs, view, k, first + start, count);
                // Lanes past the end get no gradient.
                let mut given = [0.0; LANES];
                given[..count].copy_from_slice(&grad[(view * proposals + k) * pixels + first + start..][..count]);
                arch.dispatch(
                    #[inline(always)]
                    || group.gradients(inputs, &given),
                );
                for (c, of_known) in group.of_known.iter().enumerate() {
                    of.known[(k * channels + c) * length + start..][..count].copy_from_slice(&of_known[..count]);
                }
            }
            for (h, of_context) in group.of_context.iter_mut().enumerate() {
                of.context[h * length + start..][..count].copy_from_slice(&of_context[..count]);
                *of_context = [0.0; LANES];
            }
        }
        let sum = |lanes: &Lanes| lanes.iter().sum::<f32>();
        of.weights.iter_mut().zip(&group.of_weights).for_each(|(to, lanes)| *to = sum(lanes));
        of.score.iter_mut().zip(&group.of_score).for_each(|(to, lanes)| *to = sum(lanes));
        of
    };
    let found: Vec<Gradients> = runs.par_iter().map(of_run).collect();
    let summed = |of: fn(&Gradients) -> &[f32], len: usize| {
        let mut sums = vec![0.0f32; len];
        found.iter().for_each(|run| sums.iter_mut().zip(of(run)).for_each(|(sum, value)| *sum += value));
        sums
    };
    Gradients {
        known: placed(judge, proposals * channels, &runs, found.iter().map(|run| run.known.as_slice())),
        context: placed(judge, hidden, &runs, found.iter().map(|run| run.context.as_slice())),
        weights: summed(|run| &run.weights, hidden * channels),
        score: summed(|run| &run.score, hidden),
    }
}

/// Maps `[views, maps, pixels]` of their parts `[maps, pixels of the run]`.
fn placed<'a>(
    judge: &Judge,
    maps: usize,
    runs: &[(usize, usize, usize)],
    parts: impl Iterator<Item = &'a [f32]>,
) -> Vec<f32> {
    let mut whole = vec![0.0; judge.views * maps * judge.pixels];
    for (&(view, first, length), part) in runs.iter().zip(parts) {
        for (map, part) in part.chunks_exact(length).enumerate() {
            whole[(view * maps + map) * judge.pixels + first..][..length].copy_from_slice(part);
        }
    }
    whole
}

/// [`LANES`] neighbouring pixels.
struct Group {
    context: Vec<Lanes>,
    /// Of one proposal.
    known: Vec<Lanes>,
    /// Gradients: of the proposal last looked at, of the pixels, and of all pixels so far.
    of_known: Vec<Lanes>,
    of_context: Vec<Lanes>,
    of_weights: Vec<Lanes>,
    of_score: Vec<Lanes>,
}

impl Group {
    fn new(judge: &Judge) -> Self {
        let zeros = |count: usize| vec![[0.0; LANES]; count];
        let Judge { channels, hidden, .. } = *judge;
        Self {
            context: zeros(hidden),
            known: zeros(channels),
            of_known: zeros(channels),
            of_context: zeros(hidden),
            of_weights: zeros(hidden * channels),
            of_score: zeros(hidden),
        }
    }

    fn read_context(&mut self, judge: &Judge, inputs: &Inputs, view: usize, first: usize, count: usize) {
        let maps = &inputs.context[view * judge.hidden * judge.pixels..];
        read(&mut self.context, maps.chunks_exact(judge.pixels), first, count);
    }

    fn read_known(&mut self, judge: &Judge, inputs: &Inputs, view: usize, k: usize, first: usize, count: usize) {
        let maps = &inputs.known[(view * judge.proposals + k) * judge.channels * judge.pixels..];
        read(&mut self.known, maps.chunks_exact(judge.pixels), first, count);
    }

    /// A hidden value before it is cut off at zero.
    #[inline(always)]
    fn hidden(&self, weights: &[f32], h: usize) -> Lanes {
        let mut value = self.context[h];
        for (weight, known) in weights.iter().zip(&self.known) {
            each::<LANES>(|lane| value[lane] += weight * known[lane]);
        }
        value
    }

    /// Of the proposal read last.
    #[inline(always)]
    fn scores(&self, inputs: &Inputs) -> Lanes {
        let mut scores = [0.0; LANES];
        let layers = inputs.weights.chunks_exact(self.known.len()).zip(inputs.score);
        for (h, (weights, score)) in layers.enumerate() {
            let hidden = self.hidden(weights, h);
            each::<LANES>(|lane| scores[lane] += score * hidden[lane].max(0.0));
        }
        scores
    }

    /// Gradients of the proposal read last, given those of its scores.
    #[inline(always)]
    fn gradients(&mut self, inputs: &Inputs, grad: &Lanes) {
        let channels = self.known.len();
        self.of_known.fill([0.0; LANES]);
        let layers = inputs.weights.chunks_exact(channels).zip(inputs.score);
        for (h, (weights, score)) in layers.enumerate() {
            let hidden = self.hidden(weights, h);
            let (of_score, of_context) = (&mut self.of_score[h], &mut self.of_context[h]);
            let mut of_hidden = [0.0; LANES];
            each::<LANES>(|lane| {
                of_score[lane] += grad[lane] * hidden[lane].max(0.0);
                of_hidden[lane] = if hidden[lane] > 0.0 { score * grad[lane] } else { 0.0 };
                of_context[lane] += of_hidden[lane];
            });
            let of_weights = &mut self.of_weights[h * channels..][..channels];
            for (c, of_weight) in of_weights.iter_mut().enumerate() {
                let (known, of_known, weight) = (&self.known[c], &mut self.of_known[c], weights[c]);
                each::<LANES>(|lane| {
                    of_weight[lane] += of_hidden[lane] * known[lane];
                    of_known[lane] += of_hidden[lane] * weight;
                });
            }
        }
    }
}

/// The `count` values of each map from `first` on.
fn read<'a>(lanes: &mut [Lanes], maps: impl Iterator<Item = &'a [f32]>, first: usize, count: usize) {
    lanes.iter_mut().zip(maps).for_each(|(lanes, map)| lanes[..count].copy_from_slice(&map[first..][..count]));
}
