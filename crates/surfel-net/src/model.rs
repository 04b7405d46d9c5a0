//! The network from posed views to surfels (paper: algorithm 1; spec 2).
//!
//! Any number of views from two on, of one size; sizes are padded to what the graph needs and cropped back.
//! Invariants: the views are treated alike, and scaling the scene scales the surfels.

use crate::aggregate::Aggregation;
use crate::config::{BackboneConfig, NetConfig};
use crate::cost_volume::neighbours::neighbours;
use crate::cost_volume::{DepthRange, sweep, uniform_candidates, warps};
use crate::depth::{CoarseDepth, Refined, Refinement, SceneGeometry, disparity};
use crate::features::cnn::Cnn;
use crate::features::pyramid::Pyramid;
use crate::head::{Adapter, AttributeHead, SurfelTensors};
use crate::input::{InputError, SceneInput};
use crate::nyquist::adapt::{Adaptation, adapt};
use crate::nyquist::region::regions;
use crate::nyquist::{NEAR_CLIP, Shapes};
use crate::ops::plane_sweep;
use crate::transformer::Transformer;
use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Int, Tensor, TensorData};
use std::sync::Arc;
use surfel_features::{FeatureExtractor, WeightsError};

/// The network.
#[derive(Module, Debug)]
pub struct SurfelNet {
    cnn: Option<Cnn>,
    pyramid: Option<Pyramid>,
    transformer: Transformer,
    coarse: CoarseDepth,
    refinement: Refinement,
    head: AttributeHead,
    aggregation: Option<Aggregation>,
    #[module(skip)]
    trunk: Option<FeatureExtractor>,
    #[module(skip)]
    config: NetConfig,
}

/// What the network says about a scene.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// z-depth, scene units, `[views, height, width]`.
    pub depth: Tensor<3>,
    /// Largest probability of a coarse candidate, in (0, 1], `[views, ceil(height / 4), ceil(width / 4)]`.
    pub confidence: Tensor<3>,
    /// Surfels of the first head pass.
    pub initial: SurfelTensors,
    /// Sampling rates and adapted scales of the initial surfels; absent without aggregation.
    pub adaptation: Option<Adaptation>,
    /// Surfels of the second head pass; the initial ones without aggregation.
    pub surfels: SurfelTensors,
}

impl SurfelNet {
    /// A fresh network; seed the device first for reproducible weights.
    ///
    /// # Errors
    /// [`WeightsError`] when the pretrained trunk cannot be read.
    pub fn new(config: NetConfig, device: &Device) -> Result<Self, WeightsError> {
        let channels = config.backbone.channels();
        let (cnn, trunk, pyramid) = match &config.backbone {
            BackboneConfig::Cnn { channels, widths } => (Some(Cnn::new(*widths, *channels, device)), None, None),
            BackboneConfig::Pretrained { channels } => {
                (None, Some(FeatureExtractor::new()?), Some(Pyramid::new(*channels, device)))
            }
        };
        let feature_channels = config.feature_channels();
        let net = Self {
            cnn,
            pyramid,
            transformer: Transformer::new(channels, &config.transformer, device),
            coarse: CoarseDepth::new(channels, &config.cost_volume, device),
            refinement: Refinement::new(&config, device),
            head: AttributeHead::new(feature_channels, &config.head, device),
            aggregation: config
                .aggregation
                .enabled
                .then(|| Aggregation::new(feature_channels, &config.aggregation, device)),
            trunk,
            config,
        };
        net.visit(&mut DrawWeights);
        Ok(net)
    }

    /// The settings it was built with.
    pub fn config(&self) -> &NetConfig {
        &self.config
    }

    /// Names and numbers of trained parameters of its parts, in the order they run.
    pub fn parts(&self) -> Vec<(&'static str, usize)> {
        let backbone = self.cnn.num_params() + self.pyramid.num_params();
        vec![
            ("backbone", backbone),
            ("transformer", self.transformer.num_params()),
            ("coarse depth", self.coarse.num_params()),
            ("refinement", self.refinement.num_params()),
            ("attribute head", self.head.num_params()),
            ("aggregation", self.aggregation.num_params()),
        ]
    }

    /// Depth and surfels of a scene.
    ///
    /// # Errors
    /// [`InputError`] when views are missing, differ in size, or have an unusable camera or depth range.
    pub fn forward(&self, scene: &SceneInput, device: &Device) -> Result<Prediction, InputError> {
        scene.check()?;
        let (width, height) = (scene.images[0].width(), scene.images[0].height());
        let others = neighbours(scene.cameras, self.config.num_neighbours);
        let targets: Vec<Vec<usize>> =
            others.iter().enumerate().map(|(v, others)| [&[v], others.as_slice()].concat()).collect();
        let sources = index_tensor(&targets, device);
        let geometry =
            SceneGeometry { cameras: scene.cameras, neighbours: &others, ranges: scene.ranges, sources: &sources };

        let (refined, confidence) = self.depth(scene, &geometry, &index_tensor(&others, device), device);
        let crop = |map: Tensor<4>| map.narrow(2, 0, height).narrow(3, 0, width);
        let features = crop(refined.features);
        let depth = disparity(crop(refined.disparity), scene.ranges).recip();
        let opacity = crop(refined.density);

        let adapter = Adapter::new(scene.cameras, &self.config.head, device);
        let surfels_of =
            |features: Tensor<4>| adapter.forward(self.head.forward(features), depth.clone(), opacity.clone());
        let initial = surfels_of(features.clone());
        let (adaptation, surfels) = match &self.aggregation {
            Some(aggregation) => {
                let (adaptation, regions) = self.regions(&initial, scene, &targets);
                (Some(adaptation), surfels_of(aggregation.forward(features, Arc::new(regions))))
            }
            None => (None, initial.clone()),
        };
        let views = scene.images.len();
        let (rows, columns) = (height.div_ceil(4), width.div_ceil(4));
        Ok(Prediction {
            depth: depth.reshape([views, height, width]),
            confidence: confidence.narrow(2, 0, rows).narrow(3, 0, columns).reshape([views, rows, columns]),
            initial,
            adaptation,
            surfels,
        })
    }

    /// Features, matching and depth at the padded size; also the confidence at stride 4.
    fn depth(
        &self,
        scene: &SceneInput,
        geometry: &SceneGeometry,
        others: &Tensor<2, Int>,
        device: &Device,
    ) -> (Refined, Tensor<4>) {
        let padded = scene.padded_images(self.config.size_multiple());
        let images = image_tensor(&padded, device);
        let context = match (&self.cnn, &self.pyramid, &self.trunk) {
            (Some(cnn), _, _) => cnn.forward(images.clone()),
            (None, Some(pyramid), Some(trunk)) => pyramid.forward(trunk, &padded, device),
            _ => unreachable!("a network is built with one of the two backbones"),
        };
        let matching = self.transformer.forward(context.clone(), others.clone());
        let [_, _, rows, columns] = matching.dims();
        let candidates = |range: &DepthRange| uniform_candidates(range, self.config.cost_volume.num_candidates);
        let coarse_sweep = sweep(
            warps(geometry.cameras, geometry.neighbours, 4),
            (columns, rows),
            geometry.ranges.iter().map(candidates).collect(),
            None,
        );
        let correlation = plane_sweep(matching.clone(), Arc::new(coarse_sweep));
        let (coarse, confidence) = self.coarse.forward(correlation, matching.clone(), geometry.sources);
        let pair = (coarse, confidence.clone());
        (self.refinement.forward(&self.config, images, (matching, context), pair, geometry), confidence)
    }

    fn regions(
        &self,
        initial: &SurfelTensors,
        scene: &SceneInput,
        targets: &[Vec<usize>],
    ) -> (Adaptation, crate::ops::gather_attention::Regions) {
        let values = initial.to_surfels();
        let shapes = Shapes { centres: values.centres, scales: values.scales, rotations: values.rotations };
        let near_clips: Vec<f64> = scene.ranges.iter().map(|range| NEAR_CLIP * range.near).collect();
        let adaptation = adapt(&shapes, scene.cameras, targets, &near_clips, &self.config.nyquist);
        let unadapted: Vec<[f64; 2]>;
        let scales = if self.config.nyquist.adaptation {
            &adaptation.scales
        } else {
            unadapted = shapes.scales.iter().map(|scales| scales.map(f64::from)).collect();
            &unadapted
        };
        let regions = regions(&shapes, scales, scene.cameras, targets, &near_clips, &self.config.nyquist);
        (adaptation, regions)
    }
}

/// Draws all initial weights at once; burn would do so at their first use, in an order that depends on it.
struct DrawWeights;

impl ModuleVisitor for DrawWeights {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        param.val();
    }
}

/// Equally long lists as a tensor.
fn index_tensor(lists: &[Vec<usize>], device: &Device) -> Tensor<2, Int> {
    let values: Vec<i32> = lists.iter().flatten().map(|&v| v as i32).collect();
    Tensor::from_data(TensorData::new(values, [lists.len(), lists[0].len()]), device)
}

/// Images as `[views, 3, height, width]`.
fn image_tensor(images: &[surfel_core::Grid<[f32; 3]>], device: &Device) -> Tensor<4> {
    let (width, height) = (images[0].width(), images[0].height());
    let values: Vec<f32> = images.iter().flat_map(|image| image.as_slice().as_flattened()).copied().collect();
    Tensor::<4>::from_data(TensorData::new(values, [images.len(), height, width, 3]), device).permute([0, 3, 1, 2])
}
