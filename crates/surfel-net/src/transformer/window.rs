//! Windows of a map, and which of their tokens may attend to each other when shifted.
//!
//! Invariant: [`Windows::merge`] undoes [`Windows::split`].

use burn::tensor::{Device, Tensor, TensorData};

/// Added to the score of tokens that became neighbours only by rolling the map.
const APART: f32 = -100.0;

/// A partition of `[views, height, width, channels]` maps into equal windows.
pub(super) struct Windows {
    /// Columns of one window.
    pub(super) width: usize,
    /// Rows of one window.
    pub(super) height: usize,
    splits: usize,
    /// Half a window `(columns, rows)` when shifted.
    shift: Option<(usize, usize)>,
}

impl Windows {
    pub(super) fn new(map_width: usize, map_height: usize, splits: usize, shifted: bool) -> Self {
        let (width, height) = (map_width / splits, map_height / splits);
        // One window holds the whole map: nothing to shift across.
        let shift = (shifted && splits > 1).then_some((width / 2, height / 2));
        Self { width, height, splits, shift }
    }

    /// Tokens of one window.
    pub(super) fn len(&self) -> usize {
        self.width * self.height
    }

    /// Number of windows.
    pub(super) fn count(&self) -> usize {
        self.splits * self.splits
    }

    /// `[views, height, width, C]` to `[views, windows, tokens, C]`.
    pub(super) fn split(&self, map: Tensor<4>) -> Tensor<4> {
        let [views, _, _, channels] = map.dims();
        let map = match self.shift {
            Some((dx, dy)) => roll(map, -(dx as isize), -(dy as isize)),
            None => map,
        };
        let blocks: Tensor<6> = map.reshape([views, self.splits, self.height, self.splits, self.width, channels]);
        blocks.permute([0, 1, 3, 2, 4, 5]).reshape([views, self.count(), self.len(), channels])
    }

    /// The inverse of [`Self::split`].
    pub(super) fn merge(&self, tokens: Tensor<4>) -> Tensor<4> {
        let [views, _, _, channels] = tokens.dims();
        let blocks: Tensor<6> = tokens.reshape([views, self.splits, self.splits, self.height, self.width, channels]);
        let map = blocks.permute([0, 1, 3, 2, 4, 5]);
        let map = map.reshape([views, self.splits * self.height, self.splits * self.width, channels]);
        match self.shift {
            Some((dx, dy)) => roll(map, dx as isize, dy as isize),
            None => map,
        }
    }

    /// `[windows, tokens, tokens]` to be added to scores; absent where everything may attend.
    pub(super) fn mask(&self, device: &Device) -> Option<Tensor<3>> {
        let (dx, dy) = self.shift?;
        let region = |position: usize, window: usize, shift: usize| {
            let total = window * self.splits;
            usize::from(position >= total - window) + usize::from(position >= total - shift)
        };
        let n = self.len();
        let mut data = Vec::with_capacity(self.count() * n * n);
        for w in 0..self.count() {
            let (wx, wy) = (w % self.splits * self.width, w / self.splits * self.height);
            let ids: Vec<usize> = (0..n)
                .map(|t| 3 * region(wy + t / self.width, self.height, dy) + region(wx + t % self.width, self.width, dx))
                .collect();
            for a in &ids {
                data.extend(ids.iter().map(|b| if a == b { 0.0 } else { APART }));
            }
        }
        Some(Tensor::from_data(TensorData::new(data, [self.count(), n, n]), device))
    }
}

/// Moves content right and down, what leaves re-entering on the other side.
fn roll(map: Tensor<4>, dx: isize, dy: isize) -> Tensor<4> {
    let [_, height, width, _] = map.dims();
    let turn = |map: Tensor<4>, dim: usize, len: usize, by: isize| {
        let by = by.rem_euclid(len as isize) as usize;
        if by == 0 {
            return map;
        }
        Tensor::cat(vec![map.clone().narrow(dim, len - by, by), map.narrow(dim, 0, len - by)], dim)
    };
    turn(turn(map, 1, height, dy), 2, width, dx)
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Int;

    #[test]
    fn merging_undoes_splitting_and_the_mask_separates_rolled_borders() {
        let device = Device::flex();
        let map = Tensor::<1, Int>::arange(0..2 * 8 * 12 * 3, &device).float().reshape([2, 8, 12, 3]);
        for shifted in [false, true] {
            let windows = Windows::new(12, 8, 2, shifted);
            let back = windows.merge(windows.split(map.clone()));
            back.into_data().assert_eq(&map.clone().into_data(), true);
        }
        let windows = Windows::new(12, 8, 2, true);
        let mask: Vec<f32> = windows.mask(&device).unwrap().into_data().try_to_vec().unwrap();
        let n = windows.len();
        // The first window holds one region; the last holds four of equal size.
        assert!(mask[..n * n].iter().all(|m| *m == 0.0));
        assert_eq!(mask[3 * n * n..].iter().filter(|m| **m == 0.0).count(), n * n / 4);
        assert!(Windows::new(12, 8, 2, false).mask(&device).is_none());
    }
}
