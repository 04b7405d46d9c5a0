//! Vectors out of plain slices, for the kernels that run on many pixels at once.
//!
//! A kernel is written once over [`pulp::Simd`] and compiled for every instruction set; which one runs is
//! chosen when the program starts. Invariant: lanes are pixels and never mix, so that a result depends neither
//! on where a row is cut into vectors nor on the number of threads.

use pulp::Simd;

/// Rows of pixels are padded to a multiple of this: the most lanes any instruction set has.
pub const MAX_LANES: usize = 16;

/// The vector of `data` that begins at `at`.
#[inline(always)]
pub fn load<S: Simd>(_: S, data: &[f32], at: usize) -> S::f32s {
    S::as_simd_f32s(&data[at..][..S::F32_LANES]).0[0]
}

/// Writes `values` to `data` from `at` on.
#[inline(always)]
pub fn store<S: Simd>(_: S, data: &mut [f32], at: usize, values: S::f32s) {
    S::as_mut_simd_f32s(&mut data[at..][..S::F32_LANES]).0[0] = values;
}

/// The whole number that `value` is, from 0 to 8388607; a plain cast would not become a vector instruction.
#[inline(always)]
pub fn whole(value: f32) -> u32 {
    // From 2^23 on, the unit of the last place of an f32 is one.
    (value + 8_388_608.0).to_bits() & 0x7f_ffff
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_are_kept() {
        assert!((0..8_388_608).step_by(97).chain([8_388_607]).all(|n: u32| whole(n as f32) == n));
    }
}
