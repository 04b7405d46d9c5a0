//! Scenes by seed from either world, analytic or scanned, in one form: pictures, exact maps and exact surface.
//!
//! What commands and experiments draw from, so that none of them cares where a scene came from. Invariant: a source
//! and a seed name a scene for good.

use crate::assets::{AssetError, AssetLibrary, SceneSampler, Split, SynthConfig};
use crate::options::{SceneKind, SceneOptions};
use crate::render::RenderedView;
use crate::truth::SurfaceSamples;
use surfel_core::TriMesh;

/// Where scenes come from.
pub enum SceneSource {
    /// Analytic shapes: seed `i` is kind `i mod len`.
    Analytic {
        /// The kinds, at least one.
        kinds: Vec<SceneKind>,
        /// All else; kind and seed are replaced.
        options: SceneOptions,
    },
    /// Scanned objects.
    Scanned {
        /// The opened folder.
        library: Box<AssetLibrary>,
        /// Which side of the split it was opened for; names the scenes.
        split: Split,
        /// What is drawn.
        config: SynthConfig,
    },
}

/// A scene and everything that is true of it.
pub struct TrueScene {
    /// "sphere-0", "val-7": source and seed.
    pub name: String,
    /// The photographs with exact depth, normal and object.
    pub views: Vec<RenderedView>,
    /// Points on the objects that at least one view sees, uniform by area.
    pub surface: SurfaceSamples,
    /// The objects as triangles, where they are made of any.
    pub objects: Option<TriMesh>,
}

impl SceneSource {
    /// The scene named `seed`; its surface has one point per `spacing²` (scene units) on average.
    ///
    /// # Errors
    /// When an asset it needs cannot be read.
    pub fn scene(&self, seed: u64, spacing: f64) -> Result<TrueScene, AssetError> {
        let name = self.name(seed);
        match self {
            Self::Analytic { .. } => {
                let options = self.analytic(seed);
                let scene = options.scene();
                let samples = scene.object_samples(spacing, seed);
                let surface = scene.visible_samples(&samples, &options.cameras());
                Ok(TrueScene { name, views: options.render(), surface, objects: None })
            }
            Self::Scanned { library, config, .. } => {
                let scene = SceneSampler::new(library, config.clone()).scene(seed)?;
                let views = (0..scene.num_views()).map(|i| scene.render(i)).collect();
                let surface = scene.seen_samples(spacing, seed);
                Ok(TrueScene { name, views, surface, objects: Some(scene.object_mesh()) })
            }
        }
    }

    /// Only the views of the scene named `seed`.
    ///
    /// # Errors
    /// As [`Self::scene`].
    pub fn views(&self, seed: u64) -> Result<Vec<RenderedView>, AssetError> {
        match self {
            Self::Analytic { .. } => Ok(self.analytic(seed).render()),
            Self::Scanned { library, config, .. } => {
                let scene = SceneSampler::new(library, config.clone()).scene(seed)?;
                Ok((0..scene.num_views()).map(|i| scene.render(i)).collect())
            }
        }
    }

    /// The name of the scene of a seed, unique within the source.
    pub fn name(&self, seed: u64) -> String {
        match self {
            Self::Analytic { .. } => format!("{}-{seed}", self.analytic(seed).kind.name()),
            Self::Scanned { split: Split::Train, .. } => format!("train-{seed}"),
            Self::Scanned { split: Split::Val, .. } => format!("val-{seed}"),
        }
    }

    /// The options of an analytic seed; those of a default scene for any other source.
    fn analytic(&self, seed: u64) -> SceneOptions {
        match self {
            Self::Analytic { kinds, options } => {
                let kind = kinds.get((seed % kinds.len().max(1) as u64) as usize).copied().unwrap_or(options.kind);
                SceneOptions { kind, seed, ..options.clone() }
            }
            Self::Scanned { .. } => SceneOptions { seed, ..SceneOptions::default() },
        }
    }
}
