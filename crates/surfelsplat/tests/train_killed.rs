//! `surfelsplat train`, killed without warning, goes on as if nothing had happened.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// A narrow graph on analytic scenes, so that a step takes milliseconds; a checkpoint every two steps.
const CONFIG: &str = "
network = '''
num_neighbours = 1
[backbone]
kind = \"cnn\"
channels = 8
widths = [8, 8]
[seeded]
distances = [2]
[refinement]
stride = 2
upsampled_channels = 8
unet = { channels = 8, multipliers = [1, 2], attention_at = [] }
[head]
sh_degree = 0
scale_min = 0.5
scale_max = 15.0
[nyquist]
adaptation = true
s = 1.0
epsilon = 0.1353353
radius = 2
adaptive_stride = true
visibility_margin = 0.15
[aggregation]
enabled = true
channels = 8
num_heads = 2
expansion = 2
'''
seed = 7
steps = 24
batch = 1
clip = 1.0
averaging = 0.9
[rate]
rate = 1e-3
rise = 0.1
first_division = 10.0
last_division = 10.0
[loss]
depth = 1.0
normal = 1.0
initial_normal = 0.5
choice = 0.2
opacity = 0.2
[[train]]
num_samples = 6
seed = 1
kind = \"analytic\"
width = 64
height = 48
num_views = 2
[[validation]]
num_samples = 1
seed = 2
kind = \"analytic\"
width = 64
height = 48
num_views = 2
[every]
log = 1
validate = 1000
checkpoint = 2
";

fn start(folder: &Path, run: &str) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_surfelsplat"));
    command.args(["--quiet", "--threads", "2", "train"]).arg(folder.join("run.toml"));
    command.arg("--cache").arg(folder.join("samples")).arg("-o").arg(folder.join(run));
    command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the program starts")
}

fn finish(child: Child) {
    let output = child.wait_with_output().expect("the program ends");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// What was logged: step, loss and gradient, or the scores of a validation; not how long it took.
fn curve(folder: &Path, run: &str) -> Vec<String> {
    let Ok(text) = std::fs::read_to_string(folder.join(run).join("metrics.jsonl")) else { return Vec::new() };
    let complete = text.lines().filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    complete
        .map(|mut line| {
            line.as_object_mut().expect("an object a line").remove("seconds_per_step");
            line.to_string()
        })
        .collect()
}

#[test]
fn a_killed_run_goes_on_to_the_same_end() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("run.toml"), CONFIG).unwrap();
    finish(start(folder, "whole"));
    let whole = curve(folder, "whole");
    assert_eq!(whole.len(), 24 + 1, "{whole:?}");

    // Killed twice, wherever it happens to be, at least once after a checkpoint.
    for least in [5, 13] {
        let mut child = start(folder, "killed");
        while curve(folder, "killed").len() < least {
            assert!(child.try_wait().unwrap().is_none(), "it ended before it could be killed");
            std::thread::sleep(Duration::from_millis(2));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(folder.join("killed/checkpoint.safetensors").is_file());
        assert!(curve(folder, "killed").len() < whole.len(), "it ended before it could be killed");
    }
    finish(start(folder, "killed"));
    assert_eq!(curve(folder, "killed"), whole);
    let bytes = |run: &str| std::fs::read(folder.join(run).join("last.safetensors")).unwrap();
    assert!(bytes("whole") == bytes("killed"), "the weights differ");
}
