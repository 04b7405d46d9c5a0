//! The command as people run it: on folders, judged by its exit code, its words and its files.
//!
//! One crate, so that the whole road is linked once.

mod bad_input;
mod classic_mistakes;
mod command;
mod outputs;
mod read_back;
mod scale;
mod scene_files;
mod shared_scenes;
mod truth;
mod turned_cameras;
mod weights;
