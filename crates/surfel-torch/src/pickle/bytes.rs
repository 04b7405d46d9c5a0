//! The program of a pickle, read from front to back.
//!
//! Invariant: nothing is ever read or reserved beyond the bytes that are there.

use crate::error::Fault;

pub(super) struct Bytes<'a>(pub &'a [u8]);

impl<'a> Bytes<'a> {
    pub fn take(&mut self, len: usize) -> Result<&'a [u8], Fault> {
        let (head, tail) = self.0.split_at_checked(len).ok_or_else(cut_short)?;
        self.0 = tail;
        Ok(head)
    }

    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let (head, tail) = self.0.split_first_chunk().ok_or_else(cut_short)?;
        self.0 = tail;
        Ok(*head)
    }

    pub fn u8(&mut self) -> Result<usize, Fault> {
        self.array::<1>().map(|[byte]| usize::from(byte))
    }

    pub fn u16(&mut self) -> Result<usize, Fault> {
        self.array().map(|bytes| usize::from(u16::from_le_bytes(bytes)))
    }

    pub fn u32(&mut self) -> Result<usize, Fault> {
        self.array().map(|bytes| u32::from_le_bytes(bytes) as usize)
    }

    pub fn u64(&mut self) -> Result<usize, Fault> {
        let value = u64::from_le_bytes(self.array()?);
        usize::try_from(value).map_err(|_| cut_short())
    }

    /// Up to a line feed, which is taken but not returned.
    pub fn line(&mut self) -> Result<&'a str, Fault> {
        let len = self.0.iter().position(|&byte| byte == b'\n').ok_or_else(cut_short)?;
        let line = self.take(len)?;
        self.take(1)?;
        text(line)
    }

    pub fn text(&mut self, len: usize) -> Result<&'a str, Fault> {
        self.take(len).and_then(text)
    }

    /// Two's complement of any length, if it fits in 64 bits.
    pub fn long(&mut self, len: usize) -> Result<i64, Fault> {
        let bytes = self.take(len)?;
        if bytes.len() > 8 {
            return Err(Fault::text("holds an integer of more than 64 bits"));
        }
        let fill = if bytes.last().is_some_and(|byte| *byte >= 0x80) { 0xff } else { 0 };
        let mut word = [fill; 8];
        word[..bytes.len()].copy_from_slice(bytes);
        Ok(i64::from_le_bytes(word))
    }
}

fn text(bytes: &[u8]) -> Result<&str, Fault> {
    std::str::from_utf8(bytes).map_err(|_| Fault::text("holds a string that is not UTF-8"))
}

fn cut_short() -> Fault {
    Fault::text("ends in the middle of its description of the tensors; copy or download it again")
}
