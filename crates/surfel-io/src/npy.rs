//! NumPy arrays: `.npy`, and `.npz` archives of them.
//!
//! Camera files, reference points and depth dumps come in these. Every element type is widened to `f64`
//! and every order turned to C order. Invariant: `data.len()` is the product of `shape`, and no more
//! memory is taken than the file really fills. (The parser is our own because the one at hand multiplies
//! shapes from the file unchecked.)

use std::fs::File;
use std::io::{Cursor, Read, Seek};
use std::path::{Path, PathBuf};

/// Arrays larger than this when unpacked are refused: 1 GiB.
const MAX_ARRAY_BYTES: u64 = 1 << 30;

/// An n-dimensional array in C order.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length along each axis; empty for a single number.
    pub shape: Vec<usize>,
    /// The elements, last axis fastest.
    pub data: Vec<f64>,
}

/// Why an array could not be read.
#[derive(Debug, thiserror::Error)]
pub enum NpyError {
    /// The file could not be opened or read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not what it should be.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

/// Reads a `.npy` file.
///
/// # Errors
/// [`NpyError`], naming the file.
pub fn read_npy(path: &Path) -> Result<Array, NpyError> {
    let bytes = std::fs::read(path).map_err(|source| NpyError::Read { path: path.to_owned(), source })?;
    Array::parse(&bytes).map_err(|reason| NpyError::Malformed { path: path.to_owned(), reason })
}

impl Array {
    /// From the bytes of a `.npy` file.
    ///
    /// # Errors
    /// A sentence without a subject, to follow the name of the file or array.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        let truncated = || "ends inside the header of the array".to_owned();
        if !bytes.starts_with(b"\x93NUMPY") {
            return Err("is not a NumPy array (the magic bytes are missing)".into());
        }
        let major = *bytes.get(6).ok_or_else(truncated)?;
        let (header_start, header_len): (usize, usize) = if major == 1 {
            let len = bytes.get(8..10).ok_or_else(truncated)?;
            (10, usize::from(u16::from_le_bytes([len[0], len[1]])))
        } else {
            let len = bytes.get(8..12).ok_or_else(truncated)?;
            (12, u32::from_le_bytes([len[0], len[1], len[2], len[3]]) as usize)
        };
        let header = bytes.get(header_start..header_start.saturating_add(header_len)).ok_or_else(truncated)?;
        let header = std::str::from_utf8(header).map_err(|_| "has a header that is not text".to_owned())?;
        let header = Header::parse(header)?;
        header.elements(&bytes[header_start + header_len..])
    }

    /// Row `index` of the first axis.
    pub fn row(&self, index: usize) -> &[f64] {
        let length: usize = self.shape.iter().skip(1).product();
        &self.data[index * length..][..length]
    }
}

struct Header {
    big_endian: bool,
    kind: char,
    size: usize,
    fortran_order: bool,
    shape: Vec<usize>,
}

impl Header {
    /// From the Python dict literal NumPy writes; only its three known keys are looked at.
    fn parse(text: &str) -> Result<Self, String> {
        let after = |key: &str| {
            let start = text.find(&format!("'{key}'")).map(|at| at + key.len() + 2);
            start
                .and_then(|at| text[at..].trim_start().strip_prefix(':'))
                .map(str::trim_start)
                .ok_or_else(|| format!("has no {key:?} in its header"))
        };
        let descr = after("descr")?;
        let descr = descr.strip_prefix('\'').and_then(|rest| rest.split('\'').next()).unwrap_or(descr);
        let mut chars = descr.chars();
        let (order, kind) = (chars.next().unwrap_or(' '), chars.next().unwrap_or(' '));
        let unknown = || format!("has elements of type {descr:?}; only plain numbers can be read");
        let size = chars.as_str().parse().map_err(|_| unknown())?;
        if !matches!(order, '<' | '>' | '|' | '=')
            || !matches!((kind, size), ('f', 4 | 8) | ('i' | 'u', 1 | 2 | 4 | 8) | ('b', 1))
        {
            return Err(unknown());
        }
        let shape = after("shape")?;
        let shape = shape.strip_prefix('(').and_then(|rest| rest.split_once(')')).map(|(inside, _)| inside);
        let shape = shape.ok_or("has a shape that cannot be read")?;
        let lengths = shape.split(',').map(str::trim).filter(|length| !length.is_empty());
        let shape = lengths.map(|length| length.trim_end_matches('L').parse::<usize>()).collect::<Result<_, _>>();
        Ok(Self {
            big_endian: order == '>',
            kind,
            size,
            fortran_order: after("fortran_order")?.starts_with("True"),
            shape: shape.map_err(|_| "has a shape that cannot be read".to_owned())?,
        })
    }

    fn elements(self, bytes: &[u8]) -> Result<Array, String> {
        let count = self.shape.iter().try_fold(1usize, |product, &length| product.checked_mul(length));
        let wanted = count.and_then(|count| count.checked_mul(self.size)).filter(|&wanted| wanted <= bytes.len());
        let (Some(count), Some(wanted)) = (count, wanted) else {
            return Err(format!("is cut short: shape {:?} does not fit in {} bytes", self.shape, bytes.len()));
        };
        let stored: Vec<f64> = bytes[..wanted].chunks_exact(self.size).map(|element| self.element(element)).collect();
        let data = if self.fortran_order && self.shape.len() > 1 { self.to_c_order(&stored, count) } else { stored };
        Ok(Array { shape: self.shape, data })
    }

    fn element(&self, bytes: &[u8]) -> f64 {
        let mut little = [0u8; 8];
        little[..self.size].copy_from_slice(bytes);
        if self.big_endian {
            little[..self.size].reverse();
        }
        let raw = u64::from_le_bytes(little);
        let unused_bits = 64 - 8 * self.size as u32;
        match (self.kind, self.size) {
            ('f', 4) => f64::from(f32::from_bits(raw as u32)),
            ('f', _) => f64::from_bits(raw),
            // Shifted up and down again to carry the sign.
            ('i', _) => ((raw << unused_bits) as i64 >> unused_bits) as f64,
            _ => raw as f64,
        }
    }

    fn to_c_order(&self, stored: &[f64], count: usize) -> Vec<f64> {
        let mut index = vec![0usize; self.shape.len()];
        let mut data = Vec::with_capacity(count);
        for _ in 0..count {
            let offset = index.iter().zip(&self.shape).rev().fold(0, |sum, (&i, &length)| sum * length + i);
            data.push(stored[offset]);
            for axis in (0..index.len()).rev() {
                index[axis] += 1;
                if index[axis] < self.shape[axis] {
                    break;
                }
                index[axis] = 0;
            }
        }
        data
    }
}

/// An open `.npz` archive.
pub struct Npz<R: Read + Seek> {
    archive: zip::ZipArchive<R>,
    path: PathBuf,
}

impl Npz<File> {
    /// Opens an archive; arrays are read when asked for.
    ///
    /// # Errors
    /// [`NpyError`] when the file is missing or not a zip archive.
    pub fn open(path: &Path) -> Result<Self, NpyError> {
        let file = File::open(path).map_err(|source| NpyError::Read { path: path.to_owned(), source })?;
        Self::new(file, path)
    }
}

impl<'a> Npz<Cursor<&'a [u8]>> {
    /// An archive in memory; `path` is for messages.
    ///
    /// # Errors
    /// [`NpyError`] when the bytes are no zip archive.
    pub fn from_bytes(bytes: &'a [u8], path: &Path) -> Result<Self, NpyError> {
        Self::new(Cursor::new(bytes), path)
    }
}

impl<R: Read + Seek> Npz<R> {
    fn new(reader: R, path: &Path) -> Result<Self, NpyError> {
        let archive = zip::ZipArchive::new(reader).map_err(|error| NpyError::Malformed {
            path: path.to_owned(),
            reason: format!("is not a complete .npz archive ({error})"),
        })?;
        Ok(Self { archive, path: path.to_owned() })
    }

    /// Names of the arrays, without `.npy`, sorted.
    pub fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = (0..self.archive.len())
            .filter_map(|index| self.archive.name_for_index(index))
            .filter_map(|name| name.ok()?.strip_suffix(".npy").map(str::to_owned))
            .collect();
        names.sort();
        names
    }

    /// Reads one array.
    ///
    /// # Errors
    /// [`NpyError`], naming the file and the array.
    pub fn array(&mut self, name: &str) -> Result<Array, NpyError> {
        self.read(name).map_err(|reason| NpyError::Malformed { path: self.path.clone(), reason })
    }

    fn read(&mut self, name: &str) -> Result<Array, String> {
        let mut entry = self
            .archive
            .by_name(&format!("{name}.npy"))
            .map_err(|error| format!("array {name:?} cannot be read ({error})"))?;
        let mut bytes = Vec::new();
        let read = entry.by_ref().take(MAX_ARRAY_BYTES + 1).read_to_end(&mut bytes);
        read.map_err(|error| format!("array {name:?} cannot be unpacked ({error}); is the file complete?"))?;
        if bytes.len() as u64 > MAX_ARRAY_BYTES {
            return Err(format!("array {name:?} is larger than 1 GiB"));
        }
        Array::parse(&bytes).map_err(|reason| format!("array {name:?} {reason}"))
    }
}
