//! All integration tests in one binary: linking burn is the slow part.

mod config;
mod gather_attention;
mod model;
mod plane_sweep;
mod propagate;
mod region;
mod seeded;
