//! Numbers and lines of text camera files.
//!
//! Never trusts a count: everything is bounded by the text that is really there.

use super::error::Fault;

/// The text of a file, without a byte-order mark.
pub(crate) fn utf8(bytes: &[u8]) -> Result<&str, Fault> {
    let text = std::str::from_utf8(bytes).map_err(|_| Fault::text("is not a text file (not UTF-8)"))?;
    Ok(text.trim_start_matches('\u{feff}'))
}

/// Whitespace-separated numbers.
pub(crate) fn numbers(text: &str) -> Result<Vec<f64>, Fault> {
    text.split_whitespace().map(number).collect()
}

/// One number.
pub(crate) fn number(token: &str) -> Result<f64, Fault> {
    token.parse().map_err(|_| Fault::text(format!("{token:?} is not a number")))
}

/// One non-negative integer that fits `T`.
pub(crate) fn integer<T: TryFrom<u64>>(token: &str) -> Result<T, Fault> {
    let fault = || Fault::text(format!("{token:?} is not a count or an id"));
    token.parse::<u64>().ok().and_then(|value| T::try_from(value).ok()).ok_or_else(fault)
}

/// Exactly `N` numbers; `what` names them in the message.
pub(crate) fn exactly<const N: usize>(numbers: &[f64], what: &str) -> Result<[f64; N], Fault> {
    numbers.try_into().map_err(|_| Fault::text(format!("{what} needs {N} numbers, not {}", numbers.len())))
}

/// Numbered non-empty lines, counted from 1, comments (`#`) left out.
pub(crate) fn content_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .map(|(index, line)| (index + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// Puts the line number in front of a fault's sentence.
pub(crate) fn at_line(line: usize) -> impl Fn(Fault) -> Fault {
    move |fault| match fault {
        Fault::Text(reason) => Fault::Text(format!("line {line}: {reason}")),
        pose => pose,
    }
}
