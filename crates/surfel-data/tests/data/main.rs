//! Tiny data sets are written to disk in each layout and read back.
//!
//! One crate, so that everything is linked once.

mod blended_mvs;
mod chunks;
mod dtu;
mod fit_and_mirror;
mod support;
