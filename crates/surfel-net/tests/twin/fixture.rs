//! What a twin was given and answered, and the comparison with a module.
//!
//! Tolerance: 1e-4 of the largest value of each tensor. `--nocapture` shows how much of it a case needs.

use super::device;
use crate::checkpoint::filled;
use crate::layers::values;
use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor, TensorData};
use glam::{DMat3, DVec3};
use safetensors::SafeTensors;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::PathBuf;
use surfel_core::{Camera, Intrinsics, Rigid};
use surfel_features::weights::TensorFile;

const TOLERANCE: f32 = 1e-4;
/// A gradient this much smaller than the largest of its case is compared on that scale: f32 rounds no finer.
const NEGLIGIBLE: f32 = 1e-2;
/// What is left, beside the largest gradient of its case, of one that is zero (a bias before a normalisation, or of keys
/// before a softmax): sums of f32 that cancel, in an order that differs with the width of a machine's vectors.
const CANCELLED: f32 = 4e-6;
/// Gradients longer than this are folded into [`FOLDS`] sums.
const MAX_UNFOLDED: usize = 512;
const FOLDS: usize = 61;
/// So many weights of a case are nudged, evenly chosen.
const MAX_NUDGES: usize = 8;

/// One case.
pub(super) struct Fixture {
    name: &'static str,
    bytes: Vec<u8>,
    /// Differentiated inputs as flat leaves, once asked for.
    leaves: RefCell<BTreeMap<String, Tensor<1>>>,
}

/// Named outputs, flattened.
pub(super) type Outputs = Vec<(&'static str, Tensor<1>)>;

/// One output.
pub(super) fn out<const D: usize>(name: &'static str, tensor: Tensor<D>) -> (&'static str, Tensor<1>) {
    let len: usize = tensor.dims().iter().product();
    (name, tensor.reshape([len]))
}

impl Fixture {
    pub(super) fn open(name: &'static str) -> Self {
        let path = Self::path(name);
        let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        Self { name, bytes, leaves: RefCell::default() }
    }

    /// Where the file of a case lies.
    pub(super) fn path(name: &str) -> PathBuf {
        PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/twin/fixtures/{name}.safetensors"))
    }

    fn names(&self) -> Vec<String> {
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        file.names().into_iter().map(String::from).collect()
    }

    fn raw<const N: usize, T>(&self, key: &str, from: fn([u8; N]) -> T) -> (Vec<usize>, Vec<T>) {
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        let view = file.tensor(key).unwrap_or_else(|_| panic!("{} has no {key}", self.name));
        (view.shape().to_vec(), view.data().as_chunks().0.iter().map(|&bytes| from(bytes)).collect())
    }

    /// A tensor of f32.
    pub(super) fn values(&self, key: &str) -> Vec<f32> {
        self.raw(key, f32::from_le_bytes).1
    }

    /// A tensor of f32 as rows.
    pub(super) fn rows<const N: usize>(&self, key: &str) -> Vec<[f32; N]> {
        self.values(key).as_chunks().0.to_vec()
    }

    /// A tensor of i32.
    pub(super) fn integers(&self, key: &str) -> Vec<i32> {
        self.raw(key, i32::from_le_bytes).1
    }

    /// A differentiated input.
    pub(super) fn input<const D: usize>(&self, name: &str) -> Tensor<D> {
        let (shape, data) = self.raw(&format!("input.{name}"), f32::from_le_bytes);
        let mut leaves = self.leaves.borrow_mut();
        let leaf = leaves.entry(name.to_owned()).or_insert_with(|| {
            let len = data.len();
            Tensor::from_data(TensorData::new(data, [len]), &device()).require_grad()
        });
        leaf.clone().reshape(<[usize; D]>::try_from(shape).unwrap())
    }

    /// The cameras, each of `width` x `height` pixels.
    pub(super) fn cameras(&self, width: usize, height: usize) -> Vec<Camera> {
        let part = |key: &str| self.raw(key, f64::from_le_bytes).1;
        let (intrinsics, rotations) = (part("camera.intrinsics"), part("camera.rotation"));
        let translations = part("camera.translation");
        (0..intrinsics.len() / 4)
            .map(|v| {
                let k = &intrinsics[4 * v..4 * v + 4];
                let rotation = DMat3::from_cols_slice(&rotations[9 * v..9 * v + 9]).transpose();
                Camera {
                    intrinsics: Intrinsics { fx: k[0], fy: k[1], cx: k[2], cy: k[3] },
                    width,
                    height,
                    camera_from_world: Rigid { rotation, translation: DVec3::from_slice(&translations[3 * v..]) },
                }
            })
            .collect()
    }

    /// A module with the twin's weights.
    fn filled<M: Module>(&self, module: M) -> M {
        let file = TensorFile::parse(self.name, &self.bytes).unwrap();
        let module = filled(module, &file, &["weight"]).unwrap();
        let twin = self.names().iter().filter(|name| name.starts_with("weight.")).count();
        let mut names = Names::default();
        module.visit(&mut names);
        assert_eq!(names.found.len(), twin, "{}: the twin has other weights", self.name);
        module
    }

    /// `run` gives the twin's outputs and gradients, and no longer so when one of its weights is nudged.
    pub(super) fn assert_equal<M: Module>(&self, module: M, run: impl Fn(&M) -> Outputs) {
        let module = self.filled(module);
        let outputs = run(&module);
        self.assert_outputs_equal(&outputs);
        let grads = loss_of(&outputs).backward();
        let mut visitor = Names { grads: Some(&grads), ..Names::default() };
        module.visit(&mut visitor);
        self.assert_gradients_equal(&grads, &visitor.found);

        let largest = visitor.found.iter().map(|(_, grad)| magnitude(grad)).fold(0.0, f32::max);
        let influential: Vec<usize> =
            (0..visitor.found.len()).filter(|&i| magnitude(&visitor.found[i].1) > NEGLIGIBLE * largest).collect();
        assert!(module.num_params() == 0 || influential.len() > visitor.found.len() / 2, "{}", self.name);
        for &which in influential.iter().step_by(influential.len().div_ceil(MAX_NUDGES).max(1)) {
            let (name, grad) = &visitor.found[which];
            let element = (0..grad.len()).max_by(|&a, &b| grad[a].abs().total_cmp(&grad[b].abs())).unwrap();
            let nudged = module.clone().map(&mut Nudge { remaining: which, element });
            let error = self.output_error(&run(&nudged));
            assert!(error > TOLERANCE, "{}: nudging {name} changes the outputs by {error} only", self.name);
        }
    }

    /// The same of a function without weights.
    pub(super) fn assert_function_equal(&self, run: impl Fn() -> Outputs) {
        let outputs = run();
        self.assert_outputs_equal(&outputs);
        self.assert_gradients_equal(&loss_of(&outputs).backward(), &[]);
    }

    /// Names agree, and so do values.
    pub(super) fn assert_outputs_equal(&self, outputs: &Outputs) {
        let mut expected: Vec<String> =
            self.names().iter().filter_map(|name| name.strip_prefix("output.").map(String::from)).collect();
        let mut found: Vec<String> = outputs.iter().map(|(name, _)| (*name).to_owned()).collect();
        expected.sort();
        found.sort();
        // A twin's only output is called y.
        assert_eq!(found, expected, "{}", self.name);
        for (name, tensor) in outputs {
            let error = self.output_error(&vec![(name, tensor.clone())]);
            assert!(error <= TOLERANCE, "{}: output {name} differs by {error} of its largest value", self.name);
        }
        println!("{}: outputs within {:.0e}", self.name, self.output_error(outputs));
    }

    /// Largest difference over the largest value of each output.
    fn output_error(&self, outputs: &Outputs) -> f32 {
        let errors = outputs.iter().map(|(name, tensor)| {
            let expected = self.values(&format!("output.{name}"));
            relative_error(&values(tensor.clone()), &expected, magnitude(&expected))
        });
        errors.fold(0.0, f32::max)
    }

    fn assert_gradients_equal(&self, grads: &Gradients, weights: &[(String, Vec<f32>)]) {
        let leaves = self.leaves.borrow();
        let inputs = leaves.iter().map(|(name, leaf)| {
            let grad = leaf.grad(grads).unwrap_or_else(|| panic!("{}: no gradient of {name}", self.name));
            (format!("grad.input.{name}"), values(grad))
        });
        let weights = weights.iter().map(|(name, grad)| (format!("grad.weight.{name}"), grad.clone()));
        let found: Vec<(String, Vec<f32>)> = inputs.chain(weights).collect();
        assert_eq!(found.len(), self.names().iter().filter(|name| name.starts_with("grad.")).count(), "{}", self.name);
        let largest = found.iter().map(|(name, _)| magnitude(&self.values(name))).fold(0.0, f32::max);
        let mut worst = 0.0f32;
        for (name, grad) in &found {
            let expected = self.values(name);
            let is_zero = magnitude(&expected) < CANCELLED * largest;
            let floor = if is_zero { CANCELLED / TOLERANCE } else { NEGLIGIBLE };
            let scale = magnitude(&expected).max(floor * largest);
            let error = relative_error(&folded(grad), &expected, scale);
            assert!(error <= TOLERANCE, "{}: {name} differs by {error} of its largest value", self.name);
            worst = worst.max(error);
        }
        println!("{}: gradients within {worst:.0e}", self.name);
    }
}

fn magnitude(values: &[f32]) -> f32 {
    values.iter().fold(0.0, |m, v| m.max(v.abs()))
}

/// Largest difference over `scale`; NaN counts as infinitely wrong.
fn relative_error(found: &[f32], expected: &[f32], scale: f32) -> f32 {
    assert_eq!(found.len(), expected.len());
    let error = |(a, b): (&f32, &f32)| if a.is_finite() { (a - b).abs() } else { f32::INFINITY };
    found.iter().zip(expected).map(error).fold(0.0, f32::max) / scale
}

/// As `folded` in `make_fixtures.py`.
fn folded(grad: &[f32]) -> Vec<f32> {
    if grad.len() <= MAX_UNFOLDED {
        return grad.to_vec();
    }
    let mut sums = vec![0.0f64; FOLDS];
    for (i, value) in grad.iter().enumerate() {
        sums[i % FOLDS] += f64::from(*value);
    }
    sums.iter().map(|&sum| sum as f32).collect()
}

/// As `loss_of` in `make_fixtures.py`.
fn loss_of(outputs: &Outputs) -> Tensor<1> {
    let terms = outputs.iter().map(|(_, tensor)| {
        let len = tensor.dims()[0];
        let weights: Vec<f32> = (0..len).map(|i| ((37 * i % 11) as f32 - 5.0) / 5.0).collect();
        (tensor.clone() * Tensor::from_data(TensorData::new(weights, [len]), &device())).sum()
    });
    terms.reduce(|sum, term| sum + term).expect("a case has outputs")
}

/// Names of weights, with their gradients where there are some.
#[derive(Default)]
struct Names<'a> {
    path: Vec<String>,
    grads: Option<&'a Gradients>,
    found: Vec<(String, Vec<f32>)>,
}

impl ModuleVisitor for Names<'_> {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let grad = self.grads.and_then(|grads| param.val().grad(grads)).map(values).unwrap_or_default();
        self.found.push((self.path.join("."), grad));
    }
}

/// Adds to one element of one weight.
struct Nudge {
    /// Weights before it.
    remaining: usize,
    element: usize,
}

impl ModuleMapper for Nudge {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let hit = self.remaining == 0;
        self.remaining = self.remaining.wrapping_sub(1);
        if !hit {
            return param;
        }
        param.map(|old| {
            let (shape, device) = (old.dims(), old.device());
            let mut data = values(old);
            data[self.element] += 0.1;
            Tensor::from_data(TensorData::new(data, shape), &device).require_grad()
        })
    }
}

/// A module must not pass because the comparison is blind.
#[test]
fn the_comparison_sees_one_wrong_value_and_nan() {
    let fixture = Fixture::open("adapter");
    let of = |change: f32| {
        let outputs = ["centres", "scales", "rotations", "opacities", "sh"].map(|name| {
            let mut values = fixture.values(&format!("output.{name}"));
            if name == "rotations" {
                values[7] += change;
            }
            let len = values.len();
            (name, Tensor::from_data(TensorData::new(values, [len]), &device()))
        });
        fixture.output_error(&outputs.to_vec())
    };
    assert!(of(0.0) == 0.0 && of(1e-3) > TOLERANCE && of(1e-6) < TOLERANCE && of(f32::NAN) > TOLERANCE);
    let grad: Vec<f32> = (0..1000).map(|i| if i == 700 { 1.0 } else { 0.0 }).collect();
    assert!(folded(&grad)[700 % FOLDS] == 1.0 && folded(&grad).len() == FOLDS);
}
