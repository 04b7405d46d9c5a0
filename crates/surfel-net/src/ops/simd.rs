//! Runs a plain-Rust kernel with the widest vector instructions of the machine.
//!
//! The compiler vectorises the loops of a [`Kernel`]; this module only chooses, at run time, the
//! instruction set they are compiled for. Invariant: a kernel sees `FUSED` true only where a fused
//! multiply-add is one instruction (elsewhere it would be a slow library call).

use pulp::{Arch, Simd, WithSimd};

/// Work written as plain loops, marked `#[inline(always)]` down to the innermost.
pub(crate) trait Kernel {
    /// Does the work.
    fn run<const FUSED: bool>(self);
}

struct Vectorised<K>(K);

impl<K: Kernel> WithSimd for Vectorised<K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        if S::IS_SCALAR {
            self.0.run::<false>();
        } else {
            self.0.run::<true>();
        }
    }
}

/// Runs `kernel`.
pub(crate) fn dispatch(kernel: impl Kernel) {
    Arch::new().dispatch(Vectorised(kernel));
}

/// `a * b + c`.
#[inline(always)]
pub(crate) fn multiply_add<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}
