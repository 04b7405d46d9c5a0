//! Value noise: a smooth random function of space, and its sum over octaves.
//!
//! Invariant: a pure function of seed and point, continuous with continuous first derivatives, in \[0, 1\].

use crate::random::hash;
use glam::DVec3;

/// One octave of value noise with one random value per unit cell corner, in \[0, 1\].
pub fn value_noise(seed: u64, point: DVec3) -> f64 {
    let cell = point.floor();
    let t = point - cell;
    // Quintic fade: first and second derivatives vanish at cell borders, so shading shows no lattice.
    let w = t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let [x, y, z] = [cell.x as i64, cell.y as i64, cell.z as i64];
    let along_x = |y: i64, z: i64| lerp(corner(seed, x, y, z), corner(seed, x + 1, y, z), w.x);
    let along_y = |z: i64| lerp(along_x(y, z), along_x(y + 1, z), w.y);
    lerp(along_y(z), along_y(z + 1), w.z)
}

/// Sum of `octaves` octaves, each at twice the frequency and `gain` times the amplitude of the last,
/// normalised to \[0, 1\] and stretched about the middle to keep its contrast.
pub fn fractal_noise(seed: u64, point: DVec3, octaves: u32, gain: f64) -> f64 {
    let (mut sum, mut power, mut amplitude, mut p) = (0.0, 0.0, 1.0, point);
    for octave in 0..octaves {
        sum += amplitude * (value_noise(seed.wrapping_add(u64::from(octave)), p) - 0.5);
        power += amplitude * amplitude;
        amplitude *= gain;
        // An offset that is no multiple of the cell keeps the octaves' lattices apart.
        p = p * 2.0 + DVec3::splat(17.31);
    }
    (0.5 + 1.2 * sum / power.max(1e-12).sqrt()).clamp(0.0, 1.0)
}

fn corner(seed: u64, x: i64, y: i64, z: i64) -> f64 {
    let key = (x as u64)
        .wrapping_mul(0x8da6_b343_0000_0001)
        .wrapping_add((y as u64).wrapping_mul(0xd816_3841_0000_0003))
        .wrapping_add((z as u64).wrapping_mul(0xcb1a_b31f_0000_0007));
    (hash(seed.wrapping_mul(0x2545_f491_4f6c_dd1d) ^ key) >> 11) as f64 / (1u64 << 53) as f64
}

fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_continuous_across_cells_and_spans_its_range() {
        let (mut low, mut high) = (1.0f64, 0.0f64);
        for i in 0..4000 {
            let p = DVec3::new(0.013 * f64::from(i), 0.007 * f64::from(i), 3.0 - 0.011 * f64::from(i));
            let here = fractal_noise(5, p, 5, 0.6);
            let there = fractal_noise(5, p + DVec3::splat(1e-6), 5, 0.6);
            assert!((here - there).abs() < 1e-3, "{here} {there} at {p}");
            (low, high) = (low.min(here), high.max(here));
        }
        assert!(low < 0.2 && high > 0.8, "{low} {high}");
    }
}
