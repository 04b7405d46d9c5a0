//! Reads what DTU distributes for scoring: `Points/stl`, `ObsMask/ObsMask{S}_10.mat`, `ObsMask/Plane{S}.mat`.
//!
//! Invariant: a reference that opens is complete and its arrays fit each other.

use crate::dtu::{DtuReference, ObservedVolume};
use crate::mat::{MatArray, MatError, MatValues, read_mat};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use surfel_io::ply::{PlyError, read_ply};

/// Why the reference of a scan cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum DtuError {
    /// A file is missing or unreadable.
    #[error("cannot read {path}: {source}; the DTU evaluation needs SampleSet's ObsMask folder and Points/stl")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The scan is no PLY we read.
    #[error("{path}: {source}")]
    Ply {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: PlyError,
    },
    /// A `.mat` file does not parse.
    #[error("{path}: {source}")]
    Mat {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: MatError,
    },
    /// A `.mat` file lacks a variable or it has the wrong shape.
    #[error("{path}: variable `{variable}` should be {expected}")]
    Variable {
        /// The file.
        path: PathBuf,
        /// The variable.
        variable: &'static str,
        /// Its shape in words.
        expected: &'static str,
    },
}

impl DtuReference {
    /// Opens the reference of scan `scan` (24, 37, ...) below the folder that holds `Points` and `ObsMask`.
    ///
    /// # Errors
    /// [`DtuError`], naming the file.
    pub fn open(folder: &Path, scan: u32) -> Result<Self, DtuError> {
        let path = folder.join(format!("Points/stl/stl{scan:03}_total.ply"));
        let surface = read_ply(&bytes_of(&path)?).map_err(|source| DtuError::Ply { path, source })?.positions;
        let observed = observed_volume(&folder.join(format!("ObsMask/ObsMask{scan}_10.mat")))?;
        let plane = MatFile::open(folder.join(format!("ObsMask/Plane{scan}.mat")))?;
        let ground_plane = plane.numbers("P", "four numbers")?;
        Ok(Self { surface, observed, ground_plane })
    }
}

fn observed_volume(path: &Path) -> Result<ObservedVolume, DtuError> {
    let mut file = MatFile::open(path.to_owned())?;
    let [voxel] = file.numbers("Res", "one number")?;
    // A 2 x 3 array, so the corners alternate in memory.
    let corners: [f64; 6] = file.numbers("BB", "2 x 3 numbers")?;
    let corner = |row: usize| std::array::from_fn(|i| corners[2 * i + row] as f32);
    let wrong = || file.wrong("ObsMask", "a three-dimensional mask");
    let mask = file.arrays.get("ObsMask").ok_or_else(wrong)?;
    let dims = <[usize; 3]>::try_from(mask.dims.as_slice()).map_err(|_| wrong())?;
    let seen = match file.arrays.remove("ObsMask").map(|mask| mask.values) {
        Some(MatValues::Bytes(bytes)) => bytes,
        Some(MatValues::Numbers(numbers)) => numbers.into_iter().map(|v| u8::from(v != 0.0)).collect(),
        None => Vec::new(),
    };
    Ok(ObservedVolume { low: corner(0), high: corner(1), voxel, dims, seen })
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, DtuError> {
    std::fs::read(path).map_err(|source| DtuError::Read { path: path.to_owned(), source })
}

struct MatFile {
    path: PathBuf,
    arrays: BTreeMap<String, MatArray>,
}

impl MatFile {
    fn open(path: PathBuf) -> Result<Self, DtuError> {
        let arrays = read_mat(&bytes_of(&path)?);
        match arrays {
            Ok(arrays) => Ok(Self { path, arrays }),
            Err(source) => Err(DtuError::Mat { path, source }),
        }
    }

    fn wrong(&self, variable: &'static str, expected: &'static str) -> DtuError {
        DtuError::Variable { path: self.path.clone(), variable, expected }
    }

    /// Exactly `N` finite numbers, first index fastest.
    fn numbers<const N: usize>(&self, variable: &'static str, expected: &'static str) -> Result<[f64; N], DtuError> {
        let wrong = || self.wrong(variable, expected);
        let array = self.arrays.get(variable).filter(|array| array.len() == N).ok_or_else(wrong)?;
        let numbers = std::array::from_fn(|i| array.get(i).unwrap_or(f64::NAN));
        if numbers.iter().all(|v| v.is_finite()) { Ok(numbers) } else { Err(wrong()) }
    }
}
