//! Adaptation and footprint regions.

use super::fixture::{Fixture, out};
use super::{config, device, with_itself};
use crate::nyquist::Shapes;
use crate::nyquist::adapt::adapt;
use crate::nyquist::region::regions;
use crate::ops::gather_attention::Window;
use burn::tensor::{Tensor, TensorData};

#[test]
fn adaptation_and_regions_equal_their_twins() {
    let fixture = Fixture::open("footprints");
    let (cameras, targets, nyquist) = (fixture.cameras(16, 12), with_itself(2), config().nyquist);
    let shapes = Shapes {
        centres: fixture.rows("given.centres"),
        scales: fixture.rows("given.scales"),
        rotations: fixture.rows("given.rotations"),
    };
    let adaptation = adapt(&shapes, &cameras, &targets, &[1e-3; 2], &nyquist);
    let tensor = |values: Vec<f64>| {
        let len = values.len();
        let values: Vec<f32> = values.into_iter().map(|v| v as f32).collect();
        Tensor::<1>::from_data(TensorData::new(values, [len]), &device())
    };
    let scales = adaptation.scales.iter().flatten().copied().collect();
    fixture.assert_outputs_equal(&vec![out("rates", tensor(adaptation.rates)), out("adapted", tensor(scales))]);

    let raw: Vec<[f64; 2]> = shapes.scales.iter().map(|s| s.map(f64::from)).collect();
    let found = regions(&shapes, &raw, &cameras, &targets, &[1e-3; 2], &nyquist).windows;
    let expected = windows(&fixture);
    assert_eq!(found.len(), expected.len());
    for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
        // Where nothing is seen, the place of the candidates has no meaning.
        let equal = found == expected || (found.mask == 0 && expected.mask == 0);
        assert!(equal, "surfel {}, view {}: {found:?} where the twin has {expected:?}", i / 2, i % 2);
    }
    assert!(expected.iter().filter(|w| w.mask.count_ones() > 1).count() > expected.len() / 3);
}

/// Windows of a case as `x, y, step, mask`.
pub(super) fn windows(fixture: &Fixture) -> Vec<Window> {
    let rows = fixture.integers("given.windows");
    rows.as_chunks().0.iter().map(|&[x, y, step, mask]| Window { x, y, step, mask: mask as u64 }).collect()
}
