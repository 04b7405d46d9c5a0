//! The text header of a binary little-endian PLY file. Invariant: comments are single lines.

use super::GENERATOR;
use std::io::{self, Write};

/// A header under construction; finished by [`Self::write`].
pub(super) struct PlyHeader(String);

impl PlyHeader {
    /// Opens with the program's name and the caller's remarks (frame, unit); line breaks split a remark.
    pub(super) fn new(comments: &[&str]) -> Self {
        let mut text = format!("ply\nformat binary_little_endian 1.0\ncomment {GENERATOR}\n");
        for line in comments.iter().flat_map(|comment| comment.lines()) {
            text.push_str(&format!("comment {line}\n"));
        }
        Self(text)
    }

    /// Starts an element with `count` rows.
    pub(super) fn element(mut self, name: &str, count: usize) -> Self {
        self.0.push_str(&format!("element {name} {count}\n"));
        self
    }

    /// Adds properties of one type to the element last started.
    pub(super) fn properties<S: AsRef<str>>(mut self, kind: &str, names: impl IntoIterator<Item = S>) -> Self {
        for name in names {
            self.0.push_str(&format!("property {kind} {}\n", name.as_ref()));
        }
        self
    }

    /// Closes and writes the header.
    pub(super) fn write(self, out: &mut impl Write) -> io::Result<()> {
        out.write_all(self.0.as_bytes())?;
        out.write_all(b"end_header\n")
    }
}
