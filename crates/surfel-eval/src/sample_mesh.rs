//! Points spread over a mesh at a given spacing, as the DTU protocol draws them (spec 7.1 b).
//!
//! Every triangle is covered by a lattice along two of its edges, stretched so that a lattice cell has area
//! `spacing²`; all vertices are added. Invariant: the points lie on the triangles, and their order is that of the mesh.

use crate::keep_faces::keep_faces;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use surfel_core::TriMesh;

/// Points on the mesh about `spacing` apart (scene units), before thinning: all vertices, then the
/// lattice points triangle by triangle. A degenerate triangle contributes only its vertices.
pub fn sample_mesh(mesh: &TriMesh, spacing: f64) -> Vec<[f32; 3]> {
    let lattice: Vec<[f32; 3]> = (0..mesh.triangles.len())
        .into_par_iter()
        .with_min_len(1024)
        .flat_map_iter(|triangle| {
            triangle_lattice(mesh.corners(triangle).map(|c| DVec3::from(c.map(f64::from))), spacing)
        })
        .collect();
    let mut points = mesh.positions.clone();
    points.extend(lattice);
    points
}

/// [`sample_mesh`] of the triangles with a corner inside the box of `reference` grown by `reach` (scene units) on every
/// side; the others are their vertices. For scores in which a point counts at most `reach`: a backdrop at infinity,
/// which costs the same however densely it is sampled, has room for more points than any memory.
pub fn sample_mesh_near(mesh: &TriMesh, spacing: f64, reference: &[[f32; 3]], reach: f64) -> Vec<[f32; 3]> {
    let corners = reference.iter().map(|point| Vec3::from(*point));
    let (low, high) =
        corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), point| (low.min(point), high.max(point)));
    let (low, high) = (low - reach as f32, high + reach as f32);
    let is_inside = |corner: &[f32; 3]| {
        let corner = Vec3::from(*corner);
        corner.cmpge(low).all() && corner.cmple(high).all()
    };
    let is_near = |triangle: usize| mesh.corners(triangle).iter().any(is_inside);
    let mut points = sample_mesh(&keep_faces(mesh, is_near), spacing);
    points.extend(keep_faces(mesh, |triangle| !is_near(triangle)).positions);
    points
}

fn triangle_lattice([a, b, c]: [DVec3; 3], spacing: f64) -> impl Iterator<Item = [f32; 3]> {
    let (edge_1, edge_2) = (b - a, c - a);
    let (length_1, length_2) = (edge_1.length(), edge_2.length());
    let twice_area = edge_1.cross(edge_2).length();
    // Stretched by 1 / sqrt(sin of the angle between the edges): a sheared cell keeps its area.
    let step = spacing * (length_1 * length_2 / twice_area).sqrt();
    let count = |length: f64| {
        let steps = (length / step).floor();
        if twice_area > 0.0 && steps.is_finite() { steps as usize } else { 0 }
    };
    let (n1, n2) = (count(length_1), count(length_2));
    // An edge shorter than one step gives no lattice at all: the vertices stand for the triangle.
    let rows = if n1 == 0 || n2 == 0 { 0 } else { n1 };
    (0..rows).flat_map(move |i| {
        let s = (i as f64 + 0.5) / n1 as f64;
        (0..n2)
            .map(move |j| (s, (j as f64 + 0.5) / n2 as f64))
            .take_while(|(s, t)| s + t < 1.0)
            .map(move |(s, t)| (a + edge_1 * s + edge_2 * t).as_vec3().to_array())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The rule as spec 7.1 b states it, loop by loop: the extra row `i = n`, `j = n` and the `1e-7` included.
    fn as_stated([a, b, c]: [DVec3; 3], tau: f64) -> Vec<[f32; 3]> {
        let (v1, v2) = (b - a, c - a);
        let (l1, l2, a2) = (v1.length(), v2.length(), v1.cross(v2).length());
        if a2 == 0.0 {
            return Vec::new();
        }
        let thr = tau * (l1 * l2 / a2).sqrt();
        let (n1, n2) = ((l1 / thr).floor() as usize, (l2 / thr).floor() as usize);
        let (d1, d2) = ((n1 as f64).max(1e-7), (n2 as f64).max(1e-7));
        let mut points = Vec::new();
        for i in 0..=n1 {
            for j in 0..=n2 {
                let (s, t) = ((i as f64 + 0.5) / d1, (j as f64 + 0.5) / d2);
                if s + t < 1.0 {
                    points.push((a + v1 * s + v2 * t).as_vec3().to_array());
                }
            }
        }
        points
    }

    proptest! {
        #[test]
        fn the_lattice_is_the_one_of_the_protocol(
            corners in proptest::array::uniform3(proptest::array::uniform3(-3.0f64..3.0)), tau in 0.05f64..1.0
        ) {
            let corners = corners.map(DVec3::from);
            prop_assert_eq!(triangle_lattice(corners, tau).collect::<Vec<_>>(), as_stated(corners, tau));
        }
    }

    #[test]
    fn a_unit_square_holds_one_point_per_cell_and_a_line_only_its_ends() {
        let mesh = TriMesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 3], [2, 3, 1], [0, 1, 1]],
            ..TriMesh::default()
        };
        let points = sample_mesh(&mesh, 0.05);
        // Two triangles of 20 x 20 / 2 cells each, less the cells whose centre is on the diagonal.
        assert_eq!(points.len(), 4 + 2 * 190);
        assert!(points.iter().all(|p| p[2] == 0.0 && (0.0..=1.0).contains(&p[0]) && (0.0..=1.0).contains(&p[1])));
        assert_eq!(points[..4], mesh.positions[..]);
    }

    #[test]
    fn far_triangles_are_their_vertices_and_near_ones_are_sampled() {
        let triangle = |z: f32, side: f32| [[0.0, 0.0, z], [side, 0.0, z], [0.0, side, z]];
        let mesh = |triangles: &[[[f32; 3]; 3]]| TriMesh {
            positions: triangles.concat(),
            triangles: (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
            ..TriMesh::default()
        };
        let (near, far) = (triangle(1.0, 1.0), triangle(1e6, 1e6));
        let reference = [[0.0, 0.0, 0.0], [0.5, 0.5, 0.9]];
        let alone = sample_mesh(&mesh(&[near]), 0.1);
        let both = sample_mesh_near(&mesh(&[near, far]), 0.1, &reference, 0.2);
        assert!(alone.len() > 40 && both.len() == alone.len() + 3 && both.starts_with(&alone));
        assert!(sample_mesh_near(&mesh(&[near]), 0.1, &reference, 0.05).len() == 3);
    }
}
