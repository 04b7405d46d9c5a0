//! All terms of one view with their weights (paper: `L`; spec 4.3).
//!
//! Invariants: a term without truth or with weight 0 is not computed, and every term that is computed is reported
//! by name beside its weight.

use crate::error::LossError;
use crate::perceptual::Perceptual;
use crate::{alignment, depth, normal, photometric, silhouette};
use burn::tensor::Tensor;
use surfel_core::Intrinsics;
use surfel_net::{DepthRange, RenderedMaps};

/// Weights of the terms; `Default` is spec 4.3 with all terms on. A weight of 0 switches a term off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recipe {
    /// Of the squared difference of colours.
    pub photometric: f64,
    /// Of LPIPS or `1 - SSIM`.
    pub perceptual: f64,
    /// Of surfels against the normals of their depth.
    pub alignment: f64,
    /// Of the median depth rendered against measured depth.
    pub rendered_depth: f64,
    /// Of normals rendered against measured ones.
    pub normal: f64,
    /// Of alpha against a mask.
    pub silhouette: f64,
    /// Which depth the alignment looks at: 0 the expected one, which is smoother, 1 the median.
    pub depth_ratio: f64,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            photometric: 1.0,
            perceptual: 0.05,
            alignment: 0.05,
            rendered_depth: 0.5,
            normal: 0.4,
            silhouette: 0.1,
            depth_ratio: 1.0,
        }
    }
}

impl Recipe {
    /// Whether any term has a weight and its truth; if not, the view need not be rendered.
    pub fn can_tell(&self, truth: &Truth) -> bool {
        let of_pictures = self.photometric != 0.0 || self.perceptual != 0.0 || self.alignment != 0.0;
        let of_depth = self.rendered_depth != 0.0 && truth.depth.is_some();
        let of_normals = self.normal != 0.0 && truth.normals.is_some();
        of_pictures || of_depth || of_normals || (self.silhouette != 0.0 && truth.mask.is_some())
    }
}

/// What is known of one view; whatever is missing skips its term.
#[derive(Clone, Debug)]
pub struct Truth {
    /// sRGB in \[0, 1\], `[3, height, width]`.
    pub photograph: Tensor<3>,
    /// z-depth, scene units, 0 for none, `[height, width]`.
    pub depth: Option<Tensor<2>>,
    /// Unit normals in the frame of the view's camera, facing it, `[3, height, width]`, and where they are known
    /// (1) or not (0), `[height, width]`.
    pub normals: Option<(Tensor<3>, Tensor<2>)>,
    /// 1 on the object, 0 off it, `[height, width]`.
    pub mask: Option<Tensor<2>>,
}

/// One term.
#[derive(Clone, Debug)]
pub struct Term {
    /// What to write in a log.
    pub name: &'static str,
    /// What it is multiplied by.
    pub weight: f64,
    /// Before that.
    pub value: Tensor<1>,
}

/// Terms to be added up.
#[derive(Clone, Debug, Default)]
pub struct Terms {
    /// In the order they were added.
    pub list: Vec<Term>,
}

impl Terms {
    /// Adds a term unless its weight is 0, in which case it is not even computed.
    pub fn add(&mut self, name: &'static str, weight: f64, value: impl FnOnce() -> Tensor<1>) {
        if weight != 0.0 {
            self.list.push(Term { name, weight, value: value() });
        }
    }

    /// Name and value of each, before its weight.
    pub fn named(&self) -> Vec<(&'static str, f64)> {
        let value = |term: &Term| f64::from(term.value.clone().into_scalar::<f32>());
        self.list.iter().map(|term| (term.name, value(term))).collect()
    }

    /// The weighted sum; `None` without terms.
    pub fn total(&self) -> Option<Tensor<1>> {
        self.list.iter().map(|term| term.value.clone() * term.weight).reduce(|sum, term| sum + term)
    }
}

/// The terms of one rendered view. Those of the prediction itself, [`crate::opacity`] and [`crate::depth`] of the
/// network's own depth, are added by whoever holds it.
///
/// # Errors
/// [`LossError`] when the photograph has another size than the maps, or both are too small for the perceptual term.
pub fn view_terms(
    maps: &RenderedMaps,
    truth: &Truth,
    (intrinsics, range): (&Intrinsics, &DepthRange),
    perceptual: &Perceptual,
    recipe: &Recipe,
) -> Result<Terms, LossError> {
    let (picture, photograph) = (|| maps.colour.clone(), || truth.photograph.clone());
    crate::error::check_pair("a rendering", 1, maps.colour.dims(), truth.photograph.dims())?;
    let mut terms = Terms::default();
    terms.add("photometric", recipe.photometric, || photometric(picture(), photograph()));
    if recipe.perceptual != 0.0 {
        let distance = perceptual.distance(picture(), photograph())?;
        terms.add(perceptual.name(), recipe.perceptual, || distance);
    }
    terms.add("alignment", recipe.alignment, || {
        alignment(maps.alpha.clone(), maps.normal.clone(), maps.surface_depth(recipe.depth_ratio), intrinsics)
    });
    if let Some(measured) = &truth.depth {
        terms
            .add("rendered depth", recipe.rendered_depth, || depth(maps.depth_median.clone(), measured.clone(), range));
    }
    if let Some((normals, mask)) = &truth.normals {
        terms.add("normal", recipe.normal, || normal(maps.normal.clone(), normals.clone(), mask.clone()));
    }
    if let Some(mask) = &truth.mask {
        terms.add("silhouette", recipe.silhouette, || silhouette(maps.alpha.clone(), mask.clone()));
    }
    Ok(terms)
}
