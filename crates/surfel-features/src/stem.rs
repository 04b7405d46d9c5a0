//! The first layer: normalise, 3x3 convolution with stride 2, ReLU6.
//!
//! Invariant: reads the image through edge replication, so the caller never copies a padded image; the
//! one row and column that "same" padding adds beyond it are zeros in normalised units, as in training.

use crate::FeatureMap;
use crate::pointwise::{Activation, Pointwise};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use surfel_core::Grid;

/// ImageNet statistics of sRGB in \[0, 1\], the ones the trunk was trained with.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const STD: [f32; 3] = [0.229, 0.224, 0.225];

/// Values under one 3x3 window of three channels.
const WINDOW: usize = 27;

/// The first convolution, as a matrix product over gathered windows.
#[derive(Clone, Debug)]
pub(super) struct Stem {
    conv: Pointwise,
}

impl Stem {
    /// From folded weights `[out, 3, 3, 3]` (output, input channel, row, column).
    pub(super) fn new(weights: &[f32], bias: &[f32]) -> Self {
        let by_pixel: Vec<f32> = (0..weights.len())
            .map(|i| {
                let (out, tap, channel) = (i / WINDOW, i % WINDOW / 3, i % 3);
                weights[out * WINDOW + channel * 9 + tap]
            })
            .collect();
        Self { conv: Pointwise::new(&by_pixel, bias, WINDOW) }
    }

    /// The stride-2 map of an image padded to `padded_width` x `padded_height` (both even).
    pub(super) fn run(&self, image: &Grid<[f32; 3]>, padded_width: usize, padded_height: usize) -> FeatureMap {
        let (width, height, channels) = (padded_width / 2, padded_height / 2, self.conv.num_outputs);
        let mut data = vec![0.0; width * height * channels];
        data.par_chunks_mut(width * channels).enumerate().for_each_init(
            || vec![0.0; width * WINDOW],
            |windows, (y, output)| {
                gather(image, y, padded_width, padded_height, windows);
                Arch::new().dispatch(StemRow { conv: &self.conv, windows, output });
            },
        );
        FeatureMap { channels, width, height, stride: 2, data }
    }
}

struct StemRow<'a> {
    conv: &'a Pointwise,
    windows: &'a [f32],
    output: &'a mut [f32],
}

impl WithSimd for StemRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.conv.apply(simd, self.windows, self.output, Activation::Relu6);
    }
}

/// The normalised windows of output row `y`, `[output column][row, column, channel]`.
fn gather(image: &Grid<[f32; 3]>, y: usize, padded_width: usize, padded_height: usize, windows: &mut [f32]) {
    for dy in 0..3 {
        let source_y = 2 * y + dy;
        let row = (source_y < padded_height).then(|| image.row(source_y.min(image.height() - 1)));
        for (x, window) in windows.chunks_exact_mut(WINDOW).enumerate() {
            for dx in 0..3 {
                let source_x = 2 * x + dx;
                let target = &mut window[(dy * 3 + dx) * 3..][..3];
                match row {
                    Some(row) if source_x < padded_width => {
                        let pixel = row[source_x.min(row.len() - 1)];
                        for c in 0..3 {
                            target[c] = (pixel[c] - MEAN[c]) / STD[c];
                        }
                    }
                    _ => target.fill(0.0),
                }
            }
        }
    }
}
