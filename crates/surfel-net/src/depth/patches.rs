//! Small windows of the photographs as feature vectors, so that a plane sweep over them is a correlation.
//!
//! The photometric half of what the refinement sees at each proposed plane; the learned half are its features.
//! Invariant: a vector knows neither the brightness nor the contrast of its window, and a window without
//! texture is (nearly) zero.

use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;
use surfel_core::Grid;

/// Pixels from the middle of a window to its edge.
const RADIUS: isize = 2;
/// Values of a window.
const LEN: usize = (2 * RADIUS as usize + 1) * (2 * RADIUS as usize + 1);
/// Luma variance, summed over a window, below which texture is noise.
const FLOOR: f32 = 25.0 * 4e-5;

/// Windows about every `stride`th pixel, `[views, values, height / stride, width / stride]`; the product of two,
/// over the root of their length as the plane sweep divides, is their correlation.
pub(crate) fn patches(images: &[Grid<[f32; 3]>], stride: usize, device: &Device) -> Tensor<4> {
    let (columns, rows) = (images[0].width() / stride, images[0].height() / stride);
    let mut values = vec![0.0f32; images.len() * rows * columns * LEN];
    for (image, values) in images.iter().zip(values.chunks_exact_mut(rows * columns * LEN)) {
        let luma = image.map(|[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b);
        values.par_chunks_mut(columns * LEN).enumerate().for_each(|(row, values)| {
            for (column, patch) in values.chunks_exact_mut(LEN).enumerate() {
                read(&luma, column * stride, row * stride, patch);
            }
        });
    }
    let shape = [images.len(), rows, columns, LEN];
    Tensor::<4>::from_data(TensorData::new(values, shape), device).permute([0, 3, 1, 2])
}

fn read(luma: &Grid<f32>, x: usize, y: usize, patch: &mut [f32]) {
    let at = |at: usize, by: isize, len: usize| (at as isize + by).clamp(0, len as isize - 1) as usize;
    let side = 2 * RADIUS as usize + 1;
    for (i, value) in patch.iter_mut().enumerate() {
        let (dx, dy) = ((i % side) as isize - RADIUS, (i / side) as isize - RADIUS);
        *value = luma[(at(x, dx, luma.width()), at(y, dy, luma.height()))];
    }
    let mean = patch.iter().sum::<f32>() / LEN as f32;
    let energy: f32 = patch.iter().map(|value| (value - mean) * (value - mean)).sum();
    let gain = (LEN as f32).sqrt().sqrt() / (energy + FLOOR).sqrt();
    patch.iter_mut().for_each(|value| *value = gain * (*value - mean));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_product_is_a_correlation_that_knows_no_brightness() {
        let texture = |x: usize, y: usize| (0.9 * x as f32).sin() * (0.7 * y as f32 + 0.4).cos();
        let image = |gain: f32, offset: f32| Grid::from_fn(16, 12, |x, y| [offset + gain * texture(x, y); 3]);
        let images = [image(0.2, 0.5), image(0.1, 0.3), image(0.0, 0.4)];
        let patches = patches(&images, 2, &Device::flex()).permute([0, 2, 3, 1]).into_data();
        let patches: Vec<f32> = patches.try_into_vec().unwrap();
        let patch = |view: usize, i: usize| &patches[(view * 48 + i) * LEN..][..LEN];
        for i in 0..48 {
            let dot = |a: usize, b: usize| {
                let sum: f32 = patch(a, i).iter().zip(patch(b, i)).map(|(a, b)| a * b).sum();
                sum / (LEN as f32).sqrt()
            };
            assert!(dot(0, 1) > 0.95 && dot(0, 1) < 1.0 + 1e-5, "{}", dot(0, 1));
            assert!(dot(0, 2).abs() < 1e-3);
        }
    }
}
