//! Group normalisation, the activation after it and a residual sum, in one pass over maps
//! `[images, channels, pixels]`.
//!
//! The values of a group lie side by side, so a task owns one group of one image. Invariant: sums run in an order
//! that the sizes alone decide.

use super::activation::{Activation, Curve, OnCurve, on_curve};
use super::kernel::{Kernel, SLOTS, blank, run, runs_on};
use super::vector::{dot, sum};
use burn::nn::GroupNorm;
use burn::tensor::Tensor;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::marker::PhantomData;

/// Values whose products are summed in single precision before they join a sum in double precision.
const RUN: usize = 1024;

/// The sizes of a normalisation and what follows it.
#[derive(Clone, Debug)]
pub struct Normalisation {
    /// `[images, channels, height, width]`.
    pub shape: [usize; 4],
    /// Groups that the channels are divided into.
    pub groups: usize,
    /// Added to the variance.
    pub epsilon: f32,
    /// After scale and shift.
    pub activation: Activation,
    /// True when a further map is added to the output.
    pub residual: bool,
}

impl Normalisation {
    fn channels(&self) -> usize {
        self.shape[1] / self.groups
    }

    fn pixels(&self) -> usize {
        self.shape[2] * self.shape[3]
    }

    fn check(&self, inputs: &[&[f32]; SLOTS]) {
        let [images, channels, ..] = self.shape;
        let len = images * channels * self.pixels();
        assert!(channels.is_multiple_of(self.groups), "{self:?} does not divide its channels");
        assert_eq!(inputs[0].len(), len, "input of {self:?}");
        assert_eq!([inputs[1].len(), inputs[2].len()], [channels; 2], "scale and shift of {self:?}");
        assert!(!self.residual || inputs[3].len() == len, "residual of {self:?}");
    }
}

/// Inputs are the maps, scales and shifts `[channels]`, and the maps added at the end.
impl Kernel for Normalisation {
    fn shape(&self) -> Vec<usize> {
        self.shape.to_vec()
    }

    fn forward(&self, inputs: &[&[f32]; SLOTS]) -> Vec<f32> {
        self.check(inputs);
        let mut output = vec![0.0; inputs[0].len()];
        if output.is_empty() {
            return output;
        }
        let len = self.channels() * self.pixels();
        output.par_chunks_exact_mut(len).enumerate().for_each(|(i, output)| {
            let [x, residual] = [0, 3].map(|slot| inputs[slot].get(i * len..(i + 1) * len).unwrap_or_default());
            let first = i % self.groups * self.channels();
            let [scales, shifts] = [1, 2].map(|slot| &inputs[slot][first..first + self.channels()]);
            let residual = self.residual.then_some(residual);
            on_curve(self.activation, Forward { sizes: self, x, scales, shifts, residual, output });
        });
        output
    }

    fn backward(&self, inputs: &[&[f32]; SLOTS], grad: &[f32], wanted: [bool; SLOTS]) -> [Option<Vec<f32>>; SLOTS] {
        self.check(inputs);
        let (channels, pixels) = (self.shape[1], self.pixels());
        let mut of_x = vec![0.0; inputs[0].len()];
        let (mut of_scales, mut of_shifts) = (vec![0.0; channels], vec![0.0; channels]);
        if !of_x.is_empty() {
            let len = self.channels() * pixels;
            let one = |(i, of_x): (usize, &mut [f32])| -> Vec<[f64; 2]> {
                let [x, grad] = [inputs[0], grad].map(|values| &values[i * len..(i + 1) * len]);
                let first = i % self.groups * self.channels();
                let [scales, shifts] = [1, 2].map(|slot| &inputs[slot][first..first + self.channels()]);
                on_curve(self.activation, Backward { sizes: self, x, scales, shifts, grad, of_x })
            };
            let sums: Vec<Vec<[f64; 2]>> = of_x.par_chunks_exact_mut(len).enumerate().map(one).collect();
            for (channel, [scale, shift]) in sums.iter().flatten().enumerate() {
                of_scales[channel % channels] += *scale as f32;
                of_shifts[channel % channels] += *shift as f32;
            }
        }
        [
            wanted[0].then_some(of_x),
            wanted[1].then_some(of_scales),
            wanted[2].then_some(of_shifts),
            (wanted[3] && self.residual).then(|| grad.to_vec()),
            None,
        ]
    }
}

/// Mean, and one over the standard deviation.
#[inline(always)]
fn statistics<S: Simd>(simd: S, x: &[f32], epsilon: f32) -> (f32, f32) {
    let count = x.len() as f64;
    let mean = x.chunks(RUN).map(|run| f64::from(sum(simd, run))).sum::<f64>() / count;
    let mean = mean as f32;
    let mut variance = 0.0;
    let mut centred = [0.0f32; RUN];
    for run in x.chunks(RUN) {
        let centred = &mut centred[..run.len()];
        centred.iter_mut().zip(run).for_each(|(c, x)| *c = x - mean);
        variance += f64::from(dot(simd, centred, centred));
    }
    (mean, (1.0 / (variance / count + f64::from(epsilon)).sqrt()) as f32)
}

struct Forward<'a> {
    sizes: &'a Normalisation,
    x: &'a [f32],
    scales: &'a [f32],
    shifts: &'a [f32],
    residual: Option<&'a [f32]>,
    output: &'a mut [f32],
}

impl OnCurve for Forward<'_> {
    type Output = ();

    fn on<C: Curve>(self) {
        Arch::new().dispatch(Typed::<_, C>(self, PhantomData));
    }
}

/// The work with the curve known to the compiler.
struct Typed<W, C>(W, PhantomData<C>);

impl<C: Curve> WithSimd for Typed<Forward<'_>, C> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Forward { sizes, x, scales, shifts, residual, output } = self.0;
        let (mean, gain) = statistics(simd, x, sizes.epsilon);
        let pixels = sizes.pixels();
        for (c, (output, x)) in output.chunks_exact_mut(pixels).zip(x.chunks_exact(pixels)).enumerate() {
            let (scale, shift) = (scales[c] * gain, shifts[c]);
            let value = |x: f32| C::value((x - mean) * scale + shift);
            match residual {
                Some(residual) => {
                    let residual = &residual[c * pixels..(c + 1) * pixels];
                    output.iter_mut().zip(x).zip(residual).for_each(|((y, &x), r)| *y = r + value(x));
                }
                None => output.iter_mut().zip(x).for_each(|(y, &x)| *y = value(x)),
            }
        }
    }
}

struct Backward<'a> {
    sizes: &'a Normalisation,
    x: &'a [f32],
    scales: &'a [f32],
    shifts: &'a [f32],
    grad: &'a [f32],
    of_x: &'a mut [f32],
}

impl OnCurve for Backward<'_> {
    type Output = Vec<[f64; 2]>;

    fn on<C: Curve>(self) -> Vec<[f64; 2]> {
        Arch::new().dispatch(Typed::<_, C>(self, PhantomData))
    }
}

impl<C: Curve> WithSimd for Typed<Backward<'_>, C> {
    /// Gradients of scale and shift of each channel.
    type Output = Vec<[f64; 2]>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<[f64; 2]> {
        let Backward { sizes, x, scales, shifts, grad, of_x } = self.0;
        let (mean, gain) = statistics(simd, x, sizes.epsilon);
        let pixels = sizes.pixels();
        let mut normed = [0.0f32; RUN];
        let mut of_channels = Vec::with_capacity(scales.len());
        // First the gradient before the activation, and its sums; then what it makes of the input.
        for c in 0..scales.len() {
            let channel = c * pixels..(c + 1) * pixels;
            let (scale, shift) = (scales[c], shifts[c]);
            let mut sums = [0.0f64; 2];
            let runs = of_x[channel.clone()].chunks_mut(RUN).zip(x[channel.clone()].chunks(RUN));
            for ((of_x, x), grad) in runs.zip(grad[channel].chunks(RUN)) {
                let normed = &mut normed[..x.len()];
                normed.iter_mut().zip(x).for_each(|(n, x)| *n = (x - mean) * gain);
                let slope = |n: f32| C::slope(n * scale + shift);
                of_x.iter_mut().zip(&*normed).zip(grad).for_each(|((d, &n), g)| *d = g * slope(n));
                sums[0] += f64::from(dot(simd, of_x, normed));
                sums[1] += f64::from(sum(simd, of_x));
            }
            of_channels.push(sums);
        }
        let weighed = |i: usize| -> f64 {
            let sum: f64 = scales.iter().zip(&of_channels).map(|(scale, sums)| f64::from(*scale) * sums[i]).sum();
            sum / x.len() as f64
        };
        let (tilt, level) = (weighed(0) as f32, weighed(1) as f32);
        for (c, (of_x, x)) in of_x.chunks_exact_mut(pixels).zip(x.chunks_exact(pixels)).enumerate() {
            let scale = scales[c];
            let change = |d: f32, x: f32| gain * (scale * d - level - (x - mean) * gain * tilt);
            of_x.iter_mut().zip(x).for_each(|(d, &x)| *d = change(*d, x));
        }
        of_channels
    }
}

/// `activation(norm(x))`, plus `residual`; made of burn's own operators where our kernels do not run.
pub fn group_norm(norm: &GroupNorm, x: Tensor<4>, activation: Activation, residual: Option<Tensor<4>>) -> Tensor<4> {
    let device = x.device();
    let (Some(scales), Some(shifts), true) = (&norm.gamma, &norm.beta, runs_on(&device)) else {
        let y = activation.by_burn(norm.forward(x));
        return match residual {
            Some(residual) => residual + y,
            None => y,
        };
    };
    let kernel = Normalisation {
        shape: x.dims(),
        groups: norm.num_groups,
        epsilon: norm.epsilon as f32,
        activation,
        residual: residual.is_some(),
    };
    let residual = residual.map_or_else(|| blank(&device), Tensor::into_dispatch);
    let [scales, shifts] = [scales, shifts].map(|param| param.val().into_dispatch());
    run(&device, [x.into_dispatch(), scales, shifts, residual], kernel)
}
