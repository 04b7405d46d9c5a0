//! From a folder to views: open the scene, choose the photographs, load them at the working size.
//!
//! First step of the road. Invariant: the views returned are at least two, in the scene's own frame, and
//! their cameras stand in different places.

use super::error::ReconstructError;
use super::options::Options;
use super::progress::Log;
use super::working_frame::longest_baseline;
use super::working_size::{MIN_SIDE, available_bytes, default_size, estimated_bytes};
use std::path::{Path, PathBuf};
use surfel_core::{Camera, View};
use surfel_io::scene::{Frame, Scene};

/// The photographs of one reconstruction.
pub struct Input {
    /// The scene they are from.
    pub scene: Scene,
    /// Their indices into `scene.frames`.
    pub frames: Vec<usize>,
    /// The photographs at the working size, scene frame, in the same order.
    pub views: Vec<View>,
    /// Why these were chosen.
    pub reason: String,
}

impl Input {
    /// Opens, chooses and loads.
    pub(crate) fn read(path: &Path, options: &Options, log: &Log) -> Result<Self, ReconstructError> {
        let mut scene = match options.format {
            Some(kind) => Scene::open_as(path, kind)?,
            None => Scene::open(path)?,
        };
        if let Some(axes) = options.axes {
            axes.turn(&mut scene);
        }
        log.say(format!("{}: {}", scene.root.display(), scene.format));
        scene.warnings.iter().for_each(|warning| log.warn(warning.clone()));
        let (frames, reason) = choose_frames(&scene, options)?;
        let names: Vec<String> = frames.iter().map(|&f| scene.frames[f].name.clone()).collect();
        log.say(format!("views {} ({reason})", names.join(", ")));
        let sizes: Vec<(usize, usize)> = frames.iter().map(|&f| working_size(&scene.frames[f], options)).collect();
        check_sizes(&scene, &frames, &sizes, log)?;
        let views = frames
            .iter()
            .zip(&sizes)
            .map(|(&f, &(width, height))| scene.frames[f].load(width, height))
            .collect::<Result<Vec<View>, _>>()?;
        let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
        if longest_baseline(&cameras) <= 1e-9 * cameras.iter().map(|c| c.centre().length()).fold(0.0, f64::max) {
            return Err(ReconstructError::Choice(format!(
                "{}: {} were taken from the same place (zero baseline), so nothing can be triangulated; choose other views with --views",
                scene.root.display(),
                names.join(" and ")
            )));
        }
        Ok(Self { scene, frames, views, reason })
    }

    /// Names of the outputs of each view: the image stem, with its folders where two stems are the same.
    pub fn stems(&self) -> Vec<String> {
        let stems: Vec<String> = self.frames.iter().map(|&f| self.scene.frames[f].stem()).collect();
        let is_shared = |stem: &String| stems.iter().filter(|other| *other == stem).count() > 1;
        let in_folder = |path: PathBuf| path.with_extension("").to_string_lossy().replace(['/', '\\'], "_");
        stems
            .iter()
            .zip(self.image_paths())
            .map(|(stem, path)| if is_shared(stem) { in_folder(path) } else { stem.clone() })
            .collect()
    }

    /// Paths of the photographs, relative to the scene where they lie inside it.
    pub fn image_paths(&self) -> Vec<PathBuf> {
        let relative = |path: &Path| path.strip_prefix(&self.scene.root).unwrap_or(path).to_owned();
        self.frames.iter().map(|&f| relative(&self.scene.frames[f].image_path)).collect()
    }

    /// "a.jpg, b.jpg".
    pub fn names(&self) -> String {
        self.frames.iter().map(|&f| self.scene.frames[f].name.as_str()).collect::<Vec<_>>().join(", ")
    }
}

/// The named photographs, or the best that can be found.
fn choose_frames(scene: &Scene, options: &Options) -> Result<(Vec<usize>, String), ReconstructError> {
    if options.views.is_empty() {
        return super::choice::choose(scene, options.num_views.unwrap_or(2));
    }
    let frames = scene.select(&options.views)?;
    let mut different = frames.clone();
    different.sort_unstable();
    different.dedup();
    if different.len() < frames.len() || frames.len() < 2 {
        let what = if frames.len() < 2 { "names one photograph" } else { "names a photograph twice" };
        return Err(ReconstructError::Choice(format!(
            "--views {} {what}; name at least two different ones of {}",
            options.views.join(","),
            scene.root.display()
        )));
    }
    Ok((frames, "as asked".to_owned()))
}

fn working_size(frame: &Frame, options: &Options) -> (usize, usize) {
    options.size.unwrap_or_else(|| default_size(frame.width, frame.height))
}

fn check_sizes(scene: &Scene, frames: &[usize], sizes: &[(usize, usize)], log: &Log) -> Result<(), ReconstructError> {
    for (&f, &(width, height)) in frames.iter().zip(sizes) {
        let frame = &scene.frames[f];
        if width < MIN_SIDE || height < MIN_SIDE {
            return Err(ReconstructError::Choice(format!(
                "{}: a working size of {width}x{height} is too small to match; both sides must be at least {MIN_SIDE} pixels (--size)",
                frame.image_path.display()
            )));
        }
        let stretch = (width as f64 / height as f64) / (frame.width as f64 / frame.height as f64);
        if !(0.75..=1.34).contains(&stretch) {
            log.warn(format!(
                "{} is {}x{}; working at {width}x{height} changes its shape by a factor of {:.2}",
                frame.name,
                frame.width,
                frame.height,
                stretch.max(1.0 / stretch)
            ));
        }
    }
    let needed = estimated_bytes(sizes);
    match available_bytes() {
        Some(available) if needed > available => Err(ReconstructError::Choice(format!(
            "{} views at up to {}x{} need about {:.1} GB of memory and {:.1} GB are free; choose a smaller --size or fewer --views",
            sizes.len(),
            sizes.iter().map(|s| s.0).max().unwrap_or(0),
            sizes.iter().map(|s| s.1).max().unwrap_or(0),
            needed / 1e9,
            available / 1e9
        ))),
        _ => Ok(()),
    }
}
