//! A block of rows of all channels of one map, with zeros around it.
//!
//! Columns are split by their remainder modulo the step, so that what neighbouring outputs read is
//! neighbouring. Invariant: what follows the last row of a channel is [`GAP`] zeros, so that whole vectors can
//! be read from any place of the channel.

/// Zeros after each channel: two vectors of sixteen, the most that is read at once.
pub(super) const GAP: usize = 32;

/// Shape of the block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Padded {
    /// Channels of the map.
    pub(super) channels: usize,
    /// Rows of the block, padding included.
    pub(super) rows: usize,
    /// Output columns that read from it.
    pub(super) columns: usize,
    /// How far to the right of its first column an output reads.
    pub(super) reach: usize,
    /// Map columns per output column.
    pub(super) step: usize,
    /// Zeros before the first column.
    pub(super) before: usize,
}

impl Padded {
    /// Floats of one row of one remainder.
    fn pitch(&self) -> usize {
        self.columns + self.reach / self.step
    }

    /// Floats from one row to the next.
    pub(super) fn row_len(&self) -> usize {
        self.step * self.pitch()
    }

    /// Floats from one channel to the next.
    pub(super) fn channel_len(&self) -> usize {
        self.rows * self.row_len() + GAP
    }

    /// Floats of the block.
    pub(super) fn len(&self) -> usize {
        self.channels * self.channel_len()
    }

    /// Where what output column 0 reads from the given channel, row and padded column lies.
    pub(super) fn offset(&self, channel: usize, row: usize, column: usize) -> usize {
        let column = column % self.step * self.pitch() + column / self.step;
        channel * self.channel_len() + row * self.row_len() + column
    }

    /// Copies rows from `first_row` on (negative: above the map) of a map with `size` rows and columns into a
    /// block that began as zeros.
    pub(super) fn fill(&self, map: &[f32], size: (usize, usize), first_row: isize, block: &mut [f32]) {
        let (height, width) = size;
        for (channel, block) in block.chunks_exact_mut(self.channel_len()).enumerate() {
            let block = &mut block[..self.rows * self.row_len()];
            for (row, y) in block.chunks_exact_mut(self.row_len()).zip(first_row..) {
                if y < 0 || y >= height as isize {
                    row.fill(0.0);
                    continue;
                }
                let source = &map[(channel * height + y as usize) * width..][..width];
                for (remainder, target) in row.chunks_exact_mut(self.pitch()).enumerate() {
                    self.fill_row(source, remainder, target);
                }
            }
        }
    }

    fn fill_row(&self, source: &[f32], remainder: usize, target: &mut [f32]) {
        // Target `j` is source column `j * step + remainder - before`.
        let first = self.before.saturating_sub(remainder).div_ceil(self.step).min(target.len());
        let start = first * self.step + remainder - self.before;
        target[..first].fill(0.0);
        let source = source.get(start..).unwrap_or(&[]);
        let len = source.len().div_ceil(self.step).min(target.len() - first);
        let (inside, behind) = target[first..].split_at_mut(len);
        if self.step == 1 {
            inside.copy_from_slice(&source[..len]);
        } else {
            inside.iter_mut().zip(source.iter().step_by(self.step)).for_each(|(target, &source)| *target = source);
        }
        behind.fill(0.0);
    }
}
