//! The smooth steps between layers, their slopes, and the kernel that applies one to every value.
//!
//! Plain arithmetic without branches, so that the compiler turns the loops into vectors; `exp` and the Gaussian
//! integral are polynomials here. Invariant: within 1e-6 of the exact function for arguments of any size.

use super::kernel::{Kernel, SLOTS, run, runs_on};
use burn::tensor::Tensor;
use burn::tensor::activation as burn_activation;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Values per task.
const BLOCK: usize = 16 * 1024;

/// What follows a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// Nothing.
    Identity,
    /// `max(x, 0)`.
    Relu,
    /// `x / (1 + exp(-x))`.
    Silu,
    /// `x` times the probability that a standard normal variable is below it.
    Gelu,
}

impl Activation {
    /// The same made of burn's own operators.
    pub(crate) fn by_burn<const D: usize>(self, x: Tensor<D>) -> Tensor<D> {
        match self {
            Self::Identity => x,
            Self::Relu => burn_activation::relu(x),
            Self::Silu => burn_activation::silu(x),
            Self::Gelu => burn_activation::gelu(x),
        }
    }
}

/// A function and its derivative, as a type so that loops know it when they are compiled.
pub(super) trait Curve: Sync {
    fn value(x: f32) -> f32;
    fn slope(x: f32) -> f32;
}

pub(super) struct Identity;
pub(super) struct Relu;
pub(super) struct Silu;
pub(super) struct Gelu;

impl Curve for Identity {
    #[inline(always)]
    fn value(x: f32) -> f32 {
        x
    }
    #[inline(always)]
    fn slope(_: f32) -> f32 {
        1.0
    }
}

impl Curve for Relu {
    #[inline(always)]
    fn value(x: f32) -> f32 {
        x.max(0.0)
    }
    #[inline(always)]
    fn slope(x: f32) -> f32 {
        if x > 0.0 { 1.0 } else { 0.0 }
    }
}

impl Curve for Silu {
    #[inline(always)]
    fn value(x: f32) -> f32 {
        x / (1.0 + exp(-x))
    }
    #[inline(always)]
    fn slope(x: f32) -> f32 {
        let share = 1.0 / (1.0 + exp(-x));
        share * (1.0 + x * (1.0 - share))
    }
}

impl Curve for Gelu {
    #[inline(always)]
    fn value(x: f32) -> f32 {
        x * below(x).0
    }
    #[inline(always)]
    fn slope(x: f32) -> f32 {
        let (below, bell) = below(x);
        below + x * bell
    }
}

/// `exp(x)`, relative error below 2e-7; `x` is held within the range of normal numbers.
#[inline(always)]
pub(super) fn exp(x: f32) -> f32 {
    // Adding 1.5 * 2^23 rounds to an integer and leaves it in the low bits.
    const ROUND: f32 = 12_582_912.0;
    let x = x.clamp(-87.0, 88.0);
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let whole = shifted - ROUND;
    // ln 2 in two parts, the first of which is exact times any such integer.
    let rest = (x - whole * 0.693_359_4) + whole * 2.121_944_4e-4;
    let mut power = 1.987_569_1e-4;
    for factor in [1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 0.166_666_65, 0.5] {
        power = power * rest + factor;
    }
    let fraction = power * rest * rest + rest + 1.0;
    fraction * f32::from_bits((shifted.to_bits() << 23).wrapping_add(1.0f32.to_bits()))
}

/// The standard normal distribution: the probability of less than `x`, and the density there (Abramowitz and
/// Stegun 7.1.26).
#[inline(always)]
fn below(x: f32) -> (f32, f32) {
    let t = 1.0 / (1.0 + 0.327_591_1 * std::f32::consts::FRAC_1_SQRT_2 * x.abs());
    let bell = exp(-0.5 * x * x);
    let mut tail = 1.061_405_4;
    for factor in [-1.453_152, 1.421_413_7, -0.284_496_74, 0.254_829_6] {
        tail = tail * t + factor;
    }
    let tail = 0.5 * tail * t * bell;
    (if x > 0.0 { 1.0 - tail } else { tail }, bell * 0.398_942_3)
}

/// Runs a loop that is compiled once per curve.
pub(super) trait OnCurve {
    type Output;
    fn on<C: Curve>(self) -> Self::Output;
}

pub(super) fn on_curve<W: OnCurve>(activation: Activation, work: W) -> W::Output {
    match activation {
        Activation::Identity => work.on::<Identity>(),
        Activation::Relu => work.on::<Relu>(),
        Activation::Silu => work.on::<Silu>(),
        Activation::Gelu => work.on::<Gelu>(),
    }
}

/// An activation of every value of an array.
#[derive(Debug)]
pub struct Elementwise {
    /// Which.
    pub activation: Activation,
    /// Shape of input and output.
    pub shape: Vec<usize>,
}

impl Kernel for Elementwise {
    fn shape(&self) -> Vec<usize> {
        self.shape.clone()
    }

    fn forward(&self, inputs: &[&[f32]; SLOTS]) -> Vec<f32> {
        forward(self.activation, inputs[0])
    }

    fn backward(&self, inputs: &[&[f32]; SLOTS], grad: &[f32], wanted: [bool; SLOTS]) -> [Option<Vec<f32>>; SLOTS] {
        [wanted[0].then(|| backward(self.activation, inputs[0], grad)), None, None, None, None]
    }
}

/// `activation(x)`.
pub fn forward(activation: Activation, x: &[f32]) -> Vec<f32> {
    let mut output = vec![0.0; x.len()];
    let blocks = output.par_chunks_mut(BLOCK).zip(x.par_chunks(BLOCK));
    blocks.for_each(|(output, x)| on_curve(activation, Map { x, grad: None, output }));
    output
}

/// `grad` times the slope at `x`.
pub fn backward(activation: Activation, x: &[f32], grad: &[f32]) -> Vec<f32> {
    assert_eq!(x.len(), grad.len(), "gradient of an activation");
    let mut output = vec![0.0; x.len()];
    let blocks = output.par_chunks_mut(BLOCK).zip(x.par_chunks(BLOCK)).zip(grad.par_chunks(BLOCK));
    blocks.for_each(|((output, x), grad)| on_curve(activation, Map { x, grad: Some(grad), output }));
    output
}

/// Values, or slopes times gradients.
struct Map<'a> {
    x: &'a [f32],
    grad: Option<&'a [f32]>,
    output: &'a mut [f32],
}

impl OnCurve for Map<'_> {
    type Output = ();

    fn on<C: Curve>(self) {
        struct Typed<'a, C>(Map<'a>, std::marker::PhantomData<C>);
        impl<C: Curve> WithSimd for Typed<'_, C> {
            type Output = ();
            #[inline(always)]
            fn with_simd<S: Simd>(self, _: S) {
                let Map { x, grad, output } = self.0;
                match grad {
                    None => output.iter_mut().zip(x).for_each(|(y, &x)| *y = C::value(x)),
                    Some(grad) => {
                        output.iter_mut().zip(x).zip(grad).for_each(|((y, &x), &grad)| *y = grad * C::slope(x));
                    }
                }
            }
        }
        Arch::new().dispatch(Typed::<C>(self, std::marker::PhantomData));
    }
}

/// The activation of every value of a tensor; burn's own where our kernels do not run.
fn activate<const D: usize>(x: Tensor<D>, activation: Activation) -> Tensor<D> {
    let device = x.device();
    if !runs_on(&device) || activation == Activation::Identity {
        return activation.by_burn(x);
    }
    let kernel = Elementwise { activation, shape: x.dims().to_vec() };
    run(&device, [x.into_dispatch()], kernel)
}

pub(crate) fn gelu<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    activate(x, Activation::Gelu)
}

pub(crate) fn relu<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    activate(x, Activation::Relu)
}
