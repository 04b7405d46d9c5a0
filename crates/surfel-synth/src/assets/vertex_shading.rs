//! What is computed once per mesh to shade it well: smooth normals and ambient occlusion at the corners.
//!
//! Invariant: depends on positions only, so a vertex repeated at a texture seam shades the same on both sides.

use super::mesh::TexturedMesh;
use glam::Vec3;
use std::collections::HashMap;

/// Edges sharper than this stay sharp in shading, cosine of degrees.
const CREASE_COSINE: f32 = 0.64;
/// Rays per vertex that measure [`SurfacePoint::openness`].
const OPENNESS_RAYS: usize = 24;
/// How far those rays look, in mesh radii.
const OPENNESS_REACH: f32 = 0.7;
impl TexturedMesh {
    /// Area-weighted corner normals over faces that meet within the crease angle, across texture seams.
    pub(super) fn smooth_normals(&mut self) {
        let mut around: HashMap<[u32; 3], Vec<Vec3>> = HashMap::new();
        let faces: Vec<Vec3> = self.triangles.iter().map(|t| Vec3::from(t.edges[0].cross(t.edges[1]))).collect();
        for (i, face) in faces.iter().enumerate() {
            for p in self.positions(i) {
                around.entry(position_key(p)).or_default().push(*face);
            }
        }
        for (i, face) in faces.iter().enumerate() {
            let positions = self.positions(i);
            let own = face.normalize_or(Vec3::Z);
            self.corners[i].normals = positions.map(|p| {
                let near = around[&position_key(p)].iter().filter(|n| n.normalize_or_zero().dot(own) > CREASE_COSINE);
                near.sum::<Vec3>().normalize_or(own)
            });
        }
    }

    /// Ambient occlusion by the mesh itself, per vertex.
    pub(super) fn measure_openness(&mut self) {
        let mut known: HashMap<([u32; 3], [i8; 3]), f32> = HashMap::new();
        for i in 0..self.triangles.len() {
            let (positions, normals) = (self.positions(i), self.corners[i].normals);
            self.corners[i].openness = std::array::from_fn(|k| {
                let key = (position_key(positions[k]), normals[k].to_array().map(|n| (n * 8.0) as i8));
                *known.entry(key).or_insert_with(|| self.openness_at(positions[k], normals[k]))
            });
        }
    }

    fn openness_at(&self, point: Vec3, normal: Vec3) -> f32 {
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        let origin = point + normal * 2e-3;
        let open = (0..OPENNESS_RAYS).filter(|&i| {
            // Cosine-weighted spiral: the same fixed directions at every vertex, hence no noise between runs.
            let radius_sq = (i as f32 + 0.5) / OPENNESS_RAYS as f32;
            let angle = 2.399_963 * i as f32;
            let (r, z) = (radius_sq.sqrt(), (1.0 - radius_sq).sqrt());
            let direction = tangent * (r * angle.cos()) + bitangent * (r * angle.sin()) + normal * z;
            !self.occludes(origin, direction, 0.0, OPENNESS_REACH)
        });
        open.count() as f32 / OPENNESS_RAYS as f32
    }
}

fn position_key(p: Vec3) -> [u32; 3] {
    // Scans repeat a vertex bit for bit at texture seams; adding zero merges -0 with 0.
    p.to_array().map(|v| (v + 0.0).to_bits())
}
