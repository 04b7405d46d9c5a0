//! What is known of one view beside its photograph, map by map.
//!
//! Rendered scenes know everything, measured ones have holes, clips know nothing. Invariant: a map that is not known
//! is `None`, and a pixel that was not measured can be told from one where nothing is.

use surfel_core::Grid;
use surfel_synth::RenderedView;

/// The truth of a view; every map there is has the size of its photograph.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewTruth {
    /// How far the surface is.
    pub depth: Option<TrueDepth>,
    /// Unit normals, camera frame, facing the camera; zero where there is none.
    pub normal: Option<Grid<[f32; 3]>>,
    /// True on the objects, false on surroundings and backdrop.
    pub object: Option<Grid<bool>>,
}

/// True z-depth of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct TrueDepth {
    /// Scene units; 0 for none.
    pub map: Grid<f32>,
    /// What a 0 means.
    pub hole: Hole,
}

/// What a pixel without depth is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hole {
    /// There is no surface: a rendered scene knows.
    Empty,
    /// There may be a surface, but nobody measured it.
    Unmeasured,
}

impl ViewTruth {
    /// Of a rendered view, of which all is known.
    pub fn of_rendered(view: &RenderedView) -> Self {
        Self {
            depth: Some(TrueDepth { map: view.depth.clone(), hole: Hole::Empty }),
            normal: Some(view.normal.clone()),
            object: Some(view.object_mask()),
        }
    }

    /// z-depth of a pixel by its place in the grid; 0 where it is not known or there is no surface.
    pub fn depth_at(&self, pixel: usize) -> f32 {
        self.depth.as_ref().map_or(0.0, |depth| depth.map.as_slice()[pixel])
    }

    /// Whether it is known that a pixel shows a surface, or that it shows none.
    pub fn knows_surface_at(&self, pixel: usize) -> bool {
        self.depth.as_ref().is_some_and(|depth| depth.hole == Hole::Empty || depth.map.as_slice()[pixel] > 0.0)
    }

    /// The normal of a pixel; `None` where it is not known or there is no surface.
    pub fn normal_at(&self, pixel: usize) -> Option<[f32; 3]> {
        let normal = self.normal.as_ref()?.as_slice()[pixel];
        (normal != [0.0; 3]).then_some(normal)
    }

    /// Whether a pixel is known to show an object.
    pub fn is_object(&self, pixel: usize) -> bool {
        self.object.as_ref().is_some_and(|object| object.as_slice()[pixel])
    }

    /// As seen in a mirror that swaps left and right.
    pub fn mirrored(&self) -> Self {
        let flipped = |depth: &TrueDepth| TrueDepth { map: depth.map.flipped(), hole: depth.hole };
        Self {
            depth: self.depth.as_ref().map(flipped),
            normal: self.normal.as_ref().map(|map| map.flipped().map(|[x, y, z]| [-x, *y, *z])),
            object: self.object.as_ref().map(Grid::flipped),
        }
    }
}
