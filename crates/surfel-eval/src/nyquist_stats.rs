//! Does every surfel obey the Nyquist criterion? The histogram behind the paper's claim (spec 7.7).
//!
//! Collects [`frequency_ratio`] of the finer axis of each surfel: above 1 the images cannot have determined it.
//! Invariant: every surfel inside the depth range is counted once, in a bin or beyond the last one.

use crate::depth_metrics::median;
use serde::Serialize;
use surfel_core::nyquist::{NyquistMode, adapt, frequency_ratio, sampling_rate};

/// Number of histogram bins.
pub const NUM_BINS: usize = 100;
/// Upper end of the histogram; ratios beyond it are counted apart.
pub const MAX_RATIO: f64 = 5.0;

/// The smallest scale for which the paper's proof of its literal formula holds, `2 / pi` (millimetres).
const LITERAL_MIN_SCALE: f64 = 2.0 / std::f64::consts::PI + 1e-6;

/// One surfel as one view samples it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampledSurfel {
    /// Standard deviations along the tangents, scene units (millimetres for `PaperLiteral`).
    pub scales: [f32; 2],
    /// z-depth in the view, scene units.
    pub depth: f32,
    /// Focal lengths `[fx, fy]`, pixels of the picture the network saw.
    pub focal: [f64; 2],
}

impl SampledSurfel {
    /// Frequency of the finer axis over half the sampling rate.
    pub fn frequency_ratio(&self, mode: NyquistMode) -> f64 {
        frequency_ratio(self.finer_scale(mode), self.rate(mode))
    }

    /// The same after low-pass filtering with a kernel of `s` pixels.
    pub fn adapted_ratio(&self, mode: NyquistMode, s: f64) -> f64 {
        let rate = self.rate(mode);
        frequency_ratio(adapt(mode, self.finer_scale(mode), rate, s), rate)
    }

    fn rate(&self, mode: NyquistMode) -> f64 {
        sampling_rate(mode, self.focal[0], self.focal[1], f64::from(self.depth))
    }

    fn finer_scale(&self, mode: NyquistMode) -> f64 {
        let scale = f64::from(self.scales[0].min(self.scales[1]));
        match mode {
            NyquistMode::Consistent => scale,
            NyquistMode::PaperLiteral => scale.max(LITERAL_MIN_SCALE),
        }
    }
}

/// Distribution of frequency ratios.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NyquistHistogram {
    /// Counts of `[i, i + 1) * MAX_RATIO / NUM_BINS`.
    pub bins: Vec<u64>,
    /// Count at or beyond [`MAX_RATIO`].
    pub beyond: u64,
    /// Surfels counted.
    pub num_surfels: u64,
    /// Share with a ratio above 1, which break the criterion.
    pub fraction_above_one: f64,
    /// Median ratio; NaN without surfels (JSON null).
    pub median_ratio: f64,
    /// Largest ratio; 0 without surfels.
    pub max_ratio: f64,
}

impl NyquistHistogram {
    /// From ratios that are finite; others (a surfel no view samples) are left out.
    pub fn new(ratios: impl IntoIterator<Item = f64>) -> Self {
        let mut ratios: Vec<f64> = ratios.into_iter().filter(|r| r.is_finite() && *r >= 0.0).collect();
        let (mut bins, mut beyond) = (vec![0u64; NUM_BINS], 0u64);
        for &ratio in &ratios {
            match bins.get_mut((ratio * NUM_BINS as f64 / MAX_RATIO) as usize) {
                Some(bin) => *bin += 1,
                None => beyond += 1,
            }
        }
        let above_one = ratios.iter().filter(|&&ratio| ratio > 1.0).count();
        Self {
            bins,
            beyond,
            num_surfels: ratios.len() as u64,
            fraction_above_one: above_one as f64 / ratios.len().max(1) as f64,
            max_ratio: ratios.iter().copied().fold(0.0, f64::max),
            median_ratio: median(&mut ratios),
        }
    }
}

/// The histograms of spec 7.7 for surfels between `near` and `far`: as they are, and after adaptation by `s` pixels.
pub fn before_and_after(
    surfels: &[SampledSurfel],
    mode: NyquistMode,
    s: f64,
    near: f64,
    far: f64,
) -> [NyquistHistogram; 2] {
    let inside = || surfels.iter().filter(|surfel| (near..=far).contains(&f64::from(surfel.depth)));
    [
        NyquistHistogram::new(inside().map(|surfel| surfel.frequency_ratio(mode))),
        NyquistHistogram::new(inside().map(|surfel| surfel.adapted_ratio(mode, s))),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    #[test]
    fn a_footprint_of_two_over_pi_pixels_sits_exactly_at_one() {
        let of_footprint = |pixels: f64| SampledSurfel {
            scales: [(pixels * 700.0 / 600.0) as f32, 9.0],
            depth: 700.0,
            focal: [600.0, 600.0],
        };
        assert!((of_footprint(2.0 / PI).frequency_ratio(NyquistMode::Consistent) - 1.0).abs() < 1e-6);
        let surfels = [0.3, 0.5, 0.7, 2.0, 0.05].map(of_footprint);
        let [before, after] = before_and_after(&surfels, NyquistMode::Consistent, 1.0, 400.0, 900.0);
        assert_eq!((before.num_surfels, before.beyond), (5, 1));
        assert!((before.fraction_above_one - 0.6).abs() < 1e-12);
        assert_eq!(before.bins.iter().sum::<u64>() + before.beyond, 5);
        assert_eq!(before.bins[(2.0 / PI / 0.7 / 0.05) as usize], 1);
        assert_eq!(after.fraction_above_one, 0.0);
        assert_eq!(before_and_after(&surfels, NyquistMode::Consistent, 1.0, 1.0, 2.0)[0].num_surfels, 0);
    }

    proptest! {
        #[test]
        fn adapted_surfels_always_obey(
            scale in 1e-6f32..1e3, depth in 1e-2f32..1e4, fx in 10.0f64..5000.0, fy in 10.0f64..5000.0
        ) {
            let surfel = SampledSurfel { scales: [scale, scale * 2.0], depth, focal: [fx, fy] };
            prop_assert!(surfel.adapted_ratio(NyquistMode::Consistent, 1.0) <= 2.0 / PI + 1e-9);
            prop_assert!(surfel.adapted_ratio(NyquistMode::Consistent, 1.0) <= surfel.frequency_ratio(NyquistMode::Consistent));
        }
    }
}
