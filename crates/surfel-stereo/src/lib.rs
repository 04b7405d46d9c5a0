//! Depth by matching: plane sweep, semi-global aggregation, slanted refinement, left-right check.
