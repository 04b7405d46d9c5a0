//! Scenes with exact ground truth: analytic shapes and textured meshes, ray-cast to images, depth and normals.
