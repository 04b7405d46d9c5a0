//! The experiments as people run them: the real binary on tiny scenes, judged by its exit code and its tables.

#[path = "../road/command.rs"]
#[expect(dead_code, reason = "shared with the tests of the road, which run more commands")]
mod command;
mod depth;
mod dtu;
mod nyquist;
mod other_experiments;
mod synth_command;
mod synth_scores;
mod tables;
