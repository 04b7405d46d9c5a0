//! A network to a file.

use super::header::{About, Header, checksum};
use super::tree::parameters;
use crate::model::SurfelNet;
use half::f16;
use safetensors::Dtype;
use safetensors::tensor::TensorView;
use std::path::Path;
use surfel_features::WeightsError;

/// How values are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 16 bits: half the size, for weights that are only used.
    F16,
    /// 32 bits: as trained.
    F32,
}

/// Writes all weights as f32, saying nothing about them but their configuration.
///
/// # Errors
/// [`WeightsError::Unwritable`].
pub fn save(net: &SurfelNet, path: &Path) -> Result<(), WeightsError> {
    save_as(net, path, Precision::F32, &About::default())
}

/// Writes all weights with what there is to say about them.
///
/// # Errors
/// [`WeightsError::Unwritable`], also for a value that is beyond the precision.
pub fn save_as(net: &SurfelNet, path: &Path, precision: Precision, about: &About) -> Result<(), WeightsError> {
    let unwritable = |reason: String| WeightsError::Unwritable { file: path.display().to_string(), reason };
    let mut tensors = Vec::new();
    for parameter in parameters(net) {
        let (dtype, bytes) = match precision {
            Precision::F32 => (Dtype::F32, parameter.values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>()),
            Precision::F16 => {
                let halves: Vec<f16> = parameter.values.iter().map(|v| f16::from_f32(*v)).collect();
                if halves.iter().zip(&parameter.values).any(|(half, value)| value.is_finite() && !half.is_finite()) {
                    let name = &parameter.name;
                    return Err(unwritable(format!("{name} holds a value above 65504, which f16 cannot; write f32")));
                }
                (Dtype::F16, halves.iter().flat_map(|half| half.to_le_bytes()).collect())
            }
        };
        tensors.push((parameter.name, dtype, parameter.shape, bytes));
    }
    let views = tensors.iter().map(|(name, dtype, shape, bytes)| {
        let view = TensorView::new(*dtype, shape.clone(), bytes).map_err(|error| unwritable(error.to_string()))?;
        Ok((name.as_str(), view))
    });
    let views = views.collect::<Result<Vec<_>, WeightsError>>()?;
    let plain = safetensors::serialize(views, None).map_err(|error| unwritable(error.to_string()))?;
    let header = Header {
        config: Some(net.config().to_toml()),
        checksum: Some(checksum(&plain)),
        about: about.clone(),
        ..Header::default()
    };
    let beside = path.with_extension("part");
    std::fs::write(&beside, header.insert_into(&plain))
        .and_then(|()| std::fs::rename(&beside, path))
        .map_err(|error| unwritable(error.to_string()))
}
