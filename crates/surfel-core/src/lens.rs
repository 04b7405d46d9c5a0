//! Lens distortion models.
