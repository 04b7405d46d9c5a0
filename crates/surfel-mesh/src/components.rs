//! Connected components of a mesh, and dropping the small ones (spec 6.2 step 4).
//!
//! Triangles that share a vertex are connected; sizes are counted in triangles. Invariant: what is kept keeps
//! its order, and no vertex is left without a triangle.

use surfel_core::TriMesh;

/// What [`filter_components`] found and removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ComponentReport {
    /// Components before.
    pub num_components: usize,
    /// Components kept.
    pub num_kept: usize,
    /// Smallest size that was kept: `max(size of the keep-th largest, min_triangles)`.
    pub threshold: usize,
    /// Triangles removed.
    pub removed_triangles: usize,
    /// Vertices removed.
    pub removed_vertices: usize,
}

/// Keeps the `keep` largest components that have at least `min_triangles` triangles.
///
/// Components as large as the `keep`-th largest are all kept, as in the spec; with fewer than `keep`
/// components only `min_triangles` decides. `keep = 0` removes everything.
pub fn filter_components(mesh: &TriMesh, keep: usize, min_triangles: usize) -> (TriMesh, ComponentReport) {
    let component = component_of_vertices(mesh);
    let mut sizes = vec![0usize; mesh.positions.len()];
    for triangle in &mesh.triangles {
        sizes[component[triangle[0] as usize]] += 1;
    }
    let mut by_size: Vec<usize> = sizes.iter().copied().filter(|&size| size > 0).collect();
    by_size.sort_unstable_by(|a, b| b.cmp(a));
    let rank_size = match keep {
        0 => usize::MAX,
        _ => by_size.get(keep - 1).copied().unwrap_or(1),
    };
    let threshold = rank_size.max(min_triangles);
    let kept = with_vertices(mesh, |vertex| sizes[component[vertex]] >= threshold.max(1));
    let report = ComponentReport {
        num_components: by_size.len(),
        num_kept: by_size.iter().filter(|&&size| size >= threshold).count(),
        threshold,
        removed_triangles: mesh.triangles.len() - kept.triangles.len(),
        removed_vertices: mesh.positions.len() - kept.positions.len(),
    };
    (kept, report)
}

/// Representative vertex of each vertex's component.
fn component_of_vertices(mesh: &TriMesh) -> Vec<usize> {
    let mut parent: Vec<usize> = (0..mesh.positions.len()).collect();
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|vertex| vertex as usize);
        for (a, b) in [(a, b), (b, c)] {
            let (a, b) = (root(&mut parent, a), root(&mut parent, b));
            parent[a.max(b)] = a.min(b);
        }
    }
    (0..parent.len()).map(|vertex| root(&mut parent, vertex)).collect()
}

fn root(parent: &mut [usize], mut vertex: usize) -> usize {
    while parent[vertex] != vertex {
        parent[vertex] = parent[parent[vertex]];
        vertex = parent[vertex];
    }
    vertex
}

/// The part of a mesh on the chosen vertices; whole components only.
fn with_vertices(mesh: &TriMesh, chosen: impl Fn(usize) -> bool) -> TriMesh {
    let mut kept = TriMesh::default();
    let mut new_index = vec![None; mesh.positions.len()];
    for vertex in (0..mesh.positions.len()).filter(|&vertex| chosen(vertex)) {
        new_index[vertex] = Some(kept.positions.len() as u32);
        kept.positions.push(mesh.positions[vertex]);
        kept.normals.extend(mesh.normals.get(vertex));
        kept.colours.extend(mesh.colours.get(vertex));
    }
    kept.triangles = mesh
        .triangles
        .iter()
        .filter_map(|triangle| {
            let [a, b, c] = triangle.map(|vertex| new_index[vertex as usize]);
            Some([a?, b?, c?])
        })
        .collect();
    kept
}
