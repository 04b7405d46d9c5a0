//! Why two pictures could not be compared.

/// Why a loss or metric was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LossError {
    /// Pictures of different sizes.
    #[error(
        "a picture of {} x {} pixels cannot be compared with one of {} x {}; resize one of them",
        .found.0, .found.1, .expected.0, .expected.1
    )]
    Size {
        /// Columns and rows of the picture.
        found: (usize, usize),
        /// Columns and rows of the photograph.
        expected: (usize, usize),
    },
    /// A picture smaller than what the measure looks at.
    #[error(
        "{measure} needs at least {least} pixels on each side and was given {width} x {height}; use larger pictures"
    )]
    TooSmall {
        /// Name of the measure.
        measure: &'static str,
        /// Smallest side.
        least: usize,
        /// Columns given.
        width: usize,
        /// Rows given.
        height: usize,
    },
}

/// Checks that two pictures `[3, height, width]` can be compared.
pub(crate) fn check_pair(
    measure: &'static str,
    least: usize,
    picture: [usize; 3],
    photograph: [usize; 3],
) -> Result<(), LossError> {
    let [[_, height, width], [_, rows, columns]] = [picture, photograph];
    if (width, height) != (columns, rows) {
        return Err(LossError::Size { found: (width, height), expected: (columns, rows) });
    }
    if width.min(height) < least {
        return Err(LossError::TooSmall { measure, least, width, height });
    }
    Ok(())
}
