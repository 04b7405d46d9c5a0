//! Reader of MATLAB level-5 files, as far as benchmarks use them: real numeric and logical arrays.
//!
//! Works on bytes, compressed or not, of either byte order; other variables (cells, structs, text, sparse) are
//! skipped. Invariant: any input ends in arrays or an error, never in a panic or in memory the file did not announce.

use std::collections::BTreeMap;
use std::io::Read;

/// A dense array, first index fastest (column-major).
#[derive(Clone, Debug, PartialEq)]
pub struct MatArray {
    /// Extent of each dimension; at least two.
    pub dims: Vec<usize>,
    /// Values, first index fastest.
    pub values: MatValues,
}

/// Values of a [`MatArray`]: bytes stay bytes, since a voxel mask has tens of millions of them.
#[derive(Clone, Debug, PartialEq)]
pub enum MatValues {
    /// 8-bit unsigned or logical.
    Bytes(Vec<u8>),
    /// Any other number type.
    Numbers(Vec<f64>),
}

/// Why a `.mat` file cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MatError {
    /// The header is not that of a level-5 file.
    #[error("this is not a MATLAB level-5 file (a file of `save -v7.3` is HDF5: save it again with `-v7`)")]
    NotLevel5,
    /// An element runs past the end of the file or of the element that holds it.
    #[error("the file ends in the middle of an element at byte {0}; it looks cut off")]
    Truncated(usize),
    /// A compressed element does not unpack.
    #[error("a compressed element does not unpack ({0}); the file looks damaged")]
    Compression(String),
    /// An array contradicts itself.
    #[error("variable `{name}`: {problem}")]
    Array {
        /// Name of the variable, as far as it was read.
        name: String,
        /// What does not fit.
        problem: &'static str,
    },
}

impl MatArray {
    /// Value `index` (column-major) as a number; `None` beyond the end.
    pub fn get(&self, index: usize) -> Option<f64> {
        match &self.values {
            MatValues::Bytes(bytes) => bytes.get(index).map(|&b| f64::from(b)),
            MatValues::Numbers(numbers) => numbers.get(index).copied(),
        }
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        match &self.values {
            MatValues::Bytes(bytes) => bytes.len(),
            MatValues::Numbers(numbers) => numbers.len(),
        }
    }

    /// True for an array without values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A voxel mask of a scanner's whole volume stays well below this; a bomb does not.
const MAX_UNPACKED: u64 = 2 << 30;

const MI_COMPRESSED: u32 = 15;
const MI_MATRIX: u32 = 14;
const FLAG_COMPLEX: u32 = 0x0800;
/// Array classes double (6) to unsigned 64-bit (15) are dense numbers.
const NUMERIC_CLASSES: std::ops::RangeInclusive<u32> = 6..=15;

/// All dense real arrays of a file by name.
///
/// # Errors
/// [`MatError`] when the bytes are not a level-5 file, or a damaged one.
pub fn read_mat(bytes: &[u8]) -> Result<BTreeMap<String, MatArray>, MatError> {
    let order = match bytes.get(126..128) {
        Some(b"IM") => Order::Little,
        Some(b"MI") => Order::Big,
        _ => return Err(MatError::NotLevel5),
    };
    let mut arrays = BTreeMap::new();
    let mut elements = Elements { bytes, at: 128, order };
    while let Some((kind, data)) = elements.next()? {
        let unpacked;
        let matrix = match kind {
            MI_MATRIX => data,
            MI_COMPRESSED => {
                unpacked = inflate(data)?;
                match (Elements { bytes: &unpacked, at: 0, order }).next()? {
                    Some((MI_MATRIX, inner)) => inner,
                    _ => continue,
                }
            }
            _ => continue,
        };
        if let Some((name, array)) = read_matrix(matrix, order)? {
            arrays.insert(name, array);
        }
    }
    Ok(arrays)
}

fn inflate(data: &[u8]) -> Result<Vec<u8>, MatError> {
    let mut unpacked = Vec::new();
    let mut reader = flate2::read::ZlibDecoder::new(data).take(MAX_UNPACKED);
    reader.read_to_end(&mut unpacked).map_err(|error| MatError::Compression(error.to_string()))?;
    Ok(unpacked)
}

fn read_matrix(bytes: &[u8], order: Order) -> Result<Option<(String, MatArray)>, MatError> {
    let mut parts = Elements { bytes, at: 0, order };
    let mut part = || parts.next()?.ok_or(MatError::Truncated(bytes.len()));
    let (_, flags) = part()?;
    let flags = flags.get(..4).map(|b| order.u32(b)).ok_or(MatError::Truncated(0))?;
    if !NUMERIC_CLASSES.contains(&(flags & 0xff)) {
        return Ok(None);
    }
    let (_, dims) = part()?;
    let dims: Vec<usize> = dims.chunks_exact(4).map(|b| order.u32(b) as usize).collect();
    let name = String::from_utf8_lossy(part()?.1).into_owned();
    if flags & FLAG_COMPLEX != 0 {
        return Ok(None);
    }
    let wrong = |problem| MatError::Array { name: name.clone(), problem };
    let (kind, data) = part()?;
    let values = numbers(kind, data, order).ok_or_else(|| wrong("its numbers have an unknown type"))?;
    let array = MatArray { dims, values };
    let announced = array.dims.iter().try_fold(1usize, |product, &n| product.checked_mul(n));
    if array.dims.len() < 2 || announced != Some(array.len()) {
        return Err(wrong("its dimensions do not match its number of values"));
    }
    Ok(Some((name, array)))
}

/// Numbers of storage type `kind`, which may be smaller than the class of the array.
fn numbers(kind: u32, data: &[u8], order: Order) -> Option<MatValues> {
    fn each<const N: usize>(data: &[u8], order: Order, number: impl Fn([u8; N]) -> f64) -> MatValues {
        let values = data.chunks_exact(N).map(|chunk| {
            let mut bytes = [0; N];
            bytes.copy_from_slice(chunk);
            if order == Order::Big {
                bytes.reverse();
            }
            number(bytes)
        });
        MatValues::Numbers(values.collect())
    }
    Some(match kind {
        1 => each(data, order, |b| f64::from(i8::from_le_bytes(b))),
        2 => MatValues::Bytes(data.to_vec()),
        3 => each(data, order, |b| f64::from(i16::from_le_bytes(b))),
        4 => each(data, order, |b| f64::from(u16::from_le_bytes(b))),
        5 => each(data, order, |b| f64::from(i32::from_le_bytes(b))),
        6 => each(data, order, |b| f64::from(u32::from_le_bytes(b))),
        7 => each(data, order, |b| f64::from(f32::from_le_bytes(b))),
        9 => each(data, order, f64::from_le_bytes),
        12 => each(data, order, |b| i64::from_le_bytes(b) as f64),
        13 => each(data, order, |b| u64::from_le_bytes(b) as f64),
        _ => return None,
    })
}

#[derive(Clone, Copy, PartialEq)]
enum Order {
    Little,
    Big,
}

impl Order {
    /// The first four bytes of `bytes` as a number.
    fn u32(self, bytes: &[u8]) -> u32 {
        let b = [bytes[0], bytes[1], bytes[2], bytes[3]];
        match self {
            Self::Little => u32::from_le_bytes(b),
            Self::Big => u32::from_be_bytes(b),
        }
    }
}

/// Walks tagged data elements, each padded to 8 bytes unless compressed.
struct Elements<'a> {
    bytes: &'a [u8],
    at: usize,
    order: Order,
}

impl<'a> Elements<'a> {
    fn next(&mut self) -> Result<Option<(u32, &'a [u8])>, MatError> {
        let truncated = MatError::Truncated(self.at);
        let Some(tag) = self.bytes.get(self.at..self.at + 8) else {
            // Fewer than 8 bytes left can only be padding.
            return Ok(None);
        };
        let (first, second) = (self.order.u32(tag), self.order.u32(&tag[4..]));
        // A small element keeps its length in the upper half of the type and its data in the tag.
        let (kind, start, length) = match first >> 16 {
            0 => (first, self.at + 8, second as usize),
            length => (first & 0xffff, self.at + 4, length as usize),
        };
        let data = start.checked_add(length).and_then(|end| self.bytes.get(start..end)).ok_or(truncated)?;
        let end = start + length;
        self.at = if kind == MI_COMPRESSED { end } else { end.next_multiple_of(8) };
        Ok(Some((kind, data)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Written by tests/fixtures/obs_mask.py with scipy, once compressed and once not.
    const COMPRESSED: &[u8] = include_bytes!("../tests/fixtures/obs_mask_compressed.mat");
    const PLAIN: &[u8] = include_bytes!("../tests/fixtures/obs_mask_plain.mat");

    #[test]
    fn reads_what_scipy_wrote() {
        for file in [COMPRESSED, PLAIN] {
            let arrays = read_mat(file).unwrap();
            let mask = &arrays["ObsMask"];
            assert_eq!(mask.dims, [4, 3, 2]);
            let expected: Vec<u8> = (0..24).map(|i| u8::from(i % 5 < 2)).collect();
            assert_eq!(mask.values, MatValues::Bytes(expected));
            assert_eq!(
                (0..6).map(|i| arrays["BB"].get(i).unwrap()).collect::<Vec<_>>(),
                [-1.5, 10.0, 0.25, 20.0, 3.0, 30.0]
            );
            assert_eq!((arrays["Res"].dims.as_slice(), arrays["Res"].get(0)), ([1usize, 1].as_slice(), Some(0.5)));
            assert_eq!(arrays["Counts"].values, MatValues::Numbers(vec![-3.0, 70000.0]));
            assert!(!arrays.contains_key("Note"), "text is skipped");
        }
    }

    #[test]
    fn a_cut_file_and_a_foreign_one_say_so() {
        assert!(matches!(read_mat(&PLAIN[..PLAIN.len() / 2]), Err(MatError::Truncated(_))));
        assert!(matches!(read_mat(&COMPRESSED[..COMPRESSED.len() - 100]), Err(MatError::Truncated(_))));
        assert_eq!(read_mat(b"\x89HDF\r\n\x1a\n"), Err(MatError::NotLevel5));
    }

    proptest! {
        #[test]
        fn damaged_bytes_never_panic(changes in proptest::collection::vec((128usize..600, any::<u8>()), 1..12), cut in 0usize..1500) {
            let mut bytes = PLAIN.to_vec();
            for (at, value) in changes {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte = value;
                }
            }
            bytes.truncate(cut.max(100));
            let _ = read_mat(&bytes);
        }
    }
}
