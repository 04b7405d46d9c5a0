//! `mesh.obj`: the mesh as text, with the colour after each vertex (`v x y z r g b`), which most but not
//! all readers understand. Positions carry all digits of a double.

use super::{GENERATOR, PlacedMesh};
use std::io::{self, Write};

/// Writes a mesh; `comments` go to the top (state the frame and the unit).
///
/// # Errors
/// When the mesh is inconsistent or `out` refuses.
pub fn write_obj(out: &mut impl Write, placed: &PlacedMesh, comments: &[&str]) -> io::Result<()> {
    placed.check()?;
    let mesh = placed.mesh;
    writeln!(out, "# {GENERATOR}")?;
    for line in comments.iter().flat_map(|comment| comment.lines()) {
        writeln!(out, "# {line}")?;
    }
    let mut colours = mesh.colours.iter();
    for p in placed.positions() {
        write!(out, "v {} {} {}", p.x, p.y, p.z)?;
        match colours.next().map(|c| c.map(|byte| f32::from(byte) / 255.0)) {
            Some([r, g, b]) => writeln!(out, " {r:.4} {g:.4} {b:.4}")?,
            None => writeln!(out)?,
        }
    }
    for n in placed.normals() {
        writeln!(out, "vn {:.5} {:.5} {:.5}", n.x, n.y, n.z)?;
    }
    for [a, b, c] in mesh.triangles.iter().map(|triangle| triangle.map(|v| v + 1)) {
        if mesh.normals.is_empty() {
            writeln!(out, "f {a} {b} {c}")?;
        } else {
            writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?;
        }
    }
    Ok(())
}
