//! Reader of meshes and point clouds in PLY files (binary little-endian or ASCII); `write::ply_mesh` is its writer.
//!
//! Takes what scanners, MeshLab and Open3D write: positions, and normals and faces where there are any; polygons
//! become fans. Invariant: any input ends in a consistent [`TriMesh`] or an error, never in a panic or in memory
//! the file did not fill.

use std::path::{Path, PathBuf};
use surfel_core::TriMesh;

/// Why a PLY file cannot be used, with its name.
#[derive(Debug, thiserror::Error)]
pub enum PlyFileError {
    /// The file could not be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Its content is no PLY we read.
    #[error("{}: {source}", path.display())]
    Ply {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: PlyError,
    },
}

/// Why a PLY file cannot be read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlyError {
    /// The first line is not `ply`, or there is no `end_header`.
    #[error("this is not a PLY file")]
    NotPly,
    /// The body has a layout we do not read.
    #[error("the PLY is `{0}`; save it as binary_little_endian or ascii")]
    Format(String),
    /// A header line does not parse.
    #[error("cannot make sense of the PLY header line `{0}`")]
    Header(String),
    /// Vertices without positions.
    #[error("the PLY has no vertex positions x, y, z")]
    NoPositions,
    /// The body is shorter than the header announces.
    #[error("the PLY ends after {found} of {announced} rows of `{element}`; it looks cut off")]
    Truncated {
        /// Element being read.
        element: String,
        /// Rows that were there.
        found: usize,
        /// Rows the header announces.
        announced: usize,
    },
    /// A face names a vertex that does not exist.
    #[error("face {face} of the PLY names vertex {vertex}, but there are only {num_vertices}")]
    VertexOutOfRange {
        /// Index of the face.
        face: usize,
        /// Vertex it names.
        vertex: f64,
        /// Number of vertices.
        num_vertices: usize,
    },
}

/// Reads a mesh file, or a point cloud as a mesh without triangles.
///
/// # Errors
/// [`PlyFileError`], naming the file.
pub fn read_ply_file(path: &Path) -> Result<TriMesh, PlyFileError> {
    let bytes = std::fs::read(path).map_err(|source| PlyFileError::Read { path: path.to_owned(), source })?;
    read_ply(&bytes).map_err(|source| PlyFileError::Ply { path: path.to_owned(), source })
}

/// Reads a mesh, or a point cloud as a mesh without triangles.
///
/// # Errors
/// [`PlyError`] when the bytes are no such PLY, or a damaged one.
pub fn read_ply(bytes: &[u8]) -> Result<TriMesh, PlyError> {
    let (header, body) = Header::parse(bytes)?;
    let mut rows: Box<dyn Rows> = if header.ascii {
        Box::new(AsciiRows(body.split(u8::is_ascii_whitespace)))
    } else {
        Box::new(BinaryRows(body))
    };
    let mut mesh = TriMesh::default();
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => read_vertices(element, rows.as_mut(), &mut mesh)?,
            "face" => read_faces(element, rows.as_mut(), &mut mesh)?,
            _ => element.for_each_row(rows.as_mut(), |_, _| Ok(()))?,
        }
    }
    Ok(mesh)
}

fn read_vertices(element: &Element, rows: &mut dyn Rows, mesh: &mut TriMesh) -> Result<(), PlyError> {
    let find = |names: [&str; 3]| -> Option<[usize; 3]> {
        let at = names.map(|name| element.properties.iter().position(|p| p.name == name && p.count.is_none()));
        Some([at[0]?, at[1]?, at[2]?])
    };
    let position = find(["x", "y", "z"]).ok_or(PlyError::NoPositions)?;
    let normal = find(["nx", "ny", "nz"]);
    element.for_each_row(rows, |_, values| {
        mesh.positions.push(position.map(|i| values[i][0] as f32));
        if let Some(normal) = normal {
            mesh.normals.push(normal.map(|i| values[i][0] as f32));
        }
        Ok(())
    })
}

fn read_faces(element: &Element, rows: &mut dyn Rows, mesh: &mut TriMesh) -> Result<(), PlyError> {
    let lists = ["vertex_indices", "vertex_index"];
    let Some(list) = element.properties.iter().position(|p| lists.contains(&p.name.as_str())) else {
        return element.for_each_row(rows, |_, _| Ok(()));
    };
    let num_vertices = mesh.positions.len();
    element.for_each_row(rows, |face, values| {
        let corners = &values[list];
        if let Some(&vertex) = corners.iter().find(|&&v| !(v >= 0.0 && v < num_vertices as f64)) {
            return Err(PlyError::VertexOutOfRange { face, vertex, num_vertices });
        }
        let corner = |i: usize| corners[i] as u32;
        mesh.triangles.extend((2..corners.len()).map(|i| [corner(0), corner(i - 1), corner(i)]));
        Ok(())
    })
}

#[derive(Clone, Copy)]
struct Scalar {
    kind: u8,
    size: usize,
}

impl Scalar {
    fn named(name: &str) -> Option<Self> {
        let (kind, size) = match name {
            "char" | "int8" => (b'i', 1),
            "short" | "int16" => (b'i', 2),
            "int" | "int32" => (b'i', 4),
            "uchar" | "uint8" => (b'u', 1),
            "ushort" | "uint16" => (b'u', 2),
            "uint" | "uint32" => (b'u', 4),
            "float" | "float32" => (b'f', 4),
            "double" | "float64" => (b'f', 8),
            _ => return None,
        };
        Some(Self { kind, size })
    }

    /// The value in the first `size` bytes.
    fn value(self, bytes: &[u8]) -> f64 {
        let mut word = [0u8; 8];
        word[..self.size].copy_from_slice(&bytes[..self.size]);
        let raw = u64::from_le_bytes(word);
        let unused = 64 - 8 * self.size as u32;
        match (self.kind, self.size) {
            (b'f', 4) => f64::from(f32::from_bits(raw as u32)),
            (b'f', _) => f64::from_bits(raw),
            (b'i', _) => ((raw << unused) as i64 >> unused) as f64,
            _ => raw as f64,
        }
    }
}

struct Property {
    name: String,
    kind: Scalar,
    /// Type of the length that goes before a list.
    count: Option<Scalar>,
}

struct Element {
    name: String,
    num_rows: usize,
    properties: Vec<Property>,
}

impl Element {
    /// Calls `visit(row, values per property)`; a scalar property has one value, a list any number.
    fn for_each_row(
        &self,
        rows: &mut dyn Rows,
        mut visit: impl FnMut(usize, &[Vec<f64>]) -> Result<(), PlyError>,
    ) -> Result<(), PlyError> {
        let mut values = vec![Vec::new(); self.properties.len()];
        // Rows without properties take no bytes, so no end of the file would ever stop the loop.
        let num_rows = if self.properties.is_empty() { 0 } else { self.num_rows };
        for row in 0..num_rows {
            let complete = self.properties.iter().zip(&mut values).all(|(property, values)| {
                values.clear();
                let length = property.count.map_or(Some(1.0), |count| rows.next(count));
                length.is_some_and(|length| {
                    (0..length as usize).all(|_| rows.next(property.kind).map(|v| values.push(v)).is_some())
                })
            });
            if !complete {
                return Err(PlyError::Truncated { element: self.name.clone(), found: row, announced: self.num_rows });
            }
            visit(row, &values)?;
        }
        Ok(())
    }
}

/// A stream of numbers.
trait Rows {
    fn next(&mut self, kind: Scalar) -> Option<f64>;
}

struct BinaryRows<'a>(&'a [u8]);

impl Rows for BinaryRows<'_> {
    fn next(&mut self, kind: Scalar) -> Option<f64> {
        let (head, rest) = self.0.split_at_checked(kind.size)?;
        self.0 = rest;
        Some(kind.value(head))
    }
}

struct AsciiRows<I>(I);

impl<'a, I: Iterator<Item = &'a [u8]>> Rows for AsciiRows<I> {
    fn next(&mut self, _: Scalar) -> Option<f64> {
        let word = self.0.find(|word| !word.is_empty())?;
        std::str::from_utf8(word).ok()?.parse().ok()
    }
}

struct Header {
    ascii: bool,
    elements: Vec<Element>,
}

impl Header {
    /// The header and the bytes after it.
    fn parse(bytes: &[u8]) -> Result<(Self, &[u8]), PlyError> {
        let mut header = Self { ascii: false, elements: Vec::new() };
        let mut rest = bytes.strip_prefix(b"ply").ok_or(PlyError::NotPly)?;
        loop {
            let end = rest.iter().position(|&b| b == b'\n').ok_or(PlyError::NotPly)?;
            let line = String::from_utf8_lossy(&rest[..end]).trim().to_owned();
            rest = &rest[end + 1..];
            let words: Vec<&str> = line.split_whitespace().collect();
            match words[..] {
                ["end_header"] => return Ok((header, rest)),
                ["format", "ascii", _] => header.ascii = true,
                ["format", "binary_little_endian", _] => {}
                ["format", other, ..] => return Err(PlyError::Format(other.to_owned())),
                ["element", name, count] => {
                    let num_rows = count.parse().map_err(|_| PlyError::Header(line.clone()))?;
                    header.elements.push(Element { name: name.to_owned(), num_rows, properties: Vec::new() });
                }
                ["property", ref kind @ .., name] => {
                    let property = match *kind {
                        [kind] => Scalar::named(kind).map(|kind| (kind, None)),
                        ["list", count, kind] => Scalar::named(kind).zip(Scalar::named(count).map(Some)),
                        _ => None,
                    };
                    let element = header.elements.last_mut();
                    let ((kind, count), element) = property.zip(element).ok_or(PlyError::Header(line.clone()))?;
                    element.properties.push(Property { name: name.to_owned(), kind, count });
                }
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ASCII: &[u8] =
        b"ply\nformat ascii 1.0\ncomment from a scanner\nelement vertex 4\nproperty float x\nproperty float y\n\
        property double z\nproperty uchar red\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 255\n1 0 0 0\n1 1 0.5 0\n0 1 0 7\n3 0 1 2\n4 0 1 2 3\n";

    fn binary() -> Vec<u8> {
        let mut bytes =
            b"ply\r\nformat binary_little_endian 1.0\r\nelement vertex 3\r\nproperty float x\r\nproperty float y\r\n\
            property float z\r\nproperty float nx\r\nproperty float ny\r\nproperty float nz\r\nproperty uchar red\r\n\
            element face 1\r\nproperty uchar flags\r\nproperty list uchar uint vertex_index\r\nend_header\r\n"
                .to_vec();
        for v in 0..3u8 {
            [f32::from(v), 2.0, -1.5, 0.0, 0.0, 1.0].iter().for_each(|c| bytes.extend(c.to_le_bytes()));
            bytes.push(v);
        }
        bytes.extend([9, 3]);
        [2u32, 1, 0].iter().for_each(|i| bytes.extend(i.to_le_bytes()));
        bytes
    }

    #[test]
    fn reads_both_bodies_and_fans_polygons() {
        let mesh = read_ply(ASCII).unwrap();
        assert_eq!(mesh.positions[2], [1.0, 1.0, 0.5]);
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 1, 2], [0, 2, 3]]);
        let mesh = read_ply(&binary()).unwrap();
        assert_eq!(mesh.positions, [[0.0, 2.0, -1.5], [1.0, 2.0, -1.5], [2.0, 2.0, -1.5]]);
        assert_eq!((mesh.normals[1], mesh.triangles), ([0.0, 0.0, 1.0], vec![[2, 1, 0]]));
    }

    #[test]
    fn says_what_is_wrong() {
        assert_eq!(read_ply(b"solid cube").unwrap_err(), PlyError::NotPly);
        let big = b"ply\nformat binary_big_endian 1.0\nend_header\n";
        assert_eq!(read_ply(big).unwrap_err(), PlyError::Format("binary_big_endian".into()));
        let huge = b"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n";
        assert_eq!(
            read_ply(huge).unwrap_err(),
            PlyError::Truncated { element: "vertex".into(), found: 1, announced: 99_999_999_999 }
        );
        let mut wrong = binary();
        let last = wrong.len() - 4;
        wrong[last] = 3;
        assert!(matches!(read_ply(&wrong), Err(PlyError::VertexOutOfRange { face: 0, .. })));
    }

    proptest! {
        #[test]
        fn damaged_bytes_never_panic(at in 0usize..500, value in any::<u8>(), cut in 0usize..500) {
            for source in [ASCII.to_vec(), binary()] {
                let mut bytes = source;
                if let Some(byte) = bytes.get_mut(at) {
                    *byte = value;
                }
                bytes.truncate(cut.max(3));
                let _ = read_ply(&bytes);
            }
        }
    }
}
