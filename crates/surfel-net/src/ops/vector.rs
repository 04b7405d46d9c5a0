//! The vector loops that several kernels are made of.

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

/// At most one vector; what does not fit is dropped.
#[inline(always)]
pub(super) fn store<S: Simd>(simd: S, part: &mut [f32], value: S::f32s) {
    match S::as_mut_simd_f32s(part) {
        ([whole], _) => *whole = value,
        (_, tail) => simd.partial_store_f32s(tail, value),
    }
}

/// `sum a_i`, in an order that depends on the vector length only.
#[inline(always)]
pub(super) fn sum<S: Simd>(simd: S, values: &[f32]) -> f32 {
    let (whole, tail) = S::as_simd_f32s(values);
    let mut sums = [simd.splat_f32s(0.0); 4];
    let (fours, rest) = whole.as_chunks::<4>();
    for four in fours {
        for i in 0..4 {
            sums[i] = simd.add_f32s(sums[i], four[i]);
        }
    }
    for &value in rest {
        sums[0] = simd.add_f32s(sums[0], value);
    }
    let pairs = simd.add_f32s(simd.add_f32s(sums[0], sums[1]), simd.add_f32s(sums[2], sums[3]));
    simd.reduce_sum_f32s(pairs) + tail.iter().sum::<f32>()
}

/// Calls `work` for every lane, in a loop that the compiler turns into vectors.
#[inline(always)]
pub(super) fn each<const LANES: usize>(work: impl FnMut(usize)) {
    (0..LANES).for_each(work);
}
