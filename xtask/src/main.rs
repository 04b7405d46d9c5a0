//! Project checks that cargo alone does not do.
fn main() {}
