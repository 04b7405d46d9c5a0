//! Scenes in, views out: what opening a folder and loading a photograph must do.

mod real_scenes;
