//! The multi-view transformer (spec 2.3): features of each view, informed by its neighbours.
//!
//! Attention within a view runs inside windows; every second layer shifts them by half a window. Attention to the
//! neighbours runs inside the same windows, or along epipolar lines where the configuration asks for it. Invariant:
//! the views are treated alike, so renaming them renames the outputs.

mod along;
mod layer;
mod position;
mod window;

use crate::config::TransformerConfig;
use crate::cost_volume::{uniform_candidates, warps};
use crate::depth::SceneGeometry;
use crate::ops::epipolar::EpipolarLines;
use burn::module::Module;
use burn::tensor::{Device, Int, Tensor};
use layer::Layer;
use std::sync::Arc;
use window::Windows;

/// The layers.
#[derive(Module, Debug)]
pub(crate) struct Transformer {
    layers: Vec<Layer>,
    num_splits: usize,
    num_samples: Option<usize>,
}

impl Transformer {
    pub(crate) fn new(channels: usize, config: &TransformerConfig, device: &Device) -> Self {
        Self {
            layers: (0..config.num_layers).map(|_| Layer::new(channels, config, device)).collect(),
            num_splits: config.num_splits,
            num_samples: config.epipolar.as_ref().map(|config| config.num_samples),
        }
    }

    /// The epipolar lines it attends along at stride 4; none where it attends inside windows.
    pub(crate) fn lines(
        &self,
        geometry: &SceneGeometry,
        (columns, rows): (usize, usize),
    ) -> Option<Arc<EpipolarLines>> {
        let num_samples = self.num_samples?;
        Some(Arc::new(EpipolarLines {
            width: columns,
            height: rows,
            warps: warps(geometry.cameras, geometry.neighbours, 4),
            disparities: geometry.ranges.iter().map(|range| uniform_candidates(range, num_samples)).collect(),
        }))
    }

    /// `[views, channels, h, w]` to the same shape; `neighbours` is `[views, neighbours per view]`, and `lines` are
    /// those of [`Self::lines`].
    pub(crate) fn forward(
        &self,
        features: Tensor<4>,
        neighbours: Tensor<2, Int>,
        lines: Option<Arc<EpipolarLines>>,
    ) -> Tensor<4> {
        let [_, channels, height, width] = features.dims();
        let device = features.device();
        let mut x = features.permute([0, 2, 3, 1]);
        let plain = Windows::new(width, height, self.num_splits, false);
        let shifted = Windows::new(width, height, self.num_splits, true);
        let encoding = position::encoding(plain.width, plain.height, channels, &device);
        x = x + encoding.repeat_dim(1, self.num_splits).repeat_dim(2, self.num_splits);
        for (i, layer) in self.layers.iter().enumerate() {
            x = layer.forward(x, &neighbours, if i % 2 == 1 { &shifted } else { &plain }, lines.as_ref());
        }
        x.permute([0, 3, 1, 2])
    }
}
