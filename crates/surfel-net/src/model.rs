//! The network from posed views to surfels (paper: algorithm 1; spec 2).
//!
//! Any number of views from two on, of one size; sizes are padded to what the graph needs and cropped back.
//! Invariants: the views are treated alike, and scaling the scene scales the surfels.

use crate::aggregate::Aggregation;
use crate::config::{BackboneConfig, NetConfig};
use crate::cost_volume::neighbours::neighbours;
use crate::cost_volume::{DepthRange, sweep, uniform_candidates, warps};
use crate::depth::{
    Choice, CoarseDepth, Features, Given, Refined, Refinement, SceneGeometry, SeededRefinement, disparity,
    refined_in_passes,
};
use crate::features::cnn::Cnn;
use crate::features::dino::{Dino, DinoFusion};
use crate::features::pyramid::Pyramid;
use crate::head::{Adapter, AttributeHead, Base, SurfelTensors, frames_from_normals, normals_away};
use crate::input::{InputError, SceneInput};
use crate::layers::nearest;
use crate::nyquist::adapt::{Adaptation, adapt};
use crate::nyquist::region::regions;
use crate::nyquist::{NEAR_CLIP, Shapes};
use crate::ops::plane_sweep;
use crate::ops::plane_sweep::Base as SweepBase;
use crate::transformer::Transformer;
use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Int, Tensor, TensorData};
use std::path::Path;
use std::sync::Arc;
use surfel_core::Grid;
use surfel_features::{FeatureExtractor, WeightsError};

/// The network.
#[derive(Module, Debug)]
pub struct SurfelNet {
    cnn: Option<Cnn>,
    pyramid: Option<Pyramid>,
    transformer: Option<Transformer>,
    coarse: Option<CoarseDepth>,
    refinement: Option<Refinement>,
    seeded: Option<SeededRefinement>,
    head: AttributeHead,
    aggregation: Option<Aggregation>,
    // Last, so that a network with it starts from the same weights as one without.
    dino_fusion: Option<DinoFusion>,
    #[module(skip)]
    dino: Option<Dino>,
    #[module(skip)]
    trunk: Option<FeatureExtractor>,
    #[module(skip)]
    config: NetConfig,
}

/// What the encoder says of every pixel, before there are surfels.
#[derive(Clone, Debug)]
pub struct EncoderMaps {
    /// z-depth, scene units, `[views, height, width]`.
    pub depth: Tensor<3>,
    /// How sure the depth is, in [0, 1], `[views, height, width]`: the largest probability of a coarse candidate,
    /// in a seeded network the density, which training calibrates.
    pub confidence: Tensor<3>,
    /// Unit normals of the planes, camera frame, facing the camera, `[views, 3, height, width]`; only a seeded
    /// network has planes.
    pub normals: Option<Tensor<4>>,
    /// How the planes were chosen; only in a seeded network.
    pub choice: Option<Choice>,
}

/// What the network says about a scene.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// The encoder's maps.
    pub maps: EncoderMaps,
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
    /// [`WeightsError`] when the pretrained trunk or the file of DINO weights cannot be read.
    pub fn new(config: NetConfig, device: &Device) -> Result<Self, WeightsError> {
        let channels = config.backbone.channels();
        let (cnn, trunk, pyramid) = match &config.backbone {
            BackboneConfig::Cnn { channels, widths } => (Some(Cnn::new(*widths, *channels, device)), None, None),
            BackboneConfig::Pretrained { channels } => {
                (None, Some(FeatureExtractor::new()?), Some(Pyramid::new(*channels, device)))
            }
        };
        let feature_channels = config.feature_channels();
        let dino_file = config.dino.as_ref().and_then(|dino| Some((dino.model, dino.file.as_ref()?)));
        let net = Self {
            cnn,
            pyramid,
            transformer: config.transformer.as_ref().map(|config| Transformer::new(channels, config, device)),
            coarse: config.cost_volume.as_ref().map(|config| CoarseDepth::new(channels, config, device)),
            refinement: config.seeded.is_none().then(|| Refinement::new(&config, device)),
            seeded: config.seeded.as_ref().map(|seeded| SeededRefinement::new(&config, seeded, device)),
            head: AttributeHead::new(feature_channels, &config.head, config.seeded.is_some(), device),
            aggregation: config
                .aggregation
                .enabled
                .then(|| Aggregation::new(feature_channels, &config.aggregation, device)),
            dino_fusion: config.dino.as_ref().map(|dino| DinoFusion::new(dino.model.width(), channels, device)),
            dino: dino_file.map(|(model, file)| Dino::from_file(model, file, device)).transpose()?,
            trunk,
            config,
        };
        net.visit(&mut DrawWeights);
        Ok(net)
    }

    /// The network with the frozen DINO weights of a file, safetensors or PyTorch, by the names of the original
    /// release or of Hugging Face; they are read here and stay on the CPU.
    ///
    /// # Errors
    /// [`WeightsError`] when the file cannot be read, is damaged, holds another model than the settings name, or when
    /// they name none.
    pub fn with_dino(mut self, file: impl AsRef<Path>, device: &Device) -> Result<Self, WeightsError> {
        let file = file.as_ref();
        let Some(dino) = &self.config.dino else {
            let reason = "this network adds no DINO features".to_owned();
            return Err(WeightsError::Unusable { file: file.display().to_string(), reason });
        };
        self.dino = Some(Dino::from_file(dino.model, file, device)?);
        Ok(self)
    }

    /// Where its weights are.
    pub fn device(&self) -> Device {
        // Every network has weights, and all of them in one place.
        self.devices().into_iter().next().unwrap_or_default()
    }

    /// The settings it was built with.
    pub fn config(&self) -> &NetConfig {
        &self.config
    }

    /// The same weights with surfel adaptation switched off: regions are those of the surfels as first placed.
    #[must_use]
    pub fn without_adaptation(mut self) -> Self {
        self.config.nyquist.adaptation = false;
        self
    }

    /// The same weights with feature aggregation switched off: the surfels of the first head pass are final.
    #[must_use]
    pub fn without_aggregation(mut self) -> Self {
        self.config.aggregation.enabled = false;
        self.aggregation = None;
        self
    }

    /// The same weights, refining what matching found this often, at least once; a network that finds depth by itself stays as it is.
    #[must_use]
    pub fn with_passes(mut self, passes: usize) -> Self {
        if let Some(seeded) = &mut self.config.seeded {
            seeded.passes = passes;
        }
        self
    }

    /// Names and numbers of trained parameters of its parts, in the order they run.
    pub fn parts(&self) -> Vec<(&'static str, usize)> {
        let backbone = self.cnn.num_params() + self.pyramid.num_params();
        let mut parts = vec![
            ("backbone", backbone),
            ("transformer", self.transformer.num_params()),
            ("coarse depth", self.coarse.num_params()),
            ("refinement", self.refinement.num_params() + self.seeded.num_params()),
            ("attribute head", self.head.num_params()),
            ("aggregation", self.aggregation.num_params()),
        ];
        parts.extend(self.dino_fusion.as_ref().map(|fusion| ("DINO fusion", fusion.num_params())));
        parts
    }

    /// Depth and surfels of a scene.
    ///
    /// # Errors
    /// [`InputError`] when views are missing, differ in size, or have an unusable camera or depth range.
    pub fn forward(&self, scene: &SceneInput, device: &Device) -> Result<Prediction, InputError> {
        let Encoded { maps, opacity, features, targets } = self.encode(scene, device)?;
        let mut features = cropped(features.at_every_pixel(), scene);
        if let Some(normals) = &maps.normals {
            features = Tensor::cat(vec![features, -normals.clone(), opacity.clone()], 1);
        }
        let base = maps
            .normals
            .clone()
            .map(|normals| Base { frames: frames_from_normals(-normals), colours: image_tensor(scene.images, device) });
        let depth = maps.depth.clone().unsqueeze_dim(1);
        let adapter = Adapter::new(scene.cameras, &self.config.head, device);
        let surfels_of = |features: Tensor<4>| {
            adapter.forward(self.head.forward(features), depth.clone(), opacity.clone(), base.as_ref())
        };
        let initial = surfels_of(features.clone());
        let (adaptation, surfels) = match &self.aggregation {
            Some(aggregation) => {
                let (adaptation, regions) = self.regions(&initial, scene, &targets);
                (Some(adaptation), surfels_of(aggregation.forward(features, Arc::new(regions))))
            }
            None => (None, initial.clone()),
        };
        Ok(Prediction { maps, initial, adaptation, surfels })
    }

    /// The encoder's maps of a scene alone: depth, confidence and normals as [`Self::forward`] gives them.
    ///
    /// # Errors
    /// As [`Self::forward`].
    pub fn forward_maps(&self, scene: &SceneInput, device: &Device) -> Result<EncoderMaps, InputError> {
        Ok(self.encode(scene, device)?.maps)
    }

    fn encode(&self, scene: &SceneInput, device: &Device) -> Result<Encoded, InputError> {
        scene.check()?;
        let expected = if self.config.seeded.is_some() { scene.images.len() } else { 0 };
        if scene.seeds.len() != expected {
            return Err(InputError::Seeds { found: scene.seeds.len(), expected });
        }
        if let (Some(dino), None) = (&self.config.dino, &self.dino) {
            return Err(InputError::NoDino { model: dino.model });
        }
        let (width, height) = (scene.images[0].width(), scene.images[0].height());
        let others = neighbours(scene.cameras, self.config.num_neighbours);
        let targets: Vec<Vec<usize>> =
            others.iter().enumerate().map(|(v, others)| [&[v], others.as_slice()].concat()).collect();
        let sources = index_tensor(&targets, device);
        let geometry =
            SceneGeometry { cameras: scene.cameras, neighbours: &others, ranges: scene.ranges, sources: &sources };

        let (refined, confidence) = self.depth(scene, &geometry, &index_tensor(&others, device), device);
        let crop = |map: Tensor<4>| cropped(map, scene);
        let disparity = disparity(crop(refined.disparity), scene.ranges);
        let opacity = crop(refined.density);
        let facing = |slopes| -normals_away(scene.cameras, disparity.clone(), crop(slopes), device);
        let normals = refined.slopes.map(facing);
        let of_views = |map: Tensor<4>| map.reshape([scene.images.len(), height, width]);
        let maps = EncoderMaps {
            depth: of_views(disparity.recip()),
            confidence: of_views(crop(confidence)),
            normals,
            choice: refined.choice,
        };
        Ok(Encoded { maps, opacity, features: refined.features, targets })
    }

    /// Features and depth at the padded size; also the confidence.
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
        let context = self.with_dino_features(context, &padded, device);
        match (&self.transformer, &self.coarse, &self.refinement, &self.seeded) {
            (_, _, _, Some(seeded)) => {
                let (width, height) = (padded[0].width(), padded[0].height());
                let seeds: Vec<_> = scene.seeds.iter().map(|seed| seed.padded(width, height)).collect();
                let given = Given::new(&self.config, &padded, &seeds, device);
                let refined = refined_in_passes(seeded, &self.config, &given, images, context, geometry);
                let confidence = refined.density.clone();
                (refined, confidence)
            }
            (Some(transformer), Some(coarse), Some(refinement), _) => {
                let [_, _, rows, columns] = context.dims();
                let lines = transformer.lines(geometry, (columns, rows));
                let matching = transformer.forward(context.clone(), others.clone(), lines);
                let (disparity, confidence) = self.swept(coarse, &matching, geometry);
                let pair = (disparity, confidence.clone());
                let refined = refinement.forward(&self.config, images, (matching, context), pair, geometry);
                (refined, nearest(confidence, 4))
            }
            _ => unreachable!("a network is built with one of the two sources of coarse depth"),
        }
    }

    /// The backbone's features with those of DINO added, where there are some.
    fn with_dino_features(&self, context: Tensor<4>, images: &[Grid<[f32; 3]>], device: &Device) -> Tensor<4> {
        match (&self.dino_fusion, &self.dino) {
            (Some(fusion), Some(dino)) => {
                let patches = dino.patches(image_tensor(images, dino.device()));
                fusion.forward(context, Tensor::from_data(patches.into_data(), device))
            }
            _ => context,
        }
    }

    /// Relative disparity and confidence at stride 4 from the plane sweep.
    fn swept(&self, coarse: &CoarseDepth, matching: &Tensor<4>, geometry: &SceneGeometry) -> (Tensor<4>, Tensor<4>) {
        let [_, _, rows, columns] = matching.dims();
        let num_candidates = self.config.cost_volume.as_ref().map_or(2, |volume| volume.num_candidates);
        let candidates = |range: &DepthRange| uniform_candidates(range, num_candidates);
        let coarse_sweep = sweep(
            warps(geometry.cameras, geometry.neighbours, 4),
            (columns, rows),
            geometry.ranges.iter().map(candidates).collect(),
            SweepBase::Zero,
        );
        let correlation = plane_sweep(matching.clone(), Arc::new(coarse_sweep));
        coarse.forward(correlation, matching.clone(), geometry.sources)
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

/// The encoder's maps and what the surfels need besides.
struct Encoded {
    maps: EncoderMaps,
    /// `[views, 1, height, width]`.
    opacity: Tensor<4>,
    /// At the padded size.
    features: Features,
    /// Views whose images each view's surfels are looked for in, itself first.
    targets: Vec<Vec<usize>>,
}

/// A map of the padded size at that of the photographs.
fn cropped(map: Tensor<4>, scene: &SceneInput) -> Tensor<4> {
    map.narrow(2, 0, scene.images[0].height()).narrow(3, 0, scene.images[0].width())
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
fn image_tensor(images: &[Grid<[f32; 3]>], device: &Device) -> Tensor<4> {
    let (width, height) = (images[0].width(), images[0].height());
    let values: Vec<f32> = images.iter().flat_map(|image| image.as_slice().as_flattened()).copied().collect();
    Tensor::<4>::from_data(TensorData::new(values, [images.len(), height, width, 3]), device).permute([0, 3, 1, 2])
}
