//! One training sample: posed photographs, what matching says of them, and the truth.
//!
//! Made by [`Sample::matched`], exactly as the road prepares a scene. Invariant: every map has the size of its
//! photograph, and every view says which truth is known of it.

use crate::error::TrainError;
use crate::truth::ViewTruth;
use surfel_core::{Camera, Grid, View};
use surfel_net::{DepthRange, NetConfig, SceneInput, Seed};
use surfel_stereo::MatchConfig;
use surfel_stereo::candidates::Candidates;
use surfel_stereo::photographs::match_photographs;
use surfel_synth::{Random, RenderedView};

/// A scene to learn from.
#[derive(Clone, Debug, Default)]
pub struct Sample {
    /// sRGB in \[0, 1\].
    pub images: Vec<Grid<[f32; 3]>>,
    /// Their cameras.
    pub cameras: Vec<Camera>,
    /// Depths searched, scene units.
    pub ranges: Vec<DepthRange>,
    /// What matching found in each view; empty where it was left out.
    pub seeds: Vec<Seed>,
    /// What is known of each view.
    pub truth: Vec<ViewTruth>,
    /// Views that the network is not given.
    pub targets: Vec<Target>,
}

/// A view held out: the network is not given it, and what it predicts is rendered there and compared.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// sRGB in \[0, 1\], of the size of the sample.
    pub image: Grid<[f32; 3]>,
    /// Its camera.
    pub camera: Camera,
    /// Depths the scene may have, scene units.
    pub range: DepthRange,
    /// What is known of it.
    pub truth: ViewTruth,
}

impl Target {
    /// Of a view and what is known of it.
    pub fn new(view: View, range: DepthRange, truth: ViewTruth) -> Self {
        Self { image: view.image.map(in_8_bits), camera: view.camera, range, truth }
    }
}

/// Photographs have 8 bits, and a sample read back from disk must be the one that was made.
fn in_8_bits(rgb: &[f32; 3]) -> [f32; 3] {
    rgb.map(|c| (255.0 * c).round().clamp(0.0, 255.0) / 255.0)
}

/// How much wider than the truth a searched range is, at most: on the near side and on the far side.
const WIDENING: [f64; 2] = [0.4, 0.8];
/// Shares of the true depths a range must hold; what lies beyond is left to the network's judgement.
const HELD: [f64; 2] = [0.01, 0.99];

impl Sample {
    /// Rendered views `given` to the network, not matched yet, and views `held_out` as targets; `random` widens the
    /// range that is searched, since nobody knows it exactly.
    ///
    /// # Errors
    /// When the views show no surface.
    pub fn of(given: &[RenderedView], held_out: &[RenderedView], random: &mut Random) -> Result<Self, TrainError> {
        let range = searched_range(given, random).ok_or(TrainError::EmptyScene)?;
        let views = given.iter().map(|rendered| rendered.view.clone()).collect();
        let target =
            |rendered: &RenderedView| Target::new(rendered.view.clone(), range, ViewTruth::of_rendered(rendered));
        let sample = Self::new(views, range, given.iter().map(ViewTruth::of_rendered).collect());
        Ok(Self { targets: held_out.iter().map(target).collect(), ..sample })
    }

    /// Views in a range of depths, scene units, not matched yet; `truth` is what is known of each.
    pub fn new(views: Vec<View>, range: DepthRange, truth: Vec<ViewTruth>) -> Self {
        Self {
            cameras: views.iter().map(|view| view.camera).collect(),
            ranges: vec![range; views.len()],
            images: views.into_iter().map(|view| view.image.map(in_8_bits)).collect(),
            seeds: Vec::new(),
            truth,
            targets: Vec::new(),
        }
    }

    /// The sample with what matching finds in its views.
    ///
    /// # Errors
    /// When the pretrained features cannot be read.
    pub fn matched(self) -> Result<Self, TrainError> {
        let view = |(image, camera): (&Grid<[f32; 3]>, &Camera)| View::new("", image.clone(), *camera);
        let views: Vec<View> = self.images.iter().zip(&self.cameras).map(view).collect();
        let neighbours: Vec<Vec<usize>> = (0..views.len()).map(|v| self.others(v).collect()).collect();
        let limits: Vec<(f64, f64)> = self.ranges.iter().map(|range| (range.near, range.far)).collect();
        let estimates = match_photographs(&views, &neighbours, &limits, &MatchConfig::default())?;
        Ok(Self { seeds: estimates.iter().map(Seed::from).collect(), ..self })
    }

    /// The views given but one.
    fn others(&self, view: usize) -> impl Iterator<Item = usize> {
        (0..self.num_views()).filter(move |other| *other != view)
    }

    /// Inverse depth per view given that moves a neighbour's pixel by about one, 1 / scene unit; matching's own where
    /// it has been done.
    pub fn steps(&self) -> Vec<f32> {
        let of_geometry = |v: usize| {
            let (others, DepthRange { near, far }) = (self.others(v), self.ranges[v]);
            let others: Vec<Camera> = others.map(|other| self.cameras[other]).collect();
            Candidates::for_pair(&self.cameras[v], &others, near, far, 1.0).step as f32
        };
        (0..self.num_views()).map(|v| self.seeds.get(v).map_or_else(|| of_geometry(v), |seed| seed.step)).collect()
    }

    /// Number of views the network is given.
    pub fn num_views(&self) -> usize {
        self.images.len()
    }

    /// Columns and rows of every map.
    pub fn size(&self) -> (usize, usize) {
        (self.images[0].width(), self.images[0].height())
    }

    /// Pixels of every map.
    pub fn num_pixels(&self) -> usize {
        self.images[0].len()
    }

    /// What a network is given of it; what matching found only if it starts from there.
    pub fn input(&self, network: &NetConfig) -> SceneInput<'_> {
        let seeds = if network.seeded.is_some() { self.seeds.as_slice() } else { &[] };
        SceneInput { images: &self.images, cameras: &self.cameras, ranges: &self.ranges, seeds }
    }
}

/// A range that holds nearly all true depths of all views, widened by chance.
fn searched_range(rendered: &[RenderedView], random: &mut Random) -> Option<DepthRange> {
    let mut depths: Vec<f32> =
        rendered.iter().flat_map(|view| view.depth.as_slice()).copied().filter(|z| *z > 0.0).collect();
    if depths.is_empty() {
        return None;
    }
    depths.sort_by(f32::total_cmp);
    let [near, far] = HELD.map(|share| f64::from(depths[((depths.len() - 1) as f64 * share) as usize]));
    let range = DepthRange {
        near: near / (1.02 + random.range(0.0, WIDENING[0])),
        far: far * (1.02 + random.range(0.0, WIDENING[1])),
    };
    range.is_usable().then_some(range)
}
