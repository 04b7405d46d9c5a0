//! `pair.txt` of MVSNet: for every view its sources, best first.
//!
//! Number of views; then per view its id, and a line `n  source score  source score ...`. Invariant: nothing is
//! reserved for a count that the text does not keep.

use crate::DataError;
use std::collections::BTreeMap;
use std::path::Path;

/// Sources of each reference view, best first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PairList(BTreeMap<usize, Vec<usize>>);

impl PairList {
    /// From lists of sources by reference.
    pub fn new(lists: impl IntoIterator<Item = (usize, Vec<usize>)>) -> Self {
        Self(lists.into_iter().collect())
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`DataError`] when it is missing or not such a list.
    pub fn read(path: &Path) -> Result<Self, DataError> {
        let text = std::fs::read_to_string(path).map_err(|source| DataError::Read { path: path.to_owned(), source })?;
        Self::parse(&text).map_err(|reason| DataError::malformed(path, reason))
    }

    fn parse(text: &str) -> Result<Self, String> {
        let mut tokens = text.split_whitespace();
        let mut number = |what: &str| -> Result<f64, String> {
            let token = tokens.next().ok_or_else(|| format!("ends where {what} should be"))?;
            token.parse().map_err(|_| format!("has {token:?} where {what} should be"))
        };
        let count = |value: f64, what: &str| {
            let whole = value >= 0.0 && value.fract() == 0.0 && value <= 1e9;
            if whole { Ok(value as usize) } else { Err(format!("has {value} for {what}; it must be a whole number")) }
        };
        let mut lists = BTreeMap::new();
        for _ in 0..count(number("the number of views")?, "the number of views")? {
            let reference = count(number("a view's id")?, "a view's id")?;
            let mut sources = Vec::new();
            for _ in 0..count(number("a number of sources")?, "a number of sources")? {
                sources.push(count(number("a source's id")?, "a source's id")?);
                number("a source's score")?;
            }
            lists.insert(reference, sources);
        }
        Ok(Self(lists))
    }

    /// The views that have sources, ascending.
    pub fn references(&self) -> impl Iterator<Item = usize> {
        self.0.keys().copied()
    }

    /// The sources of a view, best first; none for an unknown one.
    pub fn sources(&self, reference: usize) -> &[usize] {
        self.0.get(&reference).map_or(&[], Vec::as_slice)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TEXT: &str = "2\n0\n2 10 2346.41 1 2036.53\n10\n1 0 2346.41 \n";

    #[test]
    fn sources_keep_their_order() {
        let pairs = PairList::parse(TEXT).unwrap();
        assert_eq!(pairs, PairList::new([(0, vec![10, 1]), (10, vec![0])]));
        assert_eq!((pairs.sources(0), pairs.sources(7)), ([10, 1].as_slice(), [].as_slice()));
    }

    #[test]
    fn faults_are_sentences() {
        assert!(PairList::parse("").unwrap_err().contains("ends where the number of views"));
        assert!(PairList::parse("2 0 2 10 5.0 1").unwrap_err().contains("ends where a source's score"));
        assert!(PairList::parse("1 0 1 a 5.0").unwrap_err().contains("\"a\" where a source's id"));
        assert!(PairList::parse("1 -3 1 0 5.0").unwrap_err().contains("-3 for a view's id"));
        assert!(PairList::parse("1 0 999999999").unwrap_err().contains("ends where"));
    }

    proptest! {
        #[test]
        fn damaged_text_never_panics(at in any::<prop::sample::Index>(), with in any::<char>(), keep in 0usize..60) {
            let mut text: Vec<char> = TEXT.chars().collect();
            let at = at.index(text.len());
            text[at] = with;
            let _ = PairList::parse(&text.into_iter().take(keep).collect::<String>());
        }
    }
}
