//! Sine position encoding of one window (spec 2.3).

use burn::tensor::{Device, Tensor, TensorData};
use std::f64::consts::TAU;

/// `[1, height, width, channels]`: the first half of the channels encodes the row, the second the column.
pub(super) fn encoding(width: usize, height: usize, channels: usize, device: &Device) -> Tensor<4> {
    let half = channels / 2;
    let value = |position: usize, len: usize, k: usize| {
        let angle = (position + 1) as f64 / (len as f64 + 1e-6) * TAU;
        let t = 10_000f64.powf(2.0 * (k / 2) as f64 / half as f64);
        (if k.is_multiple_of(2) { (angle / t).sin() } else { (angle / t).cos() }) as f32
    };
    let mut data = Vec::with_capacity(width * height * channels);
    for y in 0..height {
        for x in 0..width {
            data.extend((0..half).map(|k| value(y, height, k)));
            data.extend((0..channels - half).map(|k| value(x, width, k)));
        }
    }
    Tensor::from_data(TensorData::new(data, [1, height, width, channels]), device)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_columns_fill_their_halves() {
        let data = encoding(40, 32, 128, &Device::flex()).into_data().try_to_vec::<f32>().unwrap();
        let at = |row: usize, column: usize, channel: usize| f64::from(data[(row * 40 + column) * 128 + channel]);
        assert!((at(3, 7, 0) - (4.0 / 32.0 * TAU).sin()).abs() < 1e-6);
        assert!((at(3, 7, 1) - (4.0 / 32.0 * TAU).cos()).abs() < 1e-6);
        assert!((at(3, 7, 64) - (8.0 / 40.0 * TAU).sin()).abs() < 1e-6);
        let t = 10_000f64.powf(2.0 / 64.0);
        assert!((at(3, 7, 66) - (8.0 / 40.0 * TAU / t).sin()).abs() < 1e-6);
    }
}
