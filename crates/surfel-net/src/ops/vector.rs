//! The two vector loops the attention and correlation kernels are made of.

use pulp::Simd;

/// `sum a_i b_i`, in an order that depends on the vector length only.
#[inline(always)]
pub(super) fn dot<S: Simd>(simd: S, a: &[f32], b: &[f32]) -> f32 {
    let ((a, a_tail), (b, b_tail)) = (S::as_simd_f32s(a), S::as_simd_f32s(b));
    let mut sum = simd.splat_f32s(0.0);
    for (&a, &b) in a.iter().zip(b) {
        sum = simd.mul_add_e_f32s(a, b, sum);
    }
    let tail: f32 = a_tail.iter().zip(b_tail).map(|(a, b)| a * b).sum();
    simd.reduce_sum_f32s(sum) + tail
}

/// `target += factor * source`.
#[inline(always)]
pub(super) fn add_scaled<S: Simd>(simd: S, target: &mut [f32], factor: f32, source: &[f32]) {
    let ((target, target_tail), (source, source_tail)) = (S::as_mut_simd_f32s(target), S::as_simd_f32s(source));
    let factors = simd.splat_f32s(factor);
    for (target, &source) in target.iter_mut().zip(source) {
        *target = simd.mul_add_e_f32s(factors, source, *target);
    }
    for (target, &source) in target_tail.iter_mut().zip(source_tail) {
        *target += factor * source;
    }
}

/// `target *= factor`.
#[inline(always)]
pub(super) fn scale<S: Simd>(simd: S, target: &mut [f32], factor: f32) {
    let (target, tail) = S::as_mut_simd_f32s(target);
    let factors = simd.splat_f32s(factor);
    for value in target {
        *value = simd.mul_f32s(*value, factors);
    }
    for value in tail {
        *value *= factor;
    }
}
