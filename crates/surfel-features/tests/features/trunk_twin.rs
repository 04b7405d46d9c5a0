//! EfficientNet-Lite0 up to stride 16 as plain loops in f64: planar maps, BatchNorm as its own step, padding as a test.

use safetensors::SafeTensors;
use std::collections::HashMap;
use surfel_core::Grid;

pub struct Planar {
    channels: usize,
    width: usize,
    height: usize,
    data: Vec<f64>,
}

impl Planar {
    fn filled(channels: usize, width: usize, height: usize) -> Self {
        Self { channels, width, height, data: vec![0.0; channels * width * height] }
    }

    pub fn at(&self, c: usize, y: usize, x: usize) -> f64 {
        self.data[(c * self.height + y) * self.width + x]
    }
}

struct Weights<'a>(SafeTensors<'a>);

impl Weights<'_> {
    fn get(&self, name: &str) -> Option<(Vec<usize>, Vec<f64>)> {
        let view = self.0.tensor(name).ok()?;
        let values = view.data().chunks_exact(2).map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f64());
        Some((view.shape().to_vec(), values.collect()))
    }
}

/// Convolution, BatchNorm and perhaps ReLU6; `None` when the file has no such layer.
fn layer(w: &Weights, conv: &str, norm: &str, x: &Planar, stride: usize, relu6: bool) -> Option<Planar> {
    let (shape, filter) = w.get(&format!("{conv}.weight"))?;
    let norm = |part: &str| w.get(&format!("{norm}.{part}")).unwrap().1;
    let (gain, offset, mean, var) = (norm("weight"), norm("bias"), norm("running_mean"), norm("running_var"));
    let (outputs, per_group, k) = (shape[0], shape[1], shape[2]);
    let (width, height) = (x.width.div_ceil(stride), x.height.div_ceil(stride));
    let before = |n: usize, out: usize| (((out - 1) * stride + k).saturating_sub(n) / 2) as isize;
    let (left, top) = (before(x.width, width), before(x.height, height));
    let mut y = Planar::filled(outputs, width, height);
    for o in 0..outputs {
        for oy in 0..height {
            for ox in 0..width {
                let mut sum = 0.0;
                for i in 0..per_group {
                    let channel = if per_group == x.channels { i } else { o };
                    for ky in 0..k {
                        for kx in 0..k {
                            let iy = (oy * stride + ky) as isize - top;
                            let ix = (ox * stride + kx) as isize - left;
                            if iy >= 0 && ix >= 0 && (iy as usize) < x.height && (ix as usize) < x.width {
                                sum += filter[((o * per_group + i) * k + ky) * k + kx]
                                    * x.at(channel, iy as usize, ix as usize);
                            }
                        }
                    }
                }
                let value = (sum - mean[o]) / (var[o] + 1e-3).sqrt() * gain[o] + offset[o];
                y.data[(o * height + oy) * width + ox] = if relu6 { value.clamp(0.0, 6.0) } else { value };
            }
        }
    }
    Some(y)
}

/// The maps by stride, of the image padded to a multiple of 16 by repeating its border.
pub fn run(weights: &[u8], image: &Grid<[f32; 3]>) -> HashMap<usize, Planar> {
    let w = Weights(SafeTensors::deserialize(weights).unwrap());
    let (width, height) = (image.width().next_multiple_of(16), image.height().next_multiple_of(16));
    let mut x = Planar::filled(3, width, height);
    let (mean, std) = ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225]);
    for c in 0..3 {
        for py in 0..height {
            for px in 0..width {
                let value = image[(px.min(image.width() - 1), py.min(image.height() - 1))][c];
                x.data[(c * height + py) * width + px] = (f64::from(value) - mean[c]) / std[c];
            }
        }
    }
    let mut maps = HashMap::new();
    x = layer(&w, "_conv_stem", "_bn0", &x, 2, true).unwrap();
    for i in 0..11 {
        let stride = if [1, 3, 5].contains(&i) { 2 } else { 1 };
        let name = |l: &str| format!("_blocks.{i}.{l}");
        let wide = layer(&w, &name("_expand_conv"), &name("_bn0"), &x, 1, true);
        let y = layer(&w, &name("_depthwise_conv"), &name("_bn1"), wide.as_ref().unwrap_or(&x), stride, true).unwrap();
        let mut y = layer(&w, &name("_project_conv"), &name("_bn2"), &y, 1, false).unwrap();
        if stride == 1 && y.channels == x.channels {
            y.data.iter_mut().zip(&x.data).for_each(|(y, x)| *y += x);
        }
        let keep = match i {
            2 => Some(4),
            4 => Some(8),
            10 => Some(16),
            _ => None,
        };
        x = y;
        if let Some(stride) = keep {
            let copy = Planar { data: x.data.clone(), ..x };
            maps.insert(stride, copy);
        }
    }
    maps
}
