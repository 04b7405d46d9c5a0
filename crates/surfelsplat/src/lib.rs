//! Two posed photos to a coloured mesh: the library behind the `surfelsplat` command.
//!
//! [`reconstruct::reconstruct`] walks the whole road; the crates it joins (`surfel-io`, `surfel-stereo`,
//! `surfel-raster`, `surfel-mesh`, ...) can each be used alone. [`experiments`] measures what it does.

pub mod experiments;
pub mod reconstruct;
