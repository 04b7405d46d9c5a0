//! What can be wrong with a call as a whole. A single broken surfel is no error: it is skipped.

/// Why a rendering or its gradient was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RasterError {
    /// The arrays describe different numbers of surfels.
    #[error(
        "{array} has {found} entries but {expected} are needed for {surfels} surfels; pass arrays of one surfel set"
    )]
    Length {
        /// The array that disagrees.
        array: &'static str,
        /// Its length.
        found: usize,
        /// The length it must have.
        expected: usize,
        /// Number of centres.
        surfels: usize,
    },
    /// More surfels than 32-bit indices can name.
    #[error("{0} surfels in one rendering; at most 4294967295 are supported, split the set")]
    TooMany(usize),
    /// A spherical-harmonic degree the basis does not have.
    #[error("spherical-harmonic degree {0} is not supported; use 0 to 3")]
    ShDegree(usize),
    /// Intrinsics or pose that cannot project.
    #[error("the camera's {field} is {value}; it must be {expected}")]
    Camera {
        /// What is wrong.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What would be right.
        expected: &'static str,
    },
    /// A configuration value out of range.
    #[error("render setting {field} is {value}; it must be {expected}")]
    Config {
        /// What is wrong.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What would be right.
        expected: &'static str,
    },
    /// A gradient map of another size than the rendering.
    #[error("the gradient of the {map} map is {found_width}x{found_height} but the rendering was {width}x{height}")]
    GradientSize {
        /// Which map.
        map: &'static str,
        /// Columns given.
        found_width: usize,
        /// Rows given.
        found_height: usize,
        /// Columns rendered.
        width: usize,
        /// Rows rendered.
        height: usize,
    },
    /// A gradient map with a value that is NaN or infinite.
    #[error("the gradient of the {map} map is not finite at pixel ({x}, {y}); check the loss for a division by zero")]
    GradientValue {
        /// Which map.
        map: &'static str,
        /// Column.
        x: usize,
        /// Row.
        y: usize,
    },
    /// `backward` was given other surfels than the `forward` that made the tape.
    #[error(
        "the tape was recorded for {recorded} surfels but {given} were given; pass the same surfels to forward and backward"
    )]
    OtherSurfels {
        /// Number recorded.
        recorded: usize,
        /// Number given.
        given: usize,
    },
}
