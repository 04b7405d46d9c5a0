//! First root of a distance-bounded function along a ray, to the last digit of `f64`.
//!
//! Sphere tracing (Hart 1996) walks until the sign changes, bisection then closes the bracket; so the
//! depth of an implicit surface is as exact as that of a sphere. Invariant: the returned `t` lies in
//! a bracket of opposite signs, never merely near the surface.

/// First sign change of `bound` in `(start, end)`.
///
/// `|bound(t)|` must not exceed the distance (in units of `t`) to the nearest root. `step_min` is the
/// smallest step: two roots closer together than that may be missed (a ray grazing a silhouette).
pub fn first_root(bound: impl Fn(f64) -> f64, start: f64, end: f64, step_min: f64) -> Option<f64> {
    let mut t = start;
    let side = bound(t);
    if side == 0.0 {
        return Some(t);
    }
    while t < end {
        let next = t + bound(t).abs().max(step_min);
        if bound(next) * side <= 0.0 {
            return Some(bisect(&bound, t, next)).filter(|&root| root < end);
        }
        t = next;
    }
    None
}

fn bisect(f: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let side = f(low);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if f(middle) * side > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_first_of_two_roots_exactly_and_none_past_the_end() {
        let sphere = |t: f64| (t - 5.0).abs() - 2.0;
        let root = first_root(sphere, 0.0, 100.0, 1e-6).unwrap();
        assert!((root - 3.0).abs() < 1e-12, "{root}");
        let second = first_root(sphere, 4.0, 100.0, 1e-6).unwrap();
        assert!((second - 7.0).abs() < 1e-12, "{second}");
        assert!(first_root(sphere, 8.0, 100.0, 1e-3).is_none());
        assert!(first_root(sphere, 0.0, 2.9, 1e-6).is_none());
    }
}
