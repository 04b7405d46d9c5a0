//! What a network costs: its trained parameters, and how much it multiplies for a pair of photographs.
//!
//! Invariant: counted on the graph that runs, not on a description of it.

use crate::config::NetConfig;
use crate::example_scene::ExampleScene;
use crate::model::SurfelNet;
use crate::ops::multiply_adds;
use burn::tensor::Device;
use surfel_features::WeightsError;

/// The cost of a network.
#[derive(Clone, Debug, PartialEq)]
pub struct Cost {
    /// Names and numbers of trained parameters of its parts, in the order they run.
    pub parts: Vec<(&'static str, usize)>,
    /// Multiplications with addition for two photographs, from colours to surfels, frozen features included; see
    /// [`multiply_adds`]. Matching, which comes before a seeded network, is no part of it.
    pub multiply_adds: u64,
}

impl Cost {
    /// Of a network with these settings, for two photographs of `width` x `height` pixels. Runs it once.
    ///
    /// `None` for a network that needs a file of frozen features (DINO).
    ///
    /// # Errors
    /// When the pretrained features cannot be read.
    pub fn of(config: &NetConfig, (width, height): (usize, usize)) -> Result<Option<Self>, WeightsError> {
        if config.dino.is_some() {
            return Ok(None);
        }
        let device = Device::flex();
        // How many pixels surfels ask depends on how large fresh weights make them.
        device.seed(0);
        let net = SurfelNet::new(config.clone(), &device)?;
        let scene = ExampleScene::new(width, height);
        let (prediction, multiply_adds) = multiply_adds(|| net.forward(&scene.input(config.seeded.is_some()), &device));
        Ok(prediction.ok().map(|_| Self { parts: net.parts(), multiply_adds }))
    }

    /// Trained parameters of all parts.
    pub fn num_parameters(&self) -> usize {
        self.parts.iter().map(|(_, count)| count).sum()
    }
}
