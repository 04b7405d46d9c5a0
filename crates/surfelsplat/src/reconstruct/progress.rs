//! The stages of the road, who hears about them, and how long each took.
//!
//! The road says what it does through [`Progress`]; the command line draws bars, tests listen in silence.
//! Invariant: every stage that ran has exactly one timing.

use serde::Serialize;
use std::cell::RefCell;
use std::time::Instant;

/// A step of the road, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Camera file and photographs.
    Read,
    /// Sparse matches, sanity check, depth range.
    Check,
    /// Image features.
    Features,
    /// Depth per view.
    Depth,
    /// Surfels per pixel.
    Surfels,
    /// Maps from surfels.
    Render,
    /// TSDF, marching cubes, cleaning.
    Mesh,
    /// Files.
    Write,
}

impl Stage {
    /// All stages in the order they run.
    pub const ALL: [Self; 8] =
        [Self::Read, Self::Check, Self::Features, Self::Depth, Self::Surfels, Self::Render, Self::Mesh, Self::Write];

    /// What the stage is doing, for a progress line.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Read => "reading cameras and photographs",
            Self::Check => "checking cameras, finding the depth range",
            Self::Features => "computing image features",
            Self::Depth => "matching depth",
            Self::Surfels => "placing surfels",
            Self::Render => "rendering maps",
            Self::Mesh => "fusing the mesh",
            Self::Write => "writing files",
        }
    }
}

/// Someone who listens to the road.
pub trait Progress: Sync {
    /// A stage begins.
    fn begin(&self, stage: Stage);
    /// Something that was found or chosen.
    fn say(&self, line: &str);
    /// Something the person should look at.
    fn warn(&self, line: &str);
}

/// Nobody listens.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: Stage) {}
    fn say(&self, _: &str) {}
    fn warn(&self, _: &str) {}
}

/// Time one stage took.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Timing {
    /// The stage.
    pub stage: Stage,
    /// Wall-clock milliseconds.
    pub ms: f64,
}

/// Passes on what is said and keeps warnings and timings for the report.
pub(crate) struct Log<'a> {
    progress: &'a dyn Progress,
    timings: RefCell<Vec<Timing>>,
    warnings: RefCell<Vec<String>>,
}

impl<'a> Log<'a> {
    pub fn new(progress: &'a dyn Progress) -> Self {
        Self { progress, timings: RefCell::default(), warnings: RefCell::default() }
    }

    pub fn stage<T>(&self, stage: Stage, work: impl FnOnce() -> T) -> T {
        self.progress.begin(stage);
        let start = Instant::now();
        let result = work();
        self.timings.borrow_mut().push(Timing { stage, ms: start.elapsed().as_secs_f64() * 1e3 });
        result
    }

    pub fn say(&self, line: impl AsRef<str>) {
        self.progress.say(line.as_ref());
    }

    pub fn warn(&self, line: impl Into<String>) {
        let line = line.into();
        self.progress.warn(&line);
        self.warnings.borrow_mut().push(line);
    }

    pub fn timings(&self) -> Vec<Timing> {
        self.timings.borrow().clone()
    }

    pub fn warnings(&self) -> Vec<String> {
        self.warnings.borrow().clone()
    }
}
