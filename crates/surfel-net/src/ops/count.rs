//! How much a computation multiplies and adds: every operator that does so in bulk tells it here.
//!
//! Convolutions, matrix products, attentions, sweeps and gathers are counted; elementwise work is not, as is the
//! custom of the field. Invariant: nothing is counted but inside [`multiply_adds`], on the calling thread.

use std::cell::Cell;

thread_local! {
    static COUNT: Cell<Option<u64>> = const { Cell::new(None) };
}

/// What `work` returns, and the number of its multiplications with addition, forward only.
pub fn multiply_adds<T>(work: impl FnOnce() -> T) -> (T, u64) {
    let outer = COUNT.replace(Some(0));
    let result = work();
    let counted = COUNT.replace(outer).unwrap_or(0);
    tell(counted);
    (result, counted)
}

/// Adds the product of `factors` to the count, where someone counts.
pub(crate) fn tell_product(factors: &[usize]) {
    tell(factors.iter().map(|factor| *factor as u64).product());
}

/// Adds to the count, where someone counts.
pub(crate) fn tell(number: u64) {
    COUNT.set(COUNT.get().map(|sum| sum + number));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::{conv3x3, group_norm};
    use crate::ops::attention;
    use burn::tensor::{Device, Distribution, Tensor};

    #[test]
    fn only_the_work_inside_is_counted_and_nesting_adds_up() {
        tell(5);
        let (inner, outer) = multiply_adds(|| {
            tell_product(&[2, 3]);
            multiply_adds(|| tell(4)).1
        });
        assert_eq!((inner, outer), (4, 10));
        assert_eq!(multiply_adds(|| ()).1, 0);
    }

    #[test]
    fn operators_tell_their_textbook_counts() {
        let device = Device::flex();
        let x = Tensor::<4>::random([2, 4, 6, 8], Distribution::Default, &device);
        let conv = conv3x3(4, 16, &device);
        assert_eq!(multiply_adds(|| conv.forward(x.clone())).1, 2 * 16 * 6 * 8 * 4 * 9);
        let norm = group_norm(4, 4, &device);
        assert_eq!(multiply_adds(|| norm.forward(x.clone())).1, 0);
        let key = Tensor::<4>::random([2, 4, 10, 8], Distribution::Default, &device);
        // Scores and weighted sums.
        assert_eq!(multiply_adds(|| attention(x, key.clone(), key, None)).1, 2 * 2 * 4 * 6 * 10 * 8);
    }
}
