//! Differentiable 2D Gaussian surfel rasterizer on plain slices: forward, backward and a slow obvious twin.
