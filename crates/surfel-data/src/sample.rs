//! A scene to train on, and how every reader gives one.
//!
//! Lengths are in *scene units*, in which the set's depth range is what the network was made for; `unit_to_world`
//! times a length is a length in the unit of the files (spec 1.3). Invariant: all maps of a view have the size of its
//! image, depth is 0 where there is none, and a normal is zero where there is none.

use crate::DataError;
use crate::choice::Choice;
use crate::fit::{check_field_of_view, fitted};
use crate::pairs::PairList;
use surfel_core::{Camera, Grid};

/// A photograph with its camera and whatever is known of its surface.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingView {
    /// Scene and frame, for messages.
    pub name: String,
    /// sRGB in \[0, 1\].
    pub image: Grid<[f32; 3]>,
    /// Camera of the image, scene units.
    pub camera: Camera,
    /// True z-depth, scene units; 0 where there is none.
    pub depth: Option<Grid<f32>>,
    /// True unit normals, camera frame, facing the camera; zero where there is none.
    pub normal: Option<Grid<[f32; 3]>>,
    /// True where the truth is to be believed.
    pub mask: Option<Grid<bool>>,
}

/// Views of one scene: those the network sees and those it has to predict.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingScene {
    /// As the set names it.
    pub name: String,
    /// Input views.
    pub contexts: Vec<TrainingView>,
    /// Views to render.
    pub targets: Vec<TrainingView>,
    /// Nearest depth of the scene, scene units.
    pub near: f64,
    /// Farthest depth of the scene, scene units.
    pub far: f64,
    /// Files' units per scene unit.
    pub unit_to_world: f64,
}

/// A scene on disk, of which single views can be read.
pub trait SceneViews {
    /// As the set names it.
    fn name(&self) -> &str;

    /// Number of views.
    fn num_views(&self) -> usize;

    /// Nearest and farthest depth, scene units.
    fn range(&self) -> (f64, f64);

    /// Files' units per scene unit.
    fn unit_to_world(&self) -> f64 {
        1.0
    }

    /// Which views go together, where the set says it.
    fn pairs(&self) -> Option<&PairList> {
        None
    }

    /// Reads one view at its own size.
    ///
    /// # Errors
    /// [`DataError`], naming the file and the view.
    ///
    /// # Panics
    /// If there is no such view.
    fn view(&mut self, index: usize) -> Result<TrainingView, DataError>;
}

/// Reads the chosen views, all brought to `width` x `height` pixels.
///
/// # Errors
/// [`DataError`] when a view cannot be read, is too small, or has a field of view above 100 degrees (spec 4.6).
pub fn load(
    scene: &mut dyn SceneViews,
    choice: &Choice,
    width: usize,
    height: usize,
) -> Result<TrainingScene, DataError> {
    let mut views = |indices: &[usize]| -> Result<Vec<TrainingView>, DataError> {
        let mut view = |&index: &usize| {
            let view = scene.view(index)?;
            check_field_of_view(&view)?;
            fitted(&view, width, height)
        };
        indices.iter().map(&mut view).collect()
    };
    let (contexts, targets) = (views(&choice.contexts)?, views(&choice.targets)?);
    let (near, far) = scene.range();
    let (name, unit_to_world) = (scene.name().to_owned(), scene.unit_to_world());
    Ok(TrainingScene { name, contexts, targets, near, far, unit_to_world })
}
