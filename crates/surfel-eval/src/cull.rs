//! Cutting a mesh down to the masked object before it is scored (spec 7.1 a).
//!
//! Published numbers differ by the rule used, so all are here under their names. Invariant: culling only removes
//! faces; it never moves a vertex.

use crate::first_hit::first_hit;
use crate::keep_faces::{keep_faces, without_small_components};
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;
use surfel_core::{Camera, Grid, TriMesh};

/// Which culling goes before the score.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Cull {
    /// Masks of all views, dilated by 24 px at 1600 x 1200: the rule of the 2DGS script, the paper's headline.
    #[default]
    Dense,
    /// Masks and visible faces of the input views only: the rule of the sparse-view literature.
    Sparse,
    /// As it is.
    None,
}

/// A view's camera and object mask (true on the object), of the same size.
#[derive(Clone, Debug)]
pub struct MaskedView {
    /// Camera of the mask.
    pub camera: Camera,
    /// True on the object.
    pub mask: Grid<bool>,
}

/// Image width for which the pixel radii of the protocol are stated.
const STATED_WIDTH: f64 = 1600.0;
const DENSE_RADIUS: f64 = 24.0;
const SPARSE_RADIUS: f64 = 5.0;
const SPARSE_MIN_COMPONENT: usize = 500;

/// The culled mesh; `views` are all views of the scan for [`Cull::Dense`], the input views for [`Cull::Sparse`].
pub fn cull(mesh: &TriMesh, rule: Cull, views: &[MaskedView]) -> TriMesh {
    match rule {
        Cull::Dense => cull_dense(mesh, views),
        Cull::Sparse => cull_sparse(mesh, views, SPARSE_MIN_COMPONENT),
        Cull::None => mesh.clone(),
    }
}

impl Cull {
    /// All rules, strictest published use first.
    pub const ALL: [Self; 3] = [Self::Dense, Self::Sparse, Self::None];

    /// The short name, as typed and tabulated.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dense => "dense",
            Self::Sparse => "sparse",
            Self::None => "none",
        }
    }
}

/// Keeps faces whose three vertices, in every view, fall on the dilated mask or outside the image.
fn cull_dense(mesh: &TriMesh, views: &[MaskedView]) -> TriMesh {
    let dilated = dilated_masks(views, DENSE_RADIUS);
    let survives = |vertex: &[f32; 3]| dilated.iter().all(|view| on_mask(view, *vertex).unwrap_or(true));
    let kept: Vec<bool> = mesh.positions.par_iter().map(survives).collect();
    keep_faces(mesh, |face| mesh.triangles[face].iter().all(|&v| kept[v as usize]))
}

/// Keeps faces on the mask of at least two input views (of the only one, if there is but one) that some masked pixel
/// of an input view sees first, without components below `min_component` faces.
fn cull_sparse(mesh: &TriMesh, views: &[MaskedView], min_component: usize) -> TriMesh {
    let dilated = dilated_masks(views, SPARSE_RADIUS);
    let needed = views.len().min(2);
    let inside =
        |vertex: &[f32; 3]| dilated.iter().filter(|view| on_mask(view, *vertex) == Some(true)).count() >= needed;
    let kept: Vec<bool> = mesh.positions.par_iter().map(inside).collect();
    let mesh = keep_faces(mesh, |face| mesh.triangles[face].iter().all(|&v| kept[v as usize]));
    let mut seen = vec![false; mesh.triangles.len()];
    for view in &dilated {
        let faces = first_hit(&mesh, &view.camera);
        for (face, _) in faces.as_slice().iter().zip(view.mask.as_slice()).filter(|(_, masked)| **masked) {
            if let Some(face) = face {
                seen[*face as usize] = true;
            }
        }
    }
    without_small_components(&keep_faces(&mesh, |face| seen[face]), min_component)
}

/// Whether a point falls on the mask at the nearest pixel; `None` outside the image or behind the camera.
fn on_mask(view: &MaskedView, point: [f32; 3]) -> Option<bool> {
    let (pixel, _) = view.camera.project(DVec3::from(point.map(f64::from)))?;
    view.mask.get(pixel.x.floor() as isize, pixel.y.floor() as isize).copied()
}

fn dilated_masks(views: &[MaskedView], radius_at_stated_width: f64) -> Vec<MaskedView> {
    let dilate = |view: &MaskedView| {
        let radius = radius_at_stated_width * view.camera.width as f64 / STATED_WIDTH;
        MaskedView { camera: view.camera, mask: dilated(&view.mask, radius) }
    };
    views.par_iter().map(dilate).collect()
}

/// The mask grown by a disc: set wherever a set pixel lies within `radius` pixels.
///
/// Linear in the number of pixels: a set pixel `g` rows away covers a run of `sqrt(radius² - g²)` to either side of
/// its column, so a row of the result is the union of the runs of the nearest set pixels above and below.
pub fn dilated(mask: &Grid<bool>, radius: f64) -> Grid<bool> {
    let (width, height) = (mask.width(), mask.height());
    let reach = radius.max(0.0).floor() as usize;
    let half_widths: Vec<usize> =
        (0..=reach).map(|g| (radius * radius - (g * g) as f64).sqrt().floor() as usize).collect();
    let rows = rows_to_nearest(mask, reach + 1);
    let mut grown = vec![false; width * height];
    grown.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        // How many runs begin minus how many have ended, per column.
        let mut steps = vec![0i32; width + 1];
        for (x, &g) in rows.row(y).iter().enumerate().filter(|(_, g)| **g <= reach) {
            steps[x.saturating_sub(half_widths[g])] += 1;
            steps[(x + half_widths[g] + 1).min(width)] -= 1;
        }
        let mut open = 0;
        for (pixel, step) in row.iter_mut().zip(steps) {
            open += step;
            *pixel = open > 0;
        }
    });
    Grid::from_vec(width, height, grown)
}

/// Rows between each pixel and the nearest set pixel of its column; `far` where there is none nearer than that.
fn rows_to_nearest(mask: &Grid<bool>, far: usize) -> Grid<usize> {
    let (width, height) = (mask.width(), mask.height());
    let mut rows = mask.map(|&set| if set { 0 } else { far });
    for y in 1..height {
        for x in 0..width {
            rows[(x, y)] = rows[(x, y)].min(rows[(x, y - 1)] + 1);
        }
    }
    for y in (0..height.saturating_sub(1)).rev() {
        for x in 0..width {
            rows[(x, y)] = rows[(x, y)].min(rows[(x, y + 1)] + 1);
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use surfel_core::{Intrinsics, Rigid};

    #[test]
    fn dilation_reaches_every_pixel_within_the_radius() {
        let mask = Grid::from_fn(23, 17, |x, y| (x * 7 + y * 13) % 41 == 0);
        for radius in [0.0, 1.0, 1.5, 3.0, 5.0] {
            let fast = dilated(&mask, radius);
            let slow = Grid::from_fn(23, 17, |x, y| {
                (0..17).any(|v| {
                    (0..23).any(|u| mask[(u, v)] && (u as f64 - x as f64).hypot(v as f64 - y as f64) <= radius)
                })
            });
            assert_eq!(fast, slow, "radius {radius}");
        }
    }

    /// A camera `distance` in front of the origin, turned about Y by `angle`.
    fn view(angle: f64, mask: impl FnMut(usize, usize) -> bool) -> MaskedView {
        let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 80.0, cy: 60.0 };
        let pose = Rigid::from_quat(DQuat::from_rotation_y(angle), DVec3::new(0.0, 0.0, 10.0));
        let camera = Camera { intrinsics, width: 160, height: 120, camera_from_world: pose };
        MaskedView { camera, mask: Grid::from_fn(160, 120, mask) }
    }

    /// Unit squares of two faces each, at the given centres, facing -Z.
    fn squares(centres: &[[f32; 3]]) -> TriMesh {
        let mut mesh = TriMesh::default();
        for c in centres {
            let first = mesh.positions.len() as u32;
            for (dx, dy) in [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)] {
                mesh.positions.push([c[0] + dx, c[1] + dy, c[2]]);
            }
            mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        mesh
    }

    #[test]
    fn an_empty_mask_stays_empty_and_one_pixel_becomes_a_disc() {
        let empty = Grid::filled(9, 7, false);
        assert_eq!(dilated(&empty, 3.0), empty);
        let mut dot = empty;
        dot[(4, 3)] = true;
        assert_eq!(dilated(&dot, 2.0).as_slice().iter().filter(|&&set| set).count(), 13);
        assert_eq!(dilated(&Grid::filled(0, 0, false), 2.0).len(), 0);
    }

    #[test]
    fn dense_keeps_what_is_on_every_mask_or_outside_the_image() {
        // The mask covers the middle third: x in [-2.7, 2.7] at depth 10.
        let views = [view(0.0, |x, _| (53..107).contains(&x)), view(0.05, |x, _| (40..120).contains(&x))];
        let mesh = squares(&[[0.0; 3], [5.0, 0.0, 0.0], [30.0, 0.0, 0.0]]);
        let kept = cull(&mesh, Cull::Dense, &views);
        let centres: Vec<f32> = kept.positions.chunks(4).map(|c| (c[0][0] + c[2][0]) / 2.0).collect();
        assert_eq!(centres, [0.0, 30.0]);
        assert_eq!(cull(&mesh, Cull::None, &views), mesh);
    }

    #[test]
    fn sparse_keeps_only_what_the_input_views_see_first() {
        let views = [view(0.0, |_, _| true), view(0.1, |_, _| true)];
        // The second square hides behind the first, the third stands apart, the fourth is outside both images.
        let mesh = squares(&[[0.0; 3], [0.0, 0.0, 0.3], [2.0, 0.0, 0.0], [30.0, 0.0, 0.0]]);
        let kept = cull_sparse(&mesh, &views, 1);
        assert!(kept.triangles.len() >= 4);
        let hidden = |p: &&[f32; 3]| p[2] == 0.3;
        // From the side view a rim of the hidden square shows; at least one of its faces goes.
        assert!(kept.positions.iter().filter(hidden).count() < 4);
        assert!(kept.positions.iter().all(|p| p[0] < 10.0));
        assert!(cull_sparse(&mesh, &views, 3).triangles.is_empty());
    }
}
