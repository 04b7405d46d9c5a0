//! 2D Gaussian surfels as parallel arrays (structure of arrays).
//!
//! A surfel is a disc `P(u, v) = centre + s_u t_u u + s_v t_v v` with value `exp(-(u² + v²) / 2)`
//! (spec 1.7). Invariant: all arrays describe the same number of surfels.

/// A set of surfels in one frame (world unless said otherwise).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surfels {
    /// Centres, scene units.
    pub centres: Vec<[f32; 3]>,
    /// Standard deviations `[s_u, s_v]` along the tangents, scene units, > 0.
    pub scales: Vec<[f32; 2]>,
    /// `world_from_surfel` quaternions, order **w x y z**; columns of the rotation are `t_u, t_v, t_w`.
    pub rotations: Vec<[f32; 4]>,
    /// Opacity in (0, 1).
    pub opacities: Vec<f32>,
    /// Spherical-harmonic colour, `num_coefficients x [r, g, b]` per surfel, coefficient-major:
    /// surfel `k`, coefficient `n` at `sh[k * num_coefficients + n]`. Colour = max(0, SH + 0.5).
    pub sh: Vec<[f32; 3]>,
    /// SH degree 0..=3; `num_coefficients = (degree + 1)²`.
    pub sh_degree: usize,
}

impl Surfels {
    /// Number of surfels.
    pub fn len(&self) -> usize {
        self.centres.len()
    }

    /// True when there are none.
    pub fn is_empty(&self) -> bool {
        self.centres.is_empty()
    }

    /// SH coefficients per surfel and channel.
    pub fn num_coefficients(&self) -> usize {
        (self.sh_degree + 1) * (self.sh_degree + 1)
    }

    /// True when all arrays agree in length.
    pub fn is_consistent(&self) -> bool {
        let n = self.len();
        self.scales.len() == n
            && self.rotations.len() == n
            && self.opacities.len() == n
            && self.sh.len() == n * self.num_coefficients()
    }

    /// Appends another set of the same SH degree.
    ///
    /// # Panics
    /// If the degrees differ.
    pub fn extend(&mut self, other: &Self) {
        assert!(self.is_empty() || self.sh_degree == other.sh_degree, "surfel sets of different SH degree");
        self.sh_degree = other.sh_degree;
        self.centres.extend_from_slice(&other.centres);
        self.scales.extend_from_slice(&other.scales);
        self.rotations.extend_from_slice(&other.rotations);
        self.opacities.extend_from_slice(&other.opacities);
        self.sh.extend_from_slice(&other.sh);
    }
}
