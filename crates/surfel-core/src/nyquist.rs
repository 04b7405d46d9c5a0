//! The Nyquist mathematics of the paper, in its dimensionally consistent form and as printed (spec 1.9).
//!
//! A surfel of standard deviation `s_u` (world length) has spatial frequency `1 / (pi s_u)`; an image
//! samples it at `f / z` pixels per length. Low-pass filtering with a kernel of `s` pixels widens the
//! surfel until two samples fall into one period. Invariant: after [`adapt`] in
//! [`NyquistMode::Consistent`], [`frequency_ratio`] is at most `2 / (pi s)` at every depth and in every unit.

use std::f64::consts::PI;

/// Which reading of the paper's formulas to use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NyquistMode {
    /// Rate per length, `sqrt(fx fy) / z`; the model's own (spec 1.9.3).
    #[default]
    Consistent,
    /// Rate per area, `fx fy / z²`, as printed; only for the paper's histogram, in millimetres.
    PaperLiteral,
}

/// Sampling rate of one view at z-depth `z` (paper eq. for `nu_hat`; spec 1.9.3).
///
/// `Consistent`: pixels per length. `PaperLiteral`: pixels per area. Zero for `z <= 0` (not visible).
pub fn sampling_rate(mode: NyquistMode, fx: f64, fy: f64, z: f64) -> f64 {
    if z <= 0.0 {
        return 0.0;
    }
    match mode {
        NyquistMode::Consistent => (fx * fy).sqrt() / z,
        NyquistMode::PaperLiteral => fx * fy / (z * z),
    }
}

/// The multi-view rate: the finest over the views in which the surfel is visible.
pub fn multi_view_rate(rates_of_visible_views: impl IntoIterator<Item = f64>) -> f64 {
    rates_of_visible_views.into_iter().fold(0.0, f64::max)
}

/// Scale after low-pass filtering with a kernel of standard deviation `s` pixels (spec C1).
///
/// A surfel no view samples (`rate == 0`) is returned unchanged.
pub fn adapt(mode: NyquistMode, scale: f64, rate: f64, s: f64) -> f64 {
    if rate <= 0.0 {
        return scale;
    }
    match mode {
        NyquistMode::Consistent => scale.hypot(s / rate),
        NyquistMode::PaperLiteral => scale * (1.0 + (s / rate) * (s / rate)).sqrt(),
    }
}

/// Surfel frequency over half the sampling rate; the Nyquist criterion holds where this is at most 1.
pub fn frequency_ratio(scale: f64, rate: f64) -> f64 {
    2.0 / (PI * scale * rate)
}
