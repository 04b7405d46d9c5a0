//! Peak signal-to-noise ratio of two pictures (spec 7.4).
//!
//! Invariant: pictures are clipped to \[0, 1\] first, so the peak is 1 and a value outside never counts twice.

use surfel_core::Grid;

/// `-10 log10(MSE)` over all pixels and channels, decibels; infinite for equal pictures, NaN for empty ones.
///
/// # Panics
/// If the pictures differ in size.
pub fn psnr(picture: &Grid<[f32; 3]>, reference: &Grid<[f32; 3]>) -> f64 {
    assert!(picture.same_size(reference), "pictures differ in size");
    let clipped = |c: f32| f64::from(c.clamp(0.0, 1.0));
    let squares = picture
        .as_slice()
        .iter()
        .zip(reference.as_slice())
        .map(|(a, b)| (0..3).map(|i| (clipped(a[i]) - clipped(b[i])).powi(2)).sum::<f64>());
    -10.0 * (squares.sum::<f64>() / (3 * picture.len()) as f64).log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_everywhere_is_twenty_decibels_and_equal_is_infinite() {
        let (a, b) = (Grid::filled(5, 4, [0.4f32; 3]), Grid::filled(5, 4, [0.5f32; 3]));
        assert!((psnr(&a, &b) - 20.0).abs() < 1e-5);
        assert_eq!(psnr(&a, &a), f64::INFINITY);
        // 1.7 and 1.0 look the same on a screen.
        assert_eq!(psnr(&Grid::filled(5, 4, [1.7; 3]), &Grid::filled(5, 4, [1.0; 3])), f64::INFINITY);
    }
}
