//! `mesh.ply`: the mesh MeshLab, CloudCompare and Open3D open, binary little endian.
//!
//! Positions are floats in the scene frame, doubles where floats would lose detail
//! ([`PlacedMesh::needs_double`]); normals and sRGB colours are written when the mesh has them.

use super::PlacedMesh;
use super::ply_header::PlyHeader;
use std::io::{self, Write};

/// Writes a mesh; `comments` go to the header (state the frame and the unit).
///
/// # Errors
/// When the mesh is inconsistent or `out` refuses.
pub fn write_ply_mesh(out: &mut impl Write, placed: &PlacedMesh, comments: &[&str]) -> io::Result<()> {
    placed.check()?;
    let mesh = placed.mesh;
    let double = placed.needs_double();
    let mut header = PlyHeader::new(comments)
        .element("vertex", mesh.positions.len())
        .properties(if double { "double" } else { "float" }, ["x", "y", "z"]);
    if !mesh.normals.is_empty() {
        header = header.properties("float", ["nx", "ny", "nz"]);
    }
    if !mesh.colours.is_empty() {
        header = header.properties("uchar", ["red", "green", "blue"]);
    }
    header.element("face", mesh.triangles.len()).properties("list uchar int", ["vertex_indices"]).write(out)?;

    let mut normals = placed.normals();
    let mut colours = mesh.colours.iter();
    let mut vertex = Vec::with_capacity(39);
    for position in placed.positions() {
        vertex.clear();
        for x in position.to_array() {
            if double {
                vertex.extend_from_slice(&x.to_le_bytes());
            } else {
                vertex.extend_from_slice(&(x as f32).to_le_bytes());
            }
        }
        for n in normals.next().iter().flat_map(|n| n.to_array()) {
            vertex.extend_from_slice(&n.to_le_bytes());
        }
        vertex.extend(colours.next().into_iter().flatten());
        out.write_all(&vertex)?;
    }
    for triangle in &mesh.triangles {
        let mut face = [3u8; 13];
        for (bytes, v) in face[1..].chunks_exact_mut(4).zip(triangle) {
            bytes.copy_from_slice(&v.to_le_bytes());
        }
        out.write_all(&face)?;
    }
    Ok(())
}
