//! The `surfelsplat` command.
fn main() {}
