//! A tensor as a view into a storage, and its decoded values.
//!
//! PyTorch stores raw little-endian arrays and describes tensors by offset, sizes and strides. Invariant: a
//! [`TensorRef`] has been checked to lie inside its storage, so gathering it can neither fail nor allocate more
//! than [`MAX_EXPANDED`] elements beyond the storage's own number.

use crate::error::Fault;
use half::{bf16, f16};
use std::sync::Arc;

/// Largest number of dimensions; PyTorch's own limit is 64, nobody uses more than 8.
const MAX_DIMS: usize = 16;
/// A tensor may repeat the elements of its storage (stride 0) up to this many elements.
pub(crate) const MAX_EXPANDED: usize = 1 << 24;

/// Type of the elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dtype {
    /// 32-bit float.
    F32,
    /// 16-bit float.
    F16,
    /// 16-bit float with the exponent of an `f32`.
    Bf16,
    /// 64-bit float.
    F64,
    /// Unsigned byte.
    U8,
    /// Signed byte.
    I8,
    /// 16-bit integer.
    I16,
    /// 32-bit integer.
    I32,
    /// 64-bit integer.
    I64,
    /// Truth value, one byte.
    Bool,
}

impl Dtype {
    /// Each type with the name of its storage class in module `torch`.
    pub(crate) const STORAGES: [(&str, Self); 10] = [
        ("FloatStorage", Self::F32),
        ("HalfStorage", Self::F16),
        ("BFloat16Storage", Self::Bf16),
        ("DoubleStorage", Self::F64),
        ("ByteStorage", Self::U8),
        ("CharStorage", Self::I8),
        ("ShortStorage", Self::I16),
        ("IntStorage", Self::I32),
        ("LongStorage", Self::I64),
        ("BoolStorage", Self::Bool),
    ];

    /// Bytes per element.
    pub fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 | Self::Bool => 1,
            Self::F16 | Self::Bf16 | Self::I16 => 2,
            Self::F32 | Self::I32 => 4,
            Self::F64 | Self::I64 => 8,
        }
    }

    pub(crate) fn storage_name(self) -> &'static str {
        Self::STORAGES.iter().find(|(_, dtype)| *dtype == self).map_or("", |(name, _)| name)
    }
}

/// A storage as the pickle mentions it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Storage {
    pub dtype: Dtype,
    /// Name of its file in the archive's folder `data`.
    pub key: Arc<str>,
    /// Elements.
    pub len: usize,
}

/// Where a tensor lies in its file.
#[derive(Clone, Debug, PartialEq)]
pub struct TensorRef {
    pub(crate) storage: Arc<Storage>,
    offset: usize,
    shape: Vec<usize>,
    strides: Vec<usize>,
}

impl TensorRef {
    /// Checks that the view lies inside its storage.
    pub(crate) fn new(
        storage: Arc<Storage>,
        offset: usize,
        shape: Vec<usize>,
        strides: Vec<usize>,
    ) -> Result<Self, Fault> {
        if shape.len() != strides.len() || shape.len() > MAX_DIMS {
            return Err(Fault::text(format!(
                "a tensor has {} sizes and {} strides; there must be equally many, at most {MAX_DIMS}",
                shape.len(),
                strides.len()
            )));
        }
        let outside = || {
            Fault::text(format!(
                "a tensor of shape {shape:?} does not fit in its storage {} of {} elements",
                storage.key, storage.len
            ))
        };
        let count = shape.iter().try_fold(1usize, |product, &n| product.checked_mul(n)).ok_or_else(outside)?;
        if count > 0 {
            let step = |(&n, &stride): (&usize, &usize)| (n - 1).checked_mul(stride);
            let reach = shape.iter().zip(&strides).map(step).try_fold(offset, |sum, far| sum.checked_add(far?));
            if reach.is_none_or(|last| last >= storage.len) || count > storage.len.max(MAX_EXPANDED) {
                return Err(outside());
            }
        }
        Ok(Self { storage, offset, shape, strides })
    }

    /// Sizes, outermost first; empty for a scalar.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Type of the elements.
    pub fn dtype(&self) -> Dtype {
        self.storage.dtype
    }

    /// Number of elements.
    pub fn num_elements(&self) -> usize {
        self.shape.iter().product()
    }

    fn is_contiguous(&self) -> bool {
        let mut expected = 1;
        self.shape.iter().zip(&self.strides).rev().all(|(&n, &stride)| {
            let fits = n == 1 || stride == expected;
            expected *= n;
            fits
        })
    }

    /// The elements in row-major order, from the bytes of the whole storage.
    pub(crate) fn gather(&self, storage: &[u8]) -> Tensor {
        let (size, count) = (self.dtype().size(), self.num_elements());
        let bytes = if count == 0 {
            Vec::new()
        } else if self.is_contiguous() {
            storage[self.offset * size..][..count * size].to_vec()
        } else {
            self.strided(storage, size, count)
        };
        Tensor { dtype: self.dtype(), shape: self.shape.clone(), bytes }
    }

    /// Odometer over the indices, the last dimension fastest.
    fn strided(&self, storage: &[u8], size: usize, count: usize) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(count * size);
        let mut index = vec![0usize; self.shape.len()];
        let mut at = self.offset;
        for _ in 0..count {
            bytes.extend_from_slice(&storage[at * size..][..size]);
            for dim in (0..self.shape.len()).rev() {
                index[dim] += 1;
                at += self.strides[dim];
                if index[dim] < self.shape[dim] {
                    break;
                }
                at -= index[dim] * self.strides[dim];
                index[dim] = 0;
            }
        }
        bytes
    }
}

/// A tensor in memory, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Type of the elements.
    pub dtype: Dtype,
    /// Sizes, outermost first.
    pub shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Tensor {
    /// From elements in row-major order, little endian.
    ///
    /// # Panics
    /// If the number of bytes is not that of the shape (a programmer's error).
    pub fn from_bytes(dtype: Dtype, shape: Vec<usize>, bytes: Vec<u8>) -> Self {
        assert_eq!(bytes.len(), shape.iter().product::<usize>() * dtype.size(), "shape {shape:?} of {dtype:?}");
        Self { dtype, shape, bytes }
    }

    /// An `f32` tensor.
    ///
    /// # Panics
    /// If the number of values is not that of the shape.
    pub fn from_f32(shape: Vec<usize>, values: &[f32]) -> Self {
        Self::from_bytes(Dtype::F32, shape, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    /// The elements as stored, little endian.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The elements as stored, given away.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// All elements as `f64`; integers beyond 2^53 are rounded.
    pub fn to_f64(&self) -> Vec<f64> {
        match self.dtype {
            Dtype::F32 => self.map(|b| f64::from(f32::from_le_bytes(b))),
            Dtype::F16 => self.map(|b| f16::from_le_bytes(b).to_f64()),
            Dtype::Bf16 => self.map(|b| bf16::from_le_bytes(b).to_f64()),
            Dtype::F64 => self.map(f64::from_le_bytes),
            Dtype::U8 | Dtype::Bool => self.map(|[b]| f64::from(b)),
            Dtype::I8 => self.map(|b| f64::from(i8::from_le_bytes(b))),
            Dtype::I16 => self.map(|b| f64::from(i16::from_le_bytes(b))),
            Dtype::I32 => self.map(|b| f64::from(i32::from_le_bytes(b))),
            Dtype::I64 => self.map(|b| i64::from_le_bytes(b) as f64),
        }
    }

    /// All elements rounded to `f32`.
    pub fn to_f32(&self) -> Vec<f32> {
        match self.dtype {
            Dtype::F32 => self.map(f32::from_le_bytes),
            _ => self.to_f64().into_iter().map(|value| value as f32).collect(),
        }
    }

    /// All elements of an integer or boolean tensor; `None` for floats.
    pub fn to_i64(&self) -> Option<Vec<i64>> {
        Some(match self.dtype {
            Dtype::U8 | Dtype::Bool => self.map(|[b]| i64::from(b)),
            Dtype::I8 => self.map(|b| i64::from(i8::from_le_bytes(b))),
            Dtype::I16 => self.map(|b| i64::from(i16::from_le_bytes(b))),
            Dtype::I32 => self.map(|b| i64::from(i32::from_le_bytes(b))),
            Dtype::I64 => self.map(i64::from_le_bytes),
            Dtype::F32 | Dtype::F16 | Dtype::Bf16 | Dtype::F64 => return None,
        })
    }

    fn map<const N: usize, T>(&self, element: impl Fn([u8; N]) -> T) -> Vec<T> {
        self.bytes.as_chunks().0.iter().map(|bytes| element(*bytes)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn storage(len: usize) -> Arc<Storage> {
        Arc::new(Storage { dtype: Dtype::U8, key: "0".into(), len })
    }

    /// The definition, by recursion over the dimensions.
    fn slow(view: &TensorRef, bytes: &[u8], dim: usize, at: usize, out: &mut Vec<u8>) {
        if dim == view.shape.len() {
            return out.push(bytes[at]);
        }
        (0..view.shape[dim]).for_each(|i| slow(view, bytes, dim + 1, at + i * view.strides[dim], out));
    }

    proptest! {
        #[test]
        fn gathering_is_indexing(
            shape in proptest::collection::vec(0usize..5, 0..5),
            strides in proptest::collection::vec(0usize..7, 5),
            offset in 0usize..6,
        ) {
            let strides = strides[..shape.len()].to_vec();
            let bytes: Vec<u8> = (0..=255).collect();
            let view = TensorRef::new(storage(256), offset, shape, strides).unwrap();
            let mut expected = Vec::new();
            slow(&view, &bytes, 0, offset, &mut expected);
            prop_assert_eq!(view.gather(&bytes).into_bytes(), expected);
        }
    }

    #[test]
    fn a_view_beyond_its_storage_is_refused() {
        let view = |offset, shape: &[usize], strides: &[usize]| {
            TensorRef::new(storage(12), offset, shape.to_vec(), strides.to_vec())
        };
        assert!(view(0, &[3, 4], &[4, 1]).is_ok());
        assert!(view(0, &[3, 4], &[1, 3]).is_ok());
        assert!(view(12, &[0, 4], &[4, 1]).is_ok());
        assert!(view(11, &[], &[]).is_ok());
        assert!(view(12, &[], &[]).is_err());
        assert!(view(1, &[3, 4], &[4, 1]).is_err());
        assert!(view(0, &[2], &[usize::MAX]).is_err());
        assert!(view(0, &[usize::MAX, 2], &[0, 0]).is_err());
        assert!(view(0, &[MAX_EXPANDED + 1], &[0]).is_err());
        assert!(view(0, &[2, 2], &[1]).is_err());
        let error = view(9, &[3, 4], &[4, 1]).unwrap_err();
        assert!(matches!(error, Fault::Text(reason) if reason.contains("does not fit in its storage 0 of 12")));
    }

    #[test]
    fn every_type_becomes_numbers() {
        let one = |dtype, bytes: &[u8]| Tensor::from_bytes(dtype, vec![1], bytes.to_vec());
        assert_eq!(one(Dtype::F16, &f16::from_f32(-1.5).to_le_bytes()).to_f32(), [-1.5]);
        assert_eq!(one(Dtype::Bf16, &bf16::from_f32(-1.5).to_le_bytes()).to_f32(), [-1.5]);
        assert_eq!(one(Dtype::F64, &0.1f64.to_le_bytes()).to_f64(), [0.1]);
        assert_eq!(one(Dtype::I8, &[0xff]).to_i64().unwrap(), [-1]);
        assert_eq!(one(Dtype::U8, &[0xff]).to_i64().unwrap(), [255]);
        assert_eq!(one(Dtype::I16, &(-2i16).to_le_bytes()).to_f32(), [-2.0]);
        assert_eq!(one(Dtype::I32, &(-3i32).to_le_bytes()).to_i64().unwrap(), [-3]);
        assert_eq!(one(Dtype::I64, &i64::MIN.to_le_bytes()).to_i64().unwrap(), [i64::MIN]);
        assert_eq!(one(Dtype::Bool, &[1]).to_f32(), [1.0]);
        assert_eq!(one(Dtype::F32, &1f32.to_le_bytes()).to_i64(), None);
    }
}
