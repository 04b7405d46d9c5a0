//! The one-cycle learning rate (spec 4.2): a short rise, a long cosine fall.
//!
//! Invariant: equals the closed form of the golden vectors at every step.

use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Shape of the cycle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OneCycle {
    /// Largest rate.
    pub rate: f64,
    /// Share of the steps that rise.
    pub rise: f64,
    /// Largest rate over the first.
    pub first_division: f64,
    /// First rate over the last.
    pub last_division: f64,
}

impl OneCycle {
    /// Rate of 0-based step `t` of `total`; the last rate afterwards.
    pub fn at(&self, t: u64, total: u64) -> f64 {
        let first = self.rate / self.first_division;
        let last = first / self.last_division;
        let up = self.rise * total as f64 - 1.0;
        let down = (total as f64 - 1.0 - up).max(1e-9);
        let t = (t as f64).min(total as f64 - 1.0);
        let cosine = |from: f64, to: f64, share: f64| to + (from - to) * 0.5 * (1.0 + (PI * share).cos());
        if t <= up { cosine(first, self.rate, t / up.max(1e-9)) } else { cosine(self.rate, last, (t - up) / down) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_rises_then_falls_to_almost_nothing() {
        let cycle = OneCycle { rate: 2e-4, rise: 0.01, first_division: 25.0, last_division: 1e4 };
        let total = 300_011;
        assert!((cycle.at(0, total) - 8e-6).abs() < 1e-12);
        assert!((cycle.at(2999, total) - 2e-4).abs() < 1e-9);
        assert!((cycle.at(total - 1, total) - 8e-10).abs() < 1e-14);
        let rates: Vec<f64> = (0..total).step_by(997).map(|t| cycle.at(t, total)).collect();
        assert!(rates[4..].windows(2).all(|pair| pair[1] < pair[0]));
    }

    #[test]
    fn golden_rates() {
        let shared = std::env::var("SURFELSPLAT_SHARED")
            .unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared").to_owned());
        let path = std::path::Path::new(&shared).join("design/golden_vectors.json");
        let Ok(text) = std::fs::read_to_string(&path) else {
            eprintln!("SKIPPED: {} is missing; set SURFELSPLAT_SHARED", path.display());
            return;
        };
        let golden: serde_json::Value = serde_json::from_str(&text).unwrap();
        let golden = golden["onecycle"].as_array().expect("a list of steps");
        for entry in golden {
            let value = |key: &str| entry[key].as_f64().expect("a number");
            let cycle = OneCycle { rate: value("max_lr"), rise: 0.01, first_division: 25.0, last_division: 1e4 };
            let (step, total) = (value("step") as u64, value("total") as u64);
            let rate = cycle.at(step, total);
            assert!((rate - value("lr")).abs() < 1e-9 * value("lr"), "step {step}: {rate} vs {}", value("lr"));
        }
        assert!(golden.len() > 3);
    }
}
