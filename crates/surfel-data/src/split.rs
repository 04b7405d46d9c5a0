//! Which scans of DTU are for training and which for testing (spec 5.5).
//!
//! Invariant: no scan is in both lists; the training list of MVSNet, which shares scans with the test list, is not
//! offered.

/// The 15 scans that results are stated on.
pub const DTU_TEST: [u32; 15] = [24, 37, 40, 55, 63, 65, 69, 83, 97, 105, 106, 110, 114, 118, 122];

/// The 75 scans of sparse-view training.
pub const DTU_TRAIN: [u32; 75] = [
    1, 4, 5, 6, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 28, 29, 30, 31, 32, 33, 34, 35, 36, 38,
    39, 41, 42, 43, 44, 45, 46, 47, 48, 49, 50, 51, 52, 59, 60, 61, 62, 64, 74, 75, 76, 77, 84, 85, 86, 87, 88, 89, 90,
    91, 92, 93, 94, 95, 96, 98, 99, 100, 101, 102, 103, 104, 126, 127, 128,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_trained_on_that_is_tested_on() {
        assert!(DTU_TRAIN.iter().all(|scan| !DTU_TEST.contains(scan)));
        assert!(DTU_TRAIN.is_sorted_by(|a, b| a < b) && DTU_TEST.is_sorted_by(|a, b| a < b));
    }
}
