//! Which neighbouring pixels show one surface.
//!
//! Asked by the mask, which removes the pixels beside a depth edge, and by the lookups of the field, which interpolate
//! only within a surface. A jump in depth alone does not tell: ground that is seen at a grazing angle jumps from pixel
//! to pixel as well. But inverse depth is affine in the pixel for any plane, so ground goes on as it came, on both
//! sides of the pair, and an edge does not. Invariant: two pixels whose depths differ by no more than `max_jump` are one
//! surface, two that differ by more than [`STEEPEST_DEG`] allows are not, whatever lies beside them.

/// Angle between line of sight and normal beyond which no surface goes on, degrees; a pixel of it is twenty times as long
/// as it is wide.
const STEEPEST_DEG: f64 = 87.0;

/// The rule for one view.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Continuity {
    /// Largest relative difference of two inverse depths, or of one from where a plane would have it.
    max_jump: f64,
    /// Largest relative rise per pixel.
    max_rise: f64,
}

impl Continuity {
    /// `max_jump` is a fraction of the nearer depth, `focal` the focal length, pixels.
    pub fn new(max_jump: f64, focal: f64) -> Self {
        Self { max_jump, max_rise: STEEPEST_DEG.to_radians().tan() / focal }
    }

    /// Whether two neighbours in a row or column `before, a, b, after` are one surface; `beside` gives the outer two, and is
    /// asked only where the inner ones jump. All are inverse depths, any unit, 0 = none; without `a` or `b` the answer is
    /// no.
    #[inline]
    pub fn joins(&self, a: f64, b: f64, beside: impl FnOnce() -> [f64; 2]) -> bool {
        let (least, rise) = (a.min(b), b - a);
        if least <= 0.0 {
            return false;
        }
        if rise.abs() <= self.max_jump * least {
            return true;
        }
        let [before, after] = beside();
        let goes_on = |exists: bool, slope: f64| !exists || (rise - slope).abs() <= self.max_jump * least;
        let known = before > 0.0 || after > 0.0;
        known
            && rise.abs() <= self.max_rise * least
            && goes_on(before > 0.0, a - before)
            && goes_on(after > 0.0, after - b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULE: f64 = 0.02;

    fn joins(depths: [f64; 4]) -> bool {
        let [before, a, b, after] = depths.map(|z| if z > 0.0 { 1.0 / z } else { 0.0 });
        Continuity::new(RULE, 300.0).joins(a, b, || [before, after])
    }

    #[test]
    fn small_jumps_are_one_surface_and_edges_are_not() {
        assert!(joins([2.0, 2.0, 2.03, 2.03]) && joins([0.0, 2.0, 2.03, 0.0]));
        assert!(!joins([2.0, 2.0, 2.1, 2.1]), "an edge");
        assert!(!joins([2.0, 2.0, 2.1, 2.2]), "an edge, and a slope behind it");
        assert!(!joins([0.0, 2.0, 2.1, 0.0]), "nothing tells that this is a slope");
        assert!(!joins([2.0, 2.0, 0.0, 2.0]) && !joins([2.0, 0.0, 2.0, 2.0]), "no depth");
    }

    #[test]
    fn ground_goes_on_however_it_jumps() {
        // Inverse depth falls by equal steps of 4 %, as on a plane at 85 degrees.
        let ground: Vec<f64> = (0..6).map(|row| 1.0 / (0.5 - 0.02 * f64::from(row))).collect();
        for rows in ground.windows(4) {
            assert!(joins([rows[0], rows[1], rows[2], rows[3]]), "{rows:?}");
        }
        assert!(joins([0.0, ground[0], ground[1], ground[2]]), "where it begins");
        assert!(!joins([ground[0], ground[1], ground[2], 20.0]), "where it ends, the last pixel joins nothing");
    }

    #[test]
    fn no_surface_is_steeper_than_can_be_measured() {
        let ramp: Vec<f64> = (0..4).map(|row| 1.0 / (0.5 - 0.08 * f64::from(row))).collect();
        assert!(!joins([ramp[0], ramp[1], ramp[2], ramp[3]]), "an edge that a filter has blurred");
    }
}
