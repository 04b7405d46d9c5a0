//! Two posed photos to a coloured mesh: the reconstruct() facade and the surfelsplat command.
