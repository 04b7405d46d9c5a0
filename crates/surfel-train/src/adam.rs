//! Adam on named tensors, with the gradient's global norm clipped.
//!
//! Written out rather than taken from a library because its state must be saved by name with the weights, and
//! because the clipping is of all gradients together (spec 4.2). Invariant: a step depends on the weights, the
//! gradients and the state alone.

use std::collections::BTreeMap;

/// Settings (spec 4.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adam {
    /// Decay of the mean gradient.
    pub beta1: f64,
    /// Decay of the mean squared gradient.
    pub beta2: f64,
    /// Added to the root of the mean squared gradient.
    pub epsilon: f64,
}

impl Default for Adam {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 }
    }
}

/// Running means of one tensor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moments {
    /// Mean gradient.
    pub first: Vec<f32>,
    /// Mean squared gradient.
    pub second: Vec<f32>,
}

/// Running means of all tensors and the number of steps taken.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AdamState {
    /// Steps taken.
    pub steps: u64,
    /// By name of the tensor.
    pub moments: BTreeMap<String, Moments>,
}

/// Root of the sum of squares of all gradients, and the factor that brings it to at most `limit`.
pub fn clipping<'a>(gradients: impl Iterator<Item = &'a Vec<f32>>, limit: f64) -> (f64, f64) {
    let sum: f64 = gradients.flatten().map(|g| f64::from(*g) * f64::from(*g)).sum();
    let norm = sum.sqrt();
    (norm, if norm > limit { limit / norm } else { 1.0 })
}

impl Adam {
    /// Moves `weights` one step against `gradients`, both by name; a tensor without gradient stays.
    pub fn step(
        &self,
        state: &mut AdamState,
        weights: &mut BTreeMap<String, Vec<f32>>,
        gradients: &BTreeMap<String, Vec<f32>>,
        rate: f64,
        factor: f64,
    ) {
        state.steps += 1;
        let correction = |beta: f64| 1.0 - beta.powi(state.steps.min(1_000_000) as i32);
        let (correction1, correction2) = (correction(self.beta1), correction(self.beta2));
        for (name, gradient) in gradients {
            let Some(weights) = weights.get_mut(name) else { continue };
            let moments = state.moments.entry(name.clone()).or_default();
            moments.first.resize(gradient.len(), 0.0);
            moments.second.resize(gradient.len(), 0.0);
            for (i, g) in gradient.iter().enumerate() {
                let g = f64::from(*g) * factor;
                let first = self.beta1 * f64::from(moments.first[i]) + (1.0 - self.beta1) * g;
                let second = self.beta2 * f64::from(moments.second[i]) + (1.0 - self.beta2) * g * g;
                (moments.first[i], moments.second[i]) = (first as f32, second as f32);
                let step = first / correction1 / ((second / correction2).sqrt() + self.epsilon);
                weights[i] = (f64::from(weights[i]) - rate * step) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_is_the_rate_and_a_valley_is_found() {
        let (adam, mut state) = (Adam::default(), AdamState::default());
        let mut weights = BTreeMap::from([("a".to_owned(), vec![1.0f32, -2.0])]);
        let gradient = |w: &BTreeMap<String, Vec<f32>>| {
            BTreeMap::from([("a".to_owned(), w["a"].iter().map(|w| 2.0 * (w - 0.5)).collect())])
        };
        let grads = gradient(&weights);
        adam.step(&mut state, &mut weights, &grads, 0.1, 1.0);
        assert!((weights["a"][0] - 0.9).abs() < 1e-6 && (weights["a"][1] + 1.9).abs() < 1e-6);
        for _ in 0..400 {
            let grads = gradient(&weights);
            adam.step(&mut state, &mut weights, &grads, 0.05, 1.0);
        }
        assert!(weights["a"].iter().all(|w| (w - 0.5).abs() < 1e-2), "{weights:?}");
    }

    #[test]
    fn clipping_is_of_all_gradients_together() {
        let gradients = [vec![3.0f32], vec![0.0, 4.0]];
        let (norm, factor) = clipping(gradients.iter(), 0.5);
        assert!((norm - 5.0).abs() < 1e-9 && (factor - 0.1).abs() < 1e-9);
        assert_eq!(clipping(gradients.iter(), 6.0).1, 1.0);
    }
}
