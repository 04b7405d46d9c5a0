//! Taking faces away from a mesh.
//!
//! Invariant: what remains keeps its order, and vertices without a face disappear.

use surfel_core::TriMesh;

/// The mesh of the faces for which `keep(face index)` holds.
pub fn keep_faces(mesh: &TriMesh, keep: impl Fn(usize) -> bool) -> TriMesh {
    const UNUSED: u32 = u32::MAX;
    let triangles: Vec<[u32; 3]> = (0..mesh.triangles.len()).filter(|&f| keep(f)).map(|f| mesh.triangles[f]).collect();
    let mut new_index = vec![UNUSED; mesh.positions.len()];
    triangles.iter().flatten().for_each(|&v| new_index[v as usize] = 0);
    let kept: Vec<usize> = (0..new_index.len()).filter(|&v| new_index[v] != UNUSED).collect();
    for (index, &vertex) in kept.iter().enumerate() {
        new_index[vertex] = index as u32;
    }
    fn gather<T: Copy>(values: &[T], kept: &[usize]) -> Vec<T> {
        if values.is_empty() { Vec::new() } else { kept.iter().map(|&v| values[v]).collect() }
    }
    TriMesh {
        positions: gather(&mesh.positions, &kept),
        normals: gather(&mesh.normals, &kept),
        colours: gather(&mesh.colours, &kept),
        triangles: triangles.into_iter().map(|t| t.map(|v| new_index[v as usize])).collect(),
    }
}

/// The mesh without connected components (by shared vertices) of fewer than `min_faces` faces.
pub fn without_small_components(mesh: &TriMesh, min_faces: usize) -> TriMesh {
    let mut parent: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    for &[a, b, c] in &mesh.triangles {
        let root = root_of(&mut parent, a);
        for vertex in [b, c] {
            let other = root_of(&mut parent, vertex);
            parent[other as usize] = root;
        }
    }
    let mut num_faces = vec![0usize; parent.len()];
    let roots: Vec<u32> = mesh.triangles.iter().map(|t| root_of(&mut parent, t[0])).collect();
    roots.iter().for_each(|&root| num_faces[root as usize] += 1);
    keep_faces(mesh, |face| num_faces[roots[face] as usize] >= min_faces)
}

fn root_of(parent: &mut [u32], mut vertex: u32) -> u32 {
    while parent[vertex as usize] != vertex {
        // Halving the path keeps the trees flat.
        parent[vertex as usize] = parent[parent[vertex as usize] as usize];
        vertex = parent[vertex as usize];
    }
    vertex
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_follow_their_faces_and_small_parts_go() {
        let mesh = TriMesh {
            positions: (0..8).map(|i| [i as f32, 0.0, 0.0]).collect(),
            colours: (0..8).map(|i| [i, 0, 0]).collect(),
            normals: Vec::new(),
            triangles: vec![[4, 5, 6], [1, 2, 0], [2, 3, 1]],
        };
        let kept = keep_faces(&mesh, |f| f == 2);
        assert_eq!((kept.positions.len(), kept.triangles[0]), (3, [1, 2, 0]));
        assert_eq!(kept.colours, [[1, 0, 0], [2, 0, 0], [3, 0, 0]]);
        let large = without_small_components(&mesh, 2);
        assert_eq!((large.positions.len(), large.triangles.len()), (4, 2));
        assert_eq!(without_small_components(&mesh, 3).triangles.len(), 0);
    }
}
