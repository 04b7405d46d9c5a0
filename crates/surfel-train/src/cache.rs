//! Samples kept on disk, so that a second epoch costs no rendering and no matching.
//!
//! One file per sample in a folder named by the source's settings. Invariant: a cached sample is the one that would be
//! made again.

use crate::error::TrainError;
use crate::sample::Sample;
use crate::sample_file::{read, write};
use crate::source::Source;
use std::path::{Path, PathBuf};

/// A folder of samples in front of a source.
pub struct Cache {
    folder: Option<PathBuf>,
    source: Source,
}

impl Cache {
    /// In front of `source`; without a folder nothing is kept.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn new(source: Source, folder: Option<&Path>, side: &str) -> Result<Self, TrainError> {
        let folder = folder.map(|folder| folder.join(source.folder_name(side)));
        if let Some(folder) = &folder {
            std::fs::create_dir_all(folder).map_err(TrainError::unwritable(folder))?;
        }
        Ok(Self { folder, source })
    }

    /// Whether samples grow harder with their numbers, see [`Source`].
    pub(crate) fn grows(&self) -> bool {
        self.source.grows()
    }

    /// The sample with a number, from disk or made now.
    ///
    /// # Errors
    /// When it cannot be made, or its file is damaged.
    pub fn sample(&self, number: u64) -> Result<Sample, TrainError> {
        let Some(folder) = &self.folder else { return self.source.sample(number) };
        let path = folder.join(format!("{number:07}.safetensors"));
        if !path.is_file() {
            write(&self.source.sample(number)?, &path)?;
        }
        read(&path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::tests::config;
    use surfel_synth::Split;

    #[test]
    fn threads_that_make_the_same_sample_do_not_disturb_each_other() {
        let folder = tempfile::tempdir().unwrap();
        let source = Source::open(&config(3), Split::Train, None).unwrap();
        let cache = Cache::new(source, Some(folder.path()), "train").unwrap();
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| (0..3).for_each(|number| drop(cache.sample(number).unwrap())));
            }
        });
        let files = std::fs::read_dir(std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path());
        assert_eq!(files.unwrap().count(), 3);
    }

    #[test]
    fn a_cached_sample_is_the_sample() {
        let config = config(3);
        let open = || Source::open(&config, Split::Train, None).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(open(), Some(folder.path()), "train").unwrap();
        let (fresh, first, second) = (open().sample(5).unwrap(), cache.sample(5).unwrap(), cache.sample(5).unwrap());
        for cached in [&first, &second] {
            assert_eq!(cached.cameras, fresh.cameras);
            assert_eq!(cached.truth, fresh.truth);
            assert_eq!(cached.seeds[1].planes, fresh.seeds[1].planes);
            assert_eq!(cached.seeds[1].step, fresh.seeds[1].step);
            assert_eq!(cached.images, fresh.images);
        }
        let path = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        let file = std::fs::read_dir(path).unwrap().next().unwrap().unwrap().path();
        let bytes = std::fs::read(&file).unwrap();
        std::fs::write(&file, &bytes[..bytes.len() / 2]).unwrap();
        assert!(cache.sample(5).unwrap_err().to_string().contains("is damaged"));
    }
}
