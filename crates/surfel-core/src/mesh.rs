//! Triangle meshes with per-vertex normals and colours.
//!
//! Invariant: `normals` and `colours` are empty or as long as `positions`; triangle indices are in range
//! and counter-clockwise seen from outside (from the cameras).

/// An indexed triangle mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    /// Vertex positions; frame and unit are the producer's to state (scene frame at export).
    pub positions: Vec<[f32; 3]>,
    /// Unit vertex normals, outward, or empty.
    pub normals: Vec<[f32; 3]>,
    /// sRGB vertex colours, or empty.
    pub colours: Vec<[u8; 3]>,
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// Corner positions of triangle `index`.
    pub fn corners(&self, index: usize) -> [[f32; 3]; 3] {
        self.triangles[index].map(|v| self.positions[v as usize])
    }

    /// Component-wise minimum and maximum of the positions; `None` for an empty mesh.
    pub fn bounds(&self) -> Option<([f32; 3], [f32; 3])> {
        let first = *self.positions.first()?;
        Some(self.positions.iter().fold((first, first), |(low, high), p| {
            (std::array::from_fn(|i| low[i].min(p[i])), std::array::from_fn(|i| high[i].max(p[i])))
        }))
    }
}
