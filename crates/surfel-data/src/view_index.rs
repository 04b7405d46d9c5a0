//! Lists of views to evaluate on (spec 5.5), as the method's ancestors keep them.
//!
//! JSON: scene, or scene and the number of a repetition (`scan1_train_02`), to `{"context": [..], "target": [..]}`, or to
//! null where the scene has no usable views. Invariant: what is written is read back, and the same list gives the same
//! bytes.

use crate::DataError;
use crate::choice::Choice;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Contexts and targets by scene.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ViewIndex(BTreeMap<String, Option<Choice>>);

#[derive(Serialize, Deserialize)]
struct Entry {
    context: Vec<usize>,
    target: Vec<usize>,
}

impl ViewIndex {
    /// From choices by scene.
    pub fn new(choices: impl IntoIterator<Item = (String, Option<Choice>)>) -> Self {
        Self(choices.into_iter().collect())
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`DataError`] when it is missing or no such list.
    pub fn read(path: &Path) -> Result<Self, DataError> {
        let bytes = std::fs::read(path).map_err(|source| DataError::Read { path: path.to_owned(), source })?;
        let entries: BTreeMap<String, Option<Entry>> = serde_json::from_slice(&bytes).map_err(|error| {
            DataError::malformed(path, format!("is no list of contexts and targets for every scene ({error})"))
        })?;
        let choice = |entry: Entry| Choice { contexts: entry.context, targets: entry.target };
        Ok(Self(entries.into_iter().map(|(key, entry)| (key, entry.map(choice))).collect()))
    }

    /// As JSON.
    pub fn to_json(&self) -> String {
        let entry = |choice: &Choice| Entry { context: choice.contexts.clone(), target: choice.targets.clone() };
        let entries: BTreeMap<&str, Option<Entry>> =
            self.0.iter().map(|(key, choice)| (key.as_str(), choice.as_ref().map(entry))).collect();
        serde_json::to_string_pretty(&entries).expect("text and numbers are JSON")
    }

    /// The choices of a scene: the one under its name, and those of its repetitions `<scene>_00`, `<scene>_01`, ...
    pub fn choices<'a>(&'a self, scene: &'a str) -> impl Iterator<Item = &'a Choice> {
        let of_scene = move |key: &str| {
            let repetition = key.strip_prefix(scene).and_then(|rest| rest.strip_prefix('_'));
            key == scene || repetition.is_some_and(|rest| rest.len() == 2 && rest.bytes().all(|b| b.is_ascii_digit()))
        };
        self.0.iter().filter(move |(key, _)| of_scene(key)).filter_map(|(_, choice)| choice.as_ref())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"{"scan1_train_00": {"context": [33, 31], "target": [32]}, "scan1_train_01": {"context": [33, 31],
        "target": [24]}, "scan10_train_00": {"context": [1, 2], "target": [3]}, "5aca87f95a9412c6": null,
        "322261824c4a3003": {"context": [58, 133], "target": [78, 86, 117]}}"#;

    #[test]
    fn a_list_is_read_and_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("index.json");
        std::fs::write(&path, TEXT).unwrap();
        let index = ViewIndex::read(&path).unwrap();
        let targets = |scene: &str| index.choices(scene).map(|choice| choice.targets.clone()).collect::<Vec<_>>();
        assert_eq!(targets("scan1_train"), [[32], [24]]);
        assert_eq!(targets("322261824c4a3003"), [[78, 86, 117]]);
        assert!(targets("5aca87f95a9412c6").is_empty() && targets("scan1").is_empty());
        std::fs::write(&path, index.to_json()).unwrap();
        assert_eq!(ViewIndex::read(&path).unwrap(), index);
        std::fs::write(&path, "{\"a\": [1]}").unwrap();
        let error = ViewIndex::read(&path).unwrap_err().to_string();
        assert!(error.contains("index.json: is no list of contexts and targets"), "{error}");
    }
}
