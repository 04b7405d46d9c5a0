//! All integration tests in one binary: linking burn is the slow part.

mod features;
mod gather_attention;
mod plane_sweep;
mod trunk_twin;
