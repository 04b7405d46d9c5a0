//! Reads surfels back from a splat PLY: ours, 2DGS (two scales) or 3DGS (three; the third is ignored).
//!
//! Invariant: no header, however wrong, makes it allocate more than the file delivers.

use glam::{DVec3, Vec4};
use std::io::{self, BufRead};
use surfel_core::Surfels;

/// Surfels and the point their centres are relative to (zero unless the header states an `origin`).
#[derive(Clone, Debug, PartialEq)]
pub struct SurfelFile {
    /// Scene frame, minus `origin`.
    pub surfels: Surfels,
    /// To be added to the centres, scene units.
    pub origin: DVec3,
}

/// Reads a binary little-endian PLY whose first element is `vertex`; unknown properties are skipped.
///
/// # Errors
/// [`io::ErrorKind::InvalidData`] with a sentence when the file is no such PLY or ends early.
pub fn read_surfels_ply(input: &mut impl BufRead) -> io::Result<SurfelFile> {
    let header = Header::read(input)?;
    let columns = Columns::find(&header.properties)?;
    let mut surfels = Surfels { sh_degree: columns.sh_degree, ..Surfels::default() };
    let mut row = vec![0; header.properties.iter().map(|property| property.kind.size()).sum()];
    for k in 0..header.num_vertices {
        input.read_exact(&mut row).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => {
                invalid(format!("the file ends after {k} of {} surfels", header.num_vertices))
            }
            _ => error,
        })?;
        columns.append(&row, &mut surfels);
    }
    Ok(SurfelFile { surfels, origin: header.origin })
}

fn invalid(reason: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, reason.into())
}

#[derive(Clone, Copy)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The value at `offset` of a row, which is long enough.
    fn value(self, row: &[u8], offset: usize) -> f64 {
        fn bytes<const N: usize>(row: &[u8], offset: usize) -> [u8; N] {
            std::array::from_fn(|i| row[offset + i])
        }
        match self {
            Self::I8 => f64::from(row[offset] as i8),
            Self::U8 => f64::from(row[offset]),
            Self::I16 => f64::from(i16::from_le_bytes(bytes(row, offset))),
            Self::U16 => f64::from(u16::from_le_bytes(bytes(row, offset))),
            Self::I32 => f64::from(i32::from_le_bytes(bytes(row, offset))),
            Self::U32 => f64::from(u32::from_le_bytes(bytes(row, offset))),
            Self::F32 => f64::from(f32::from_le_bytes(bytes(row, offset))),
            Self::F64 => f64::from_le_bytes(bytes(row, offset)),
        }
    }
}

struct Property {
    name: String,
    kind: Scalar,
}

struct Header {
    num_vertices: u64,
    properties: Vec<Property>,
    origin: DVec3,
}

impl Header {
    /// Longest header line accepted; the longest real one is a comment.
    const MAX_LINE: u64 = 4096;

    fn read(input: &mut impl BufRead) -> io::Result<Self> {
        let mut header = Self { num_vertices: 0, properties: Vec::new(), origin: DVec3::ZERO };
        let (mut num_elements, mut first) = (0, true);
        loop {
            let line = Self::line(input)?;
            let words: Vec<&str> = line.split_whitespace().collect();
            match words[..] {
                ["ply"] if first => {}
                _ if first => return Err(invalid("this is not a PLY file (its first line is not `ply`)")),
                ["end_header"] => break,
                ["format", "binary_little_endian", _] => {}
                ["format", other, ..] => {
                    return Err(invalid(format!("the PLY is {other}; save it as binary_little_endian")));
                }
                ["comment", "origin", x, y, z] => {
                    let number =
                        |word: &str| word.parse().map_err(|_| invalid(format!("`{line}` is not three numbers")));
                    header.origin = DVec3::new(number(x)?, number(y)?, number(z)?);
                }
                ["element", name, count] => {
                    num_elements += 1;
                    if num_elements == 1 {
                        let count = count.parse().ok().filter(|_| name == "vertex");
                        header.num_vertices =
                            count.ok_or_else(|| invalid(format!("expected `element vertex COUNT`, found `{line}`")))?;
                    }
                }
                ["property", kind, name] if num_elements == 1 => {
                    let kind = Scalar::named(kind).ok_or_else(|| invalid(format!("unknown type in `{line}`")))?;
                    header.properties.push(Property { name: name.to_owned(), kind });
                }
                ["property", "list", ..] if num_elements == 1 => {
                    return Err(invalid("a list among the vertex properties: not a splat file"));
                }
                _ => {}
            }
            first = false;
        }
        Ok(header)
    }

    fn line(input: &mut impl BufRead) -> io::Result<String> {
        let mut bytes = Vec::new();
        io::Read::take(&mut *input, Self::MAX_LINE).read_until(b'\n', &mut bytes)?;
        if bytes.last() != Some(&b'\n') {
            return Err(invalid("the PLY header has no end_header line"));
        }
        Ok(String::from_utf8_lossy(&bytes).trim_end().to_owned())
    }
}

/// Where each quantity lies in a row.
struct Columns {
    centre: [(Scalar, usize); 3],
    dc: [(Scalar, usize); 3],
    rest: Vec<(Scalar, usize)>,
    opacity: (Scalar, usize),
    scales: [(Scalar, usize); 2],
    rotation: [(Scalar, usize); 4],
    sh_degree: usize,
}

impl Columns {
    fn find(properties: &[Property]) -> io::Result<Self> {
        let mut offsets = std::collections::HashMap::new();
        let mut offset = 0;
        for property in properties {
            offsets.insert(property.name.as_str(), (property.kind, offset));
            offset += property.kind.size();
        }
        let column = |name: &str| {
            offsets
                .get(name)
                .copied()
                .ok_or_else(|| invalid(format!("the PLY has no property `{name}`: not a splat file")))
        };
        let num_rest = (0..).take_while(|i| offsets.contains_key(format!("f_rest_{i}").as_str())).count();
        let sh_degree = [0, 9, 24, 45].iter().position(|&n| n == num_rest).ok_or_else(|| {
            invalid(format!("{num_rest} f_rest properties, but whole SH degrees have 0, 9, 24 or 45"))
        })?;
        Ok(Self {
            centre: [column("x")?, column("y")?, column("z")?],
            dc: [column("f_dc_0")?, column("f_dc_1")?, column("f_dc_2")?],
            rest: (0..num_rest).map(|i| column(&format!("f_rest_{i}"))).collect::<io::Result<_>>()?,
            opacity: column("opacity")?,
            scales: [column("scale_0")?, column("scale_1")?],
            rotation: [column("rot_0")?, column("rot_1")?, column("rot_2")?, column("rot_3")?],
            sh_degree,
        })
    }

    fn append(&self, row: &[u8], surfels: &mut Surfels) {
        let value = |(kind, offset): (Scalar, usize)| kind.value(row, offset);
        surfels.centres.push(self.centre.map(|c| value(c) as f32));
        surfels.scales.push(self.scales.map(|c| value(c).exp() as f32));
        let rotation = Vec4::from_array(self.rotation.map(|c| value(c) as f32));
        surfels.rotations.push(rotation.normalize_or(Vec4::X).to_array());
        surfels.opacities.push((1.0 / (1.0 + (-value(self.opacity)).exp())) as f32);
        surfels.sh.push(self.dc.map(|c| value(c) as f32));
        let per_channel = self.rest.len() / 3;
        let coefficient = |n: usize| std::array::from_fn(|channel| value(self.rest[channel * per_channel + n]) as f32);
        surfels.sh.extend((0..per_channel).map(coefficient));
    }
}
