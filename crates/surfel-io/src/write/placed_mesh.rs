//! A mesh of the working frame as it stands in the scene, computed in double precision.
//!
//! All mesh formats start here. Invariant: positions are `scene_from_mesh` of the stored ones in f64,
//! rounded by nobody before the format has chosen its precision.

use super::error::unfit;
use glam::{DVec3, Vec3};
use std::io;
use surfel_core::{Similarity, TriMesh};

/// A mesh and where it stands in the scene.
#[derive(Clone, Copy, Debug)]
pub struct PlacedMesh<'a> {
    /// The mesh, in the producer's frame.
    pub mesh: &'a TriMesh,
    /// Scene frame from the frame of the mesh.
    pub scene_from_mesh: Similarity,
}

impl<'a> PlacedMesh<'a> {
    /// A mesh whose positions are already in the scene frame.
    pub fn in_scene(mesh: &'a TriMesh) -> Self {
        Self { mesh, scene_from_mesh: Similarity::IDENTITY }
    }

    /// Vertex positions, scene frame and units.
    pub fn positions(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.mesh.positions.iter().map(|p| self.scene_from_mesh.transform(Vec3::from(*p).as_dvec3()))
    }

    /// Unit vertex normals in the scene frame; none when the mesh has none. A normal without direction
    /// becomes +Z, since readers insist on unit length.
    pub fn normals(&self) -> impl Iterator<Item = Vec3> + '_ {
        let rotation = self.scene_from_mesh.rotation;
        self.mesh.normals.iter().map(move |n| (rotation * Vec3::from(*n).as_dvec3()).normalize_or(DVec3::Z).as_vec3())
    }

    /// Corners of the axis-aligned box in the scene frame; `None` for an empty mesh.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        bounds(self.positions())
    }

    /// True when positions need doubles: see `loses_in_single`.
    pub fn needs_double(&self) -> bool {
        self.bounds().is_some_and(|(low, high)| loses_in_single(low, high))
    }

    /// That every parallel array and index fits.
    pub(super) fn check(&self) -> io::Result<()> {
        let TriMesh { positions, normals, colours, triangles } = self.mesh;
        let n = positions.len();
        if !(normals.is_empty() || normals.len() == n) || !(colours.is_empty() || colours.len() == n) {
            let (normals, colours) = (normals.len(), colours.len());
            return Err(unfit(format!("the mesh has {n} vertices but {normals} normals and {colours} colours")));
        }
        if n > i32::MAX as usize {
            return Err(unfit(format!("the mesh has {n} vertices, more than 32-bit indices reach; use larger voxels")));
        }
        match triangles.iter().flatten().find(|&&v| v as usize >= n) {
            Some(v) => Err(unfit(format!("a triangle uses vertex {v}, but the mesh has only {n} vertices"))),
            None => Ok(()),
        }
    }
}

/// Component-wise minimum and maximum; `None` without points.
pub(super) fn bounds(points: impl Iterator<Item = DVec3>) -> Option<(DVec3, DVec3)> {
    points.fold(None, |seen, p| Some(seen.map_or((p, p), |(low, high)| (p.min(low), p.max(high)))))
}

/// True when f32 would move some point of the box by more than 1e-4 of the box's longest side, as happens
/// far from the origin (map coordinates). A single point has no detail to lose.
pub(super) fn loses_in_single(low: DVec3, high: DVec3) -> bool {
    let farthest = low.abs().max(high.abs()).max_element();
    let half_ulp = farthest * f64::from(f32::EPSILON) / 2.0;
    let extent = (high - low).max_element();
    extent > 0.0 && half_ulp > 1e-4 * extent
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubles_are_asked_for_only_far_from_the_origin() {
        let side = DVec3::splat(10.0);
        assert!(!loses_in_single(DVec3::splat(-5.0), DVec3::splat(5.0)));
        assert!(!loses_in_single(DVec3::splat(5_000.0), DVec3::splat(5_000.0) + side));
        let utm = DVec3::new(4.5e5, 5.4e6, 300.0);
        assert!(loses_in_single(utm, utm + side));
        assert!(!loses_in_single(utm, utm));
    }

    #[test]
    fn an_index_out_of_range_is_a_sentence() {
        let mesh = TriMesh { positions: vec![[0.0; 3]; 3], triangles: vec![[0, 1, 7]], ..TriMesh::default() };
        let message = PlacedMesh::in_scene(&mesh).check().unwrap_err().to_string();
        assert_eq!(message, "a triangle uses vertex 7, but the mesh has only 3 vertices");
    }
}
