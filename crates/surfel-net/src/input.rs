//! What the network is given, checked before anything is computed.
//!
//! Invariant: a scene that passed [`SceneInput::check`] cannot make the network panic.

use crate::config::DinoModel;
use crate::cost_volume::DepthRange;
use crate::seed::Seed;
use surfel_core::{Camera, Grid};

/// Posed views of one scene; one image, camera and range per view, all images of one size.
#[derive(Clone, Copy, Debug)]
pub struct SceneInput<'a> {
    /// sRGB in \[0, 1\].
    pub images: &'a [Grid<[f32; 3]>],
    /// Cameras of the images.
    pub cameras: &'a [Camera],
    /// Depths each view may contain, scene units.
    pub ranges: &'a [DepthRange],
    /// What matching found in each view, for a seeded network; empty for any other.
    pub seeds: &'a [Seed],
}

/// Why a scene is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InputError {
    /// Fewer than two views.
    #[error("the network needs at least 2 views and was given {0}; add photographs")]
    TooFewViews(usize),
    /// Lists of different lengths.
    #[error(
        "{images} images, {cameras} cameras and {ranges} depth ranges were given; there must be one of each per view"
    )]
    Lengths {
        /// Number of images.
        images: usize,
        /// Number of cameras.
        cameras: usize,
        /// Number of ranges.
        ranges: usize,
    },
    /// An image or camera of another size than the first image, or without pixels.
    #[error(
        "view {view} is {found:?} pixels (columns, rows) where view 0 is {expected:?}; resize all views to one size"
    )]
    Size {
        /// Index of the view.
        view: usize,
        /// Its size.
        found: (usize, usize),
        /// Size of the first image.
        expected: (usize, usize),
    },
    /// A camera that cannot project.
    #[error("the camera of view {view} cannot be used: {reason}")]
    Camera {
        /// Index of the view.
        view: usize,
        /// Why.
        reason: String,
    },
    /// A depth range that is empty or not positive.
    #[error("the depth range of view {view} is {near} to {far}; it must be positive, finite and not empty")]
    Range {
        /// Index of the view.
        view: usize,
        /// Near end.
        near: f64,
        /// Far end.
        far: f64,
    },
    /// Seeds for a network without use for them, or none for one that needs them.
    #[error("{found} seeds were given where the network expects {expected}; run matching for a seeded network only")]
    Seeds {
        /// Number of seeds.
        found: usize,
        /// Number the network needs.
        expected: usize,
    },
    /// A seed of another size than its image, or with values that are not finite.
    #[error("the seed of view {view} cannot be used: its maps must have the size of the image and finite values")]
    Seed {
        /// Index of the view.
        view: usize,
    },
    /// A network with DINO features whose DINO weights were never given.
    #[error(
        "the network adds features of {model}, whose weights it was not given; name their file with `--dino`, in [dino] of its settings, or by `SurfelNet::with_dino`"
    )]
    NoDino {
        /// The model.
        model: DinoModel,
    },
    /// A pixel that is not a number.
    #[error("the image of view {view} holds a value that is not a finite number; read the photograph again")]
    Pixel {
        /// Index of the view.
        view: usize,
    },
}

impl SceneInput<'_> {
    /// # Errors
    /// [`InputError`], naming the view.
    pub fn check(&self) -> Result<(), InputError> {
        let (images, cameras, ranges) = (self.images.len(), self.cameras.len(), self.ranges.len());
        if cameras != images || ranges != images {
            return Err(InputError::Lengths { images, cameras, ranges });
        }
        if images < 2 {
            return Err(InputError::TooFewViews(images));
        }
        let expected = (self.images[0].width(), self.images[0].height());
        for (view, ((image, camera), range)) in self.images.iter().zip(self.cameras).zip(self.ranges).enumerate() {
            for found in [(image.width(), image.height()), (camera.width, camera.height)] {
                if found != expected || image.is_empty() {
                    return Err(InputError::Size { view, found, expected });
                }
            }
            surfel_raster::pixel_camera::PixelCamera::new(camera)
                .map_err(|error| InputError::Camera { view, reason: error.to_string() })?;
            if !range.is_usable() {
                return Err(InputError::Range { view, near: range.near, far: range.far });
            }
            if image.as_slice().as_flattened().iter().any(|value| !value.is_finite()) {
                return Err(InputError::Pixel { view });
            }
        }
        let usable = |seed: &Seed| seed.size() == Some(expected) && seed.is_finite();
        match self.seeds.iter().position(|seed| !usable(seed)) {
            Some(view) => Err(InputError::Seed { view }),
            None => Ok(()),
        }
    }

    /// The images extended right and down to multiples of `multiple` by repeating their border.
    pub(crate) fn padded_images(&self, multiple: usize) -> Vec<Grid<[f32; 3]>> {
        let extend = |image: &Grid<[f32; 3]>| {
            let (width, height) = (image.width(), image.height());
            Grid::from_fn(width.next_multiple_of(multiple), height.next_multiple_of(multiple), |x, y| {
                image[(x.min(width - 1), y.min(height - 1))]
            })
        };
        self.images.iter().map(extend).collect()
    }
}
