//! Scenes in, views out: what opening a folder and loading a photograph must do.

mod bad_input;
mod detection;
mod golden;
mod loading;
mod real_scenes;
mod stereo_calib;
mod written;
