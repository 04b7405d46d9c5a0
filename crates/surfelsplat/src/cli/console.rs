//! Talking while the road is walked: a spinner per stage on a terminal, plain lines elsewhere.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::time::Duration;
use surfelsplat::reconstruct::{Progress, Stage};

/// Listens to the road and writes to stderr.
pub struct Console {
    quiet: bool,
    bar: Option<ProgressBar>,
}

impl Console {
    /// Silent when `quiet`; animated when stderr is a terminal.
    pub fn new(quiet: bool) -> Self {
        let animated = !quiet && std::io::stderr().is_terminal();
        let bar = animated.then(|| {
            let bar = ProgressBar::with_draw_target(Some(Stage::ALL.len() as u64), ProgressDrawTarget::stderr());
            let style = ProgressStyle::with_template("{spinner} {bar:16} {pos}/{len} {msg} [{elapsed}]");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.enable_steady_tick(Duration::from_millis(120));
            bar
        });
        Self { quiet, bar }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    fn print(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.println(line),
            None => eprintln!("{line}"),
        }
    }
}

impl Progress for Console {
    fn begin(&self, stage: Stage) {
        if let Some(bar) = &self.bar {
            let done = Stage::ALL.iter().position(|s| *s == stage).unwrap_or(0);
            bar.set_position(done as u64);
            bar.set_message(stage.describe());
        }
    }

    fn say(&self, line: &str) {
        if !self.quiet {
            self.print(line);
        }
    }

    fn warn(&self, line: &str) {
        if !self.quiet {
            self.print(&format!("warning: {line}"));
        }
    }
}
