//! Picking photographs of a scene by what a person calls them.
//!
//! A name is tried as the full name, the file name, the stem and finally a number; the first reading that
//! fits anything decides, and it must fit exactly one photograph.

use super::error::SceneError;
use super::files::{number_of_stem, stem_of};
use super::matching::abbreviated;
use super::{Frame, Scene};
use std::path::Path;

impl Scene {
    /// Indices into `frames` of the photographs called `names`, in that order.
    ///
    /// `"images/000023.jpg"`, `"000023.jpg"`, `"000023"` and `"23"` all mean the same frame.
    ///
    /// # Errors
    /// [`SceneError::NoSuchView`] or [`SceneError::AmbiguousView`], naming what there is.
    pub fn select(&self, names: &[String]) -> Result<Vec<usize>, SceneError> {
        names.iter().map(|name| self.find(name)).collect()
    }

    fn find(&self, wanted: &str) -> Result<usize, SceneError> {
        let number = wanted.parse::<u64>().ok();
        let file_name =
            |frame: &Frame| Path::new(&frame.name).file_name().map(|name| name.to_string_lossy().into_owned());
        let readings: [&dyn Fn(&Frame) -> bool; 6] = [
            &|frame| frame.name == wanted,
            &|frame| file_name(frame).as_deref() == Some(wanted),
            &|frame| frame.image_path.file_name().is_some_and(|name| name.to_string_lossy() == wanted),
            &|frame| frame.stem() == wanted || stem_of(Path::new(&frame.name)) == wanted,
            &|frame| number.is_some() && frame.stem().parse::<u64>().ok() == number,
            &|frame| number.is_some() && number_of_stem(&frame.stem()) == number,
        ];
        for reading in readings {
            let found: Vec<usize> = (0..self.frames.len()).filter(|&index| reading(&self.frames[index])).collect();
            match found[..] {
                [] => {}
                [index] => return Ok(index),
                _ => {
                    let candidates = found.iter().map(|&index| self.frames[index].name.clone()).collect();
                    let (root, wanted) = (self.root.clone(), wanted.to_owned());
                    return Err(SceneError::AmbiguousView { root, wanted, candidates });
                }
            }
        }
        let names: Vec<String> = self.frames.iter().map(|frame| frame.name.clone()).collect();
        let (root, wanted) = (self.root.clone(), wanted.to_owned());
        Err(SceneError::NoSuchView { root, wanted, available: abbreviated(&names) })
    }
}
