//! How many pixels to compute with.
//!
//! By default a photograph keeps its shape and is reduced to about `DEFAULT_PIXELS`; never enlarged.
//! Invariant: what is chosen fits the memory, or the road does not start.

/// 640 x 512: beyond, two photographs rarely hold more than time.
const DEFAULT_PIXELS: f64 = 640.0 * 512.0;

/// Fewest pixels on a side that matching windows make sense in.
pub const MIN_SIDE: usize = 32;

/// Peak bytes per pixel and view of the road at full size, measured and rounded up (photograph, maps, surfels, mesh).
const BYTES_PER_PIXEL: f64 = 400.0;

/// Peak bytes of one sweep, whatever the size of the photographs.
const SWEEP_BYTES: f64 = 300e6;

/// The default working size of a `width` x `height` photograph.
pub fn default_size(width: usize, height: usize) -> (usize, usize) {
    let scale = (DEFAULT_PIXELS / (width as f64 * height as f64)).sqrt().min(1.0);
    let side = |length: usize| ((length as f64 * scale).round() as usize).max(MIN_SIDE.min(length));
    (side(width), side(height))
}

/// Bytes the road will need for views of these sizes.
pub fn estimated_bytes(sizes: &[(usize, usize)]) -> f64 {
    SWEEP_BYTES + sizes.iter().map(|&(w, h)| w as f64 * h as f64 * BYTES_PER_PIXEL).sum::<f64>()
}

/// Memory that can be had, bytes, where the system tells.
pub fn available_bytes() -> Option<f64> {
    let meminfo = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = meminfo.lines().find(|line| line.starts_with("MemAvailable:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shape_is_kept_and_nothing_is_enlarged() {
        assert_eq!(default_size(320, 256), (320, 256));
        let (w, h) = default_size(6000, 4000);
        assert!((w as f64 / h as f64 - 1.5).abs() < 0.01 && w * h <= 330_000);
        let (w, h) = default_size(540, 960);
        assert!(w < h);
    }
}
