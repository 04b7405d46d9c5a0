//! All integration tests in one binary: linking burn is the slow part.

mod differences;
mod encoder;
mod known;
mod lpips;
mod scene;
mod terms;
mod units;
