//! The figures that the paper prints, to stand beside ours: tables 1, 2 and 3.
//!
//! Typed from the paper's source. Invariant: a row's mean is the mean of its entries to the printed precision.

/// The fifteen scans of table 1.
pub const DTU_SCANS: [u32; 15] = [24, 37, 40, 55, 63, 65, 69, 83, 97, 105, 106, 110, 114, 118, 122];

/// One row of table 1: Chamfer distance on DTU from two views, mm.
#[derive(Clone, Copy, Debug)]
pub struct DtuRow {
    /// The method; "SurfelSplat (paper)" is the paper's own row.
    pub method: &'static str,
    /// Per scan, in the order of [`DTU_SCANS`].
    pub scans: [f64; 15],
    /// As printed.
    pub mean: f64,
}

/// Table 1.
pub const TABLE_1: [DtuRow; 8] = [
    DtuRow {
        method: "NeuS",
        scans: [4.69, 4.72, 4.03, 4.58, 4.71, 2.01, 4.83, 3.94, 4.31, 2.61, 1.63, 6.48, 1.44, 5.69, 6.34],
        mean: 4.13,
    },
    DtuRow {
        method: "NeuSurf",
        scans: [1.96, 3.73, 2.35, 0.82, 1.07, 2.51, 0.87, 1.21, 1.15, 1.13, 1.06, 1.23, 0.41, 0.92, 1.13],
        mean: 1.44,
    },
    DtuRow {
        method: "VolRecon",
        scans: [1.41, 3.24, 1.76, 1.43, 1.66, 2.25, 1.42, 1.81, 1.54, 1.26, 1.52, 1.53, 0.99, 1.54, 1.75],
        mean: 1.67,
    },
    DtuRow {
        method: "UFORecon",
        scans: [1.15, 2.42, 1.67, 2.55, 1.90, 2.73, 1.55, 1.49, 2.16, 0.95, 2.22, 1.98, 1.40, 2.11, 2.32],
        mean: 1.91,
    },
    DtuRow {
        method: "2DGS",
        scans: [2.29, 2.63, 2.33, 1.23, 3.69, 4.71, 2.64, 3.94, 3.55, 3.92, 3.95, 2.68, 2.37, 3.15, 2.21],
        mean: 3.02,
    },
    DtuRow {
        method: "GausSurf",
        scans: [4.22, 5.69, 4.32, 3.98, 4.93, 2.81, 4.67, 5.52, 4.98, 3.61, 4.11, 5.43, 2.98, 3.66, 4.55],
        mean: 4.36,
    },
    DtuRow {
        method: "FatesGS",
        scans: [0.77, 2.35, 1.43, 1.00, 1.31, 2.06, 0.85, 1.24, 1.06, 0.83, 1.22, 0.58, 0.64, 0.99, 1.32],
        mean: 1.18,
    },
    DtuRow {
        method: "SurfelSplat (paper)",
        scans: [1.23, 1.69, 1.63, 0.90, 1.24, 1.14, 1.12, 1.18, 1.13, 0.79, 0.84, 1.02, 0.98, 0.84, 1.04],
        mean: 1.12,
    },
];

/// Table 2: time to reconstruct a scan from two views, as printed, on the authors' machine (one RTX A6000).
pub const TABLE_2: [(&str, &str); 8] = [
    ("NeuS", "10 ± 0.5 hours"),
    ("NeuSurf", "14 ± 0.5 hours"),
    ("VolRecon", "60 ± 5 seconds"),
    ("UFORecon", "100 ± 5 seconds"),
    ("2DGS", "10 ± 0.5 minutes"),
    ("GausSurf", "2 ± 0.2 hours"),
    ("FatesGS", "14 ± 0.5 minutes"),
    ("SurfelSplat (paper)", "1 ± 0.05 second"),
];

/// Table 3: what the parts bring. Chamfer distance in mm and normal error (whether summed over x, y, z or divided by
/// 3 is not said) on DTU.
pub const TABLE_3: [(&str, f64, f64); 3] = [
    ("without adaptation (paper)", 2.56, 0.135),
    ("without aggregation (paper)", 1.96, 0.115),
    ("SurfelSplat (paper)", 1.12, 0.060),
];

impl DtuRow {
    /// The entry of a scan; `None` for one that the table does not hold.
    pub fn scan(&self, scan: u32) -> Option<f64> {
        DTU_SCANS.iter().position(|&s| s == scan).map(|i| self.scans[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn printed_means_are_those_of_the_rows() {
        for row in TABLE_1 {
            let mean = row.scans.iter().sum::<f64>() / 15.0;
            assert!((mean - row.mean).abs() <= 0.0101, "{}: {mean} against {}", row.method, row.mean);
        }
        assert_eq!(TABLE_1[7].scan(37), Some(1.69));
        assert_eq!(TABLE_1[7].scan(1), None);
    }
}
