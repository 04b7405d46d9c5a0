//! Tiny data sets are written to disk in the layouts of the paper's training sets, and trained on.
//!
//! One crate, so that everything is linked once.

mod faults;
mod layouts;
mod training;
