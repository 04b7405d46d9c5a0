//! The threshold semantics of spec 6.2 step 4.

use surfel_core::TriMesh;
use surfel_mesh::filter_components;

/// Strips of the given numbers of triangles, interleaved so that components are not contiguous.
fn strips(sizes: &[usize]) -> TriMesh {
    let mut mesh = TriMesh::default();
    let mut first = Vec::new();
    for (strip, size) in sizes.iter().enumerate() {
        first.push(mesh.positions.len() as u32);
        for step in 0..size + 2 {
            mesh.positions.push([(step / 2) as f32, (step % 2) as f32, strip as f32]);
            mesh.normals.push([0.0, 0.0, 1.0]);
            mesh.colours.push([strip as u8; 3]);
        }
    }
    for step in 0..sizes.iter().copied().max().unwrap_or(0) as u32 {
        for (strip, _) in sizes.iter().enumerate().filter(|(_, size)| step < **size as u32) {
            mesh.triangles.push([0, 1, 2].map(|corner| first[strip] + step + corner));
        }
    }
    mesh
}

fn kept_strips(sizes: &[usize], keep: usize, min_triangles: usize) -> Vec<u8> {
    let mesh = strips(sizes);
    let (kept, report) = filter_components(&mesh, keep, min_triangles);
    assert_eq!(report.num_components, sizes.len());
    assert_eq!(report.removed_triangles + kept.triangles.len(), mesh.triangles.len());
    assert_eq!(report.removed_vertices + kept.positions.len(), mesh.positions.len());
    for triangle in &kept.triangles {
        let [a, b, c] = triangle.map(|vertex| kept.colours[vertex as usize]);
        assert!(a == b && b == c, "a triangle lost its vertices");
        assert_eq!(kept.positions[triangle[0] as usize][2], f32::from(a[0]));
    }
    let mut strips: Vec<u8> = kept.colours.iter().map(|colour| colour[0]).collect();
    strips.dedup();
    assert_eq!(strips.len(), report.num_kept);
    strips
}

#[test]
fn the_largest_are_kept() {
    assert_eq!(kept_strips(&[60, 200, 90, 51], 1, 50), [1]);
    assert_eq!(kept_strips(&[60, 200, 90, 51], 2, 50), [1, 2]);
}

#[test]
fn the_minimum_wins_over_the_rank() {
    assert_eq!(kept_strips(&[60, 200, 20, 49, 50], 50, 50), [0, 1, 4]);
    assert_eq!(kept_strips(&[10, 20], 1, 50), [] as [u8; 0]);
}

#[test]
fn ties_with_the_last_kept_are_kept() {
    assert_eq!(kept_strips(&[80, 80, 80, 70], 2, 50), [0, 1, 2]);
}

#[test]
fn fewer_components_than_asked_for_are_fine() {
    assert_eq!(kept_strips(&[80, 60], 1000, 0), [0, 1]);
    assert_eq!(kept_strips(&[], 1, 50), [] as [u8; 0]);
    assert_eq!(kept_strips(&[80], 0, 0), [] as [u8; 0]);
}

#[test]
fn vertices_without_triangles_go() {
    let mut mesh = strips(&[5]);
    mesh.positions.push([9.0; 3]);
    mesh.normals.push([0.0, 0.0, 1.0]);
    mesh.colours.push([9; 3]);
    let (kept, report) = filter_components(&mesh, 1, 1);
    assert_eq!((kept.positions.len(), report.removed_vertices, report.num_components), (7, 1, 1));
}
