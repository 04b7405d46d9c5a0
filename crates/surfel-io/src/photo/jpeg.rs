//! Is a JPEG file all there?
//!
//! JPEG decoders fill what is missing with gray and report success; half a photograph would become a wall
//! in the surface. Invariant: only files that begin as JPEG are ever refused.

/// False for a JPEG whose data stop before its end marker; true for everything else.
pub(super) fn is_complete(bytes: &[u8]) -> bool {
    if !bytes.starts_with(&[0xff, 0xd8]) {
        return true;
    }
    let mut at = 2;
    loop {
        // Segments are skipped by their length, so that the end of an embedded thumbnail is not taken for ours.
        let Some(marker) = next_marker(bytes, at) else { return false };
        at = marker + 2;
        match bytes[marker + 1] {
            0xd9 => return true,
            0x01 | 0xd0..=0xd8 => {}
            _ => match bytes.get(at..at + 2) {
                Some(length) => at += usize::from(u16::from_be_bytes([length[0], length[1]])),
                None => return false,
            },
        }
    }
}

/// Position of the next marker at or after `from`; scan data hold `ff 00` and restart markers only.
fn next_marker(bytes: &[u8], from: usize) -> Option<usize> {
    let rest = bytes.get(from..)?;
    let is_marker = |pair: &[u8]| pair[0] == 0xff && !matches!(pair[1], 0x00 | 0xff | 0xd0..=0xd7);
    rest.windows(2).position(is_marker).map(|offset| from + offset)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn photograph() -> Vec<u8> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let picture =
            image::RgbImage::from_fn(64, 48, |x, y| image::Rgb([(x * 4) as u8, (y * 5) as u8, (x * y) as u8]));
        picture.write_to(&mut bytes, image::ImageFormat::Jpeg).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn the_end_of_a_thumbnail_is_not_the_end_of_the_photograph() {
        let whole = photograph();
        // An APP1 segment with a whole JPEG in it, as cameras write.
        let thumbnail = photograph();
        let mut bytes = vec![0xff, 0xd8, 0xff, 0xe1];
        bytes.extend((thumbnail.len() as u16 + 2).to_be_bytes());
        bytes.extend(&thumbnail);
        let head = bytes.len();
        bytes.extend(&whole[2..]);
        assert!(is_complete(&bytes));
        assert!(!is_complete(&bytes[..head + whole.len() / 2]));
    }

    proptest! {
        #[test]
        fn every_shorter_copy_is_noticed_and_nothing_panics(keep in 0.0f64..1.0, noise in proptest::collection::vec(any::<u8>(), 0..64)) {
            let whole = photograph();
            prop_assert!(is_complete(&whole));
            let cut = 2 + (keep * (whole.len() - 3) as f64) as usize;
            prop_assert!(!is_complete(&whole[..cut]));
            is_complete(&[&[0xff, 0xd8], &noise[..]].concat());
        }
    }
}
