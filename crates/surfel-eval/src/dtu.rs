//! The official DTU score of a mesh: Chamfer distance against the structured-light scan (spec 7.1).
//!
//! Mesh → points 0.2 mm apart → those in the observed volume against the scan (d2s, accuracy), and the scan above the
//! table against the points (s2d, completeness). Everything in millimetres of the scanner's frame. Invariant: the
//! result depends on the mesh and the reference only, never on the number of threads or on the order of faces' points.

use crate::chamfer::{Beyond, mean_distance};
use crate::nearest::Nearest;
use crate::sample_mesh::sample_mesh;
use crate::thin::{selected, thin};
use rayon::prelude::*;
use serde::Serialize;
use surfel_core::TriMesh;

/// What a scan is compared with.
#[derive(Clone, Debug)]
pub struct DtuReference {
    /// Points of the structured-light scan, mm.
    pub surface: Vec<[f32; 3]>,
    /// Where the scanner could see.
    pub observed: ObservedVolume,
    /// Plane `[a, b, c, d]` of the table: points with `a x + b y + c z + d > 0` are above it.
    pub ground_plane: [f64; 4],
}

/// Voxels the scanner observed.
#[derive(Clone, Debug)]
pub struct ObservedVolume {
    /// Lower corner of the bounding box (centre of voxel 0), mm.
    pub low: [f32; 3],
    /// Upper corner of the bounding box, mm.
    pub high: [f32; 3],
    /// Edge of a voxel, mm.
    pub voxel: f64,
    /// Voxels along x, y, z.
    pub dims: [usize; 3],
    /// Non-zero where observed; x fastest, `dims` product long.
    pub seen: Vec<u8>,
}

/// Constants of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DtuSettings {
    /// Spacing of the points, mm.
    pub spacing: f64,
    /// Distances from here on are discarded, mm.
    pub limit: f64,
    /// Points count within this of the bounding box below, and twice this above, mm.
    pub margin: f32,
    /// Seed of the shuffle that goes before thinning.
    pub seed: u64,
}

impl Default for DtuSettings {
    fn default() -> Self {
        Self { spacing: 0.2, limit: 20.0, margin: 60.0, seed: 0 }
    }
}

/// The score, mm. The paper's table 1 is to be compared with `overall`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DtuScore {
    /// Accuracy, data to scan ("d2s").
    pub d2s: f64,
    /// Completeness, scan to data ("s2d").
    pub s2d: f64,
    /// Mean of the two.
    pub overall: f64,
    /// Points of the thinned mesh that accuracy was asked of.
    pub num_data_points: usize,
    /// Points of the scan that completeness was asked of.
    pub num_surface_points: usize,
}

/// Scores a (culled) mesh in the scanner's frame, mm.
pub fn score_dtu(mesh: &TriMesh, reference: &DtuReference, settings: &DtuSettings) -> DtuScore {
    let sampled = sample_mesh(mesh, settings.spacing);
    let data = selected(&sampled, &thin(&sampled, settings.spacing, settings.seed));
    score_dtu_points(&data, reference, settings)
}

/// Scores points that are already sampled and thinned.
pub fn score_dtu_points(data: &[[f32; 3]], reference: &DtuReference, settings: &DtuSettings) -> DtuScore {
    let observed = &reference.observed;
    let near: Vec<[f32; 3]> = data.par_iter().copied().filter(|p| observed.is_near(*p, settings.margin)).collect();
    let seen: Vec<[f32; 3]> = near.par_iter().copied().filter(|p| observed.contains(*p)).collect();
    let above = |p: &[f32; 3]| {
        let [a, b, c, d] = reference.ground_plane;
        a * f64::from(p[0]) + b * f64::from(p[1]) + c * f64::from(p[2]) + d > 0.0
    };
    let surface: Vec<[f32; 3]> = reference.surface.par_iter().copied().filter(above).collect();
    let limit = settings.limit;
    let d2s = mean_distance(&Nearest::new(&reference.surface).distances(&seen, limit), limit, Beyond::Discard);
    let s2d = mean_distance(&Nearest::new(&near).distances(&surface, limit), limit, Beyond::Discard);
    DtuScore { d2s, s2d, overall: (d2s + s2d) / 2.0, num_data_points: seen.len(), num_surface_points: surface.len() }
}

/// Scores a mesh against reference points alone, without an observed volume or a table plane (mm).
///
/// The same sampling, thinning and limit as the protocol, for references that are not the official ones.
pub fn score_against_points(mesh: &TriMesh, reference: &[[f32; 3]], settings: &DtuSettings) -> DtuScore {
    let sampled = sample_mesh(mesh, settings.spacing);
    let data = selected(&sampled, &thin(&sampled, settings.spacing, settings.seed));
    let limit = settings.limit;
    let d2s = mean_distance(&Nearest::new(reference).distances(&data, limit), limit, Beyond::Discard);
    let s2d = mean_distance(&Nearest::new(&data).distances(reference, limit), limit, Beyond::Discard);
    DtuScore { d2s, s2d, overall: (d2s + s2d) / 2.0, num_data_points: data.len(), num_surface_points: reference.len() }
}

impl ObservedVolume {
    /// Within `margin` below and `2 margin` above the bounding box.
    fn is_near(&self, point: [f32; 3], margin: f32) -> bool {
        (0..3).all(|i| point[i] >= self.low[i] - margin && point[i] < self.high[i] + 2.0 * margin)
    }

    /// In an observed voxel.
    fn contains(&self, point: [f32; 3]) -> bool {
        let voxel: [f64; 3] =
            std::array::from_fn(|i| ((f64::from(point[i]) - f64::from(self.low[i])) / self.voxel).round_ties_even());
        let inside = (0..3).all(|i| voxel[i] >= 0.0 && voxel[i] < self.dims[i] as f64);
        inside && {
            let [x, y, z] = voxel.map(|v| v as usize);
            self.seen[x + self.dims[0] * (y + self.dims[1] * z)] != 0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two-triangle square of side 40 mm at height `z`.
    fn square(z: f32) -> TriMesh {
        TriMesh {
            positions: vec![[0.0, 0.0, z], [40.0, 0.0, z], [40.0, 40.0, z], [0.0, 40.0, z]],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..TriMesh::default()
        }
    }

    fn reference() -> DtuReference {
        // The scan: the same square at z = 5, 0.2 mm apart. Only x < 20 is observed; the table is at y = 10.
        let surface = (0..200).flat_map(|x| (0..200).map(move |y| [x as f32 * 0.2, y as f32 * 0.2, 5.0])).collect();
        let dims = [21, 41, 11];
        let seen = vec![1; dims.iter().product()];
        let observed = ObservedVolume { low: [0.0; 3], high: [20.0, 40.0, 10.0], voxel: 1.0, dims, seen };
        DtuReference { surface, observed, ground_plane: [0.0, 1.0, 0.0, -10.0] }
    }

    #[test]
    fn a_surface_one_millimetre_off_scores_one_millimetre() {
        let settings = DtuSettings::default();
        let score = score_dtu(&square(6.0), &reference(), &settings);
        // 0.2 mm spacing adds sqrt(1 + d²) - 1 < 0.02 mm.
        assert!(score.d2s > 1.0 && score.d2s < 1.01, "{score:?}");
        assert!(score.s2d > 1.0 && score.s2d < 1.02, "{score:?}");
        assert!((score.overall - (score.d2s + score.s2d) / 2.0).abs() < 1e-12);
        // Half of the square is observed, three quarters of the scan are above the table.
        let per_square_mm = 40.0 * score.num_data_points as f64 / (20.5 * 40.0);
        assert!(per_square_mm > 400.0 && per_square_mm < 1100.0, "{per_square_mm} points per mm");
        assert_eq!(score.num_surface_points, 200 * 149);
        assert_eq!(score, score_dtu(&square(6.0), &reference(), &settings), "same result twice");
    }

    #[test]
    fn concentric_spheres_score_the_difference_of_their_radii() {
        // A sphere of triangles much finer than the difference, against points on a larger one.
        let vertex = |radius: f64, i: u32, j: u32| {
            let (a, b) = (f64::from(i) / 120.0 * std::f64::consts::TAU, f64::from(j) / 60.0 * std::f64::consts::PI);
            [radius * b.sin() * a.cos(), radius * b.sin() * a.sin(), radius * b.cos()].map(|c| c as f32)
        };
        let mut mesh = TriMesh::default();
        for j in 0..=60 {
            mesh.positions.extend((0..120).map(|i| vertex(20.0, i, j)));
        }
        let at = |i: u32, j: u32| j * 120 + i % 120;
        for j in 0..60 {
            for i in 0..120 {
                mesh.triangles
                    .extend([[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]);
            }
        }
        let golden = |n: u32| {
            let z = 1.0 - (2.0 * f64::from(n) + 1.0) / 200_000.0;
            let (r, a) = ((1.0 - z * z).sqrt(), 2.399_963_229_728_653 * f64::from(n));
            [21.0 * r * a.cos(), 21.0 * r * a.sin(), 21.0 * z].map(|c| c as f32)
        };
        let points: Vec<[f32; 3]> = (0..200_000).map(golden).collect();
        let score = score_against_points(&mesh, &points, &DtuSettings::default());
        // Facets lie up to 0.03 mm inside the sphere, points are 0.2 mm apart.
        assert!((score.d2s - 1.0).abs() < 0.03 && (score.s2d - 1.0).abs() < 0.03, "{score:?}");
        assert_eq!(score.num_surface_points, 200_000);
    }

    #[test]
    fn far_surfaces_are_discarded_and_an_unobserved_one_costs_no_accuracy() {
        let mut mesh = square(6.0);
        let stray = TriMesh {
            positions: square(6.0).positions.iter().map(|p| [p[0] + 25.0, p[1], 9.0]).collect(),
            ..square(6.0)
        };
        mesh.triangles.extend(stray.triangles.iter().map(|t| t.map(|v| v + 4)));
        mesh.positions.extend(stray.positions);
        let (plain, with_stray) =
            [square(6.0), mesh].map(|m| score_dtu(&m, &reference(), &DtuSettings::default())).into();
        assert!((with_stray.d2s - plain.d2s).abs() < 1e-3);
        let far = score_dtu(&square(30.0), &reference(), &DtuSettings::default());
        assert!(far.d2s.is_nan() && far.s2d.is_nan());
    }
}
