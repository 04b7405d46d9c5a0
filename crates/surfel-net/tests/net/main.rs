//! All integration tests in one binary: linking burn is the slow part.

mod activation;
mod checkpoint;
mod config;
mod conv;
mod dino;
mod epipolar;
mod gather_attention;
mod group_norm;
mod import;
mod model;
mod plane_sweep;
mod propagate;
mod reference_names;
mod region;
mod render;
mod seeded;
