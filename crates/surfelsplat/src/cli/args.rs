//! What can be typed. Each flag's text is its documentation; values are checked here, files are not opened.

use super::device::{DeviceArg, DeviceArgs};
use super::eval::EvalCommand;
use super::synth::SynthCommand;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;
use surfel_io::FormatKind;
use surfelsplat::reconstruct::options::Axes;

/// Turn two (or more) posed photographs into a surface.
#[derive(Debug, Parser)]
#[command(name = "surfelsplat", version, propagate_version = true, arg_required_else_help = true)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,

    /// Print one JSON document on stdout instead of sentences.
    #[arg(long, global = true)]
    pub json: bool,

    /// Say nothing but errors.
    #[arg(short, long, global = true)]
    pub quiet: bool,

    /// Number of threads (default: all cores).
    #[arg(long, global = true, value_name = "N", value_parser = positive)]
    pub threads: Option<usize>,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Reconstruct a coloured mesh from posed photographs.
    Reconstruct(ReconstructArgs),
    /// Say what a scene holds and whether its cameras fit its photographs.
    Inspect(InspectArgs),
    /// Train a network, or go on training it.
    Train(TrainArgs),
    /// Check and time the network's operators on a device against the CPU.
    Device(DeviceArgs),
    /// Score results against references; the paper's experiments.
    Eval {
        #[command(subcommand)]
        command: EvalCommand,
    },
    /// Look into the network's weights, check them, or make them from other people's.
    Weights {
        #[command(subcommand)]
        command: WeightsCommand,
    },
    /// Draw, check and write rendered scenes with exact depth, normals and surfaces.
    Synth {
        #[command(subcommand)]
        command: SynthCommand,
    },
}

#[derive(Debug, Subcommand)]
pub enum WeightsCommand {
    /// Say what a file of weights holds: network, licence, data, training, tensors.
    Info(WeightsInfoArgs),
    /// Check a file of weights against its own description: every shape, every value, the checksum.
    Verify(WeightsFileArgs),
    /// Make weights from a checkpoint of SurfelSplat, MVSplat or UniMatch.
    Import(WeightsImportArgs),
    /// Write trained weights again, small and with their licence, data and training log.
    Pack(WeightsPackArgs),
}

/// How depth is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DepthMethod {
    /// Plane sweep and refinement; needs no training.
    Matching,
    /// Matching, refined by the trained network, and the network's surfels.
    Network,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  surfelsplat reconstruct my_scene -o out                     the best two photographs
  surfelsplat reconstruct my_scene --views 23,24 -o out       these two
  surfelsplat reconstruct my_scene --num-views 4 -o out       the best four
  surfelsplat reconstruct colmap/sparse/0 --size 640x480 -o out

Writes into OUT: mesh.ply, mesh.glb, surfels.ply, depth/, normal/, confidence/, cameras.json,
preview.png and report.json. Exit code 0: done; 1: failed, nothing written; 2: wrong usage.")]
pub struct ReconstructArgs {
    /// Scene folder or camera file: COLMAP, transforms.json, cameras.npz, cam.txt, ... (`inspect` lists them).
    pub scene: PathBuf,

    /// Folder to write into.
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,

    /// Photographs to use, by name, stem or number, separated by commas (default: the best pair).
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    pub views: Vec<String>,

    /// How many photographs to choose when --views names none.
    #[arg(long, value_name = "N", default_value_t = 2, conflicts_with = "views", value_parser = at_least_two)]
    pub num_views: usize,

    /// Working width x height in pixels (default: the photograph's shape, at most about 640x512 pixels).
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<(usize, usize)>,

    /// How depth is found.
    #[arg(long, value_enum, default_value_t = DepthMethod::Network)]
    pub depth: DepthMethod,

    /// Weights of the network (default: those that ship with the program).
    #[arg(long, value_name = "FILE")]
    pub weights: Option<PathBuf>,

    /// DINOv2 weights, for a network that adds their features (docs/dino.md).
    #[arg(long, value_name = "FILE", requires = "weights")]
    pub dino: Option<PathBuf>,

    #[command(flatten)]
    pub device: DeviceArg,

    /// Nearest depth to search, in the unit of the cameras (default: from the data).
    #[arg(long, value_name = "Z", value_parser = positive_length)]
    pub near: Option<f64>,

    /// Farthest depth to search, in the unit of the cameras (default: from the data).
    #[arg(long, value_name = "Z", value_parser = positive_length)]
    pub far: Option<f64>,

    /// Voxel edge of the mesh, in the unit of the cameras (default: from the pixel footprint).
    #[arg(long, value_name = "LENGTH", value_parser = positive_length)]
    pub voxel: Option<f64>,

    /// Keep at most this many connected components of the mesh.
    #[arg(long, value_name = "N", value_parser = positive)]
    pub keep_components: Option<usize>,

    /// Format of the cameras (default: detected).
    #[arg(long, value_name = "FORMAT", value_parser = format_names())]
    pub format: Option<FormatKind>,

    /// Axes of the cameras, when the file breaks the convention of its format (`inspect` says so).
    #[arg(long, value_name = "AXES", value_parser = axes_names())]
    pub axes: Option<Axes>,

    /// Take the cameras as they are: go on although the photographs contradict them, and turn none of them.
    #[arg(long)]
    pub trust_cameras: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  surfelsplat train crates/surfel-train/configs/small_stage1.toml --assets assets -o runs/small --cache runs/samples

Writes into OUT: checkpoint.safetensors (to go on from), last.safetensors and best.safetensors (weights),
metrics.jsonl. The same command after an interruption goes on where the last checkpoint was written.")]
pub struct TrainArgs {
    /// Configuration of the run.
    pub config: PathBuf,

    /// Folder of the run.
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,

    /// Folder of scans, textures and light maps (index.json, split.json, meshes/, textures/, envmaps/).
    #[arg(long, value_name = "DIR")]
    pub assets: Option<PathBuf>,

    /// Folder that keeps rendered and matched samples for later epochs and runs (about 3 MB each at 208x160).
    #[arg(long, value_name = "DIR")]
    pub cache: Option<PathBuf>,

    /// Weights to start from (default: fresh ones).
    #[arg(long, value_name = "FILE")]
    pub initial: Option<PathBuf>,

    /// Weights of LPIPS for the perceptual term (default: `1 - SSIM` instead; docs/lpips.md says how to make them).
    #[arg(long, value_name = "FILE")]
    pub lpips: Option<PathBuf>,

    #[command(flatten)]
    pub device: DeviceArg,

    /// Stop after this many steps (default: those of the configuration).
    #[arg(long, value_name = "N")]
    pub steps: Option<u64>,

    /// Only make the samples, do not train.
    #[arg(long, requires = "cache")]
    pub prepare: bool,
}

#[derive(Debug, Args)]
pub struct InspectArgs {
    /// Scene folder or camera file.
    pub scene: PathBuf,

    /// Two photographs to check against each other (default: the best pair).
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    pub views: Vec<String>,

    /// Picture of the two photographs with matches and epipolar lines.
    #[arg(short, long, value_name = "PNG", default_value = "epipolar.png")]
    pub output: PathBuf,

    /// Format of the cameras (default: detected).
    #[arg(long, value_name = "FORMAT", value_parser = format_names())]
    pub format: Option<FormatKind>,

    /// Axes of the cameras, when the file breaks the convention of its format (`inspect` says so).
    #[arg(long, value_name = "AXES", value_parser = axes_names())]
    pub axes: Option<Axes>,
}

#[derive(Debug, Args)]
pub struct WeightsFileArgs {
    /// The file: .safetensors, or for `info` also .pth, .pt or .ckpt.
    pub file: PathBuf,
}

#[derive(Debug, Args)]
pub struct WeightsInfoArgs {
    #[command(flatten)]
    pub file: WeightsFileArgs,

    /// Also count what the network multiplies for two photographs of 320x256; runs it once.
    #[arg(long)]
    pub cost: bool,
}

#[derive(Debug, Args)]
pub struct WeightsPackArgs {
    /// Weights of this program, as `train` writes them.
    pub file: PathBuf,

    /// File to write.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,

    /// How values are stored.
    #[arg(long, value_enum, default_value_t = WeightPrecision::F16)]
    pub precision: WeightPrecision,

    /// Settings of the network, where they are to differ from those of the file in what has no weights.
    #[arg(long, value_name = "TOML")]
    pub config: Option<PathBuf>,

    /// Under which terms the weights may be used.
    #[arg(long, value_name = "TEXT")]
    pub licence: Option<String>,

    /// Text file that says what they were trained on.
    #[arg(long, value_name = "FILE")]
    pub data: Option<PathBuf>,

    /// Text file that says how they were trained.
    #[arg(long, value_name = "FILE")]
    pub training: Option<PathBuf>,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  surfelsplat weights import re10k.ckpt -o mvsplat.safetensors
  surfelsplat weights import gmdepth.pth --preset paper --precision f16 -o start.safetensors

Whatever the source does not have stays at its fresh start; the report says what. PyTorch files are read
without running anything in them.")]
pub struct WeightsImportArgs {
    /// The checkpoint: .ckpt, .pth or .safetensors.
    pub source: PathBuf,

    /// File to write.
    #[arg(short, long, value_name = "OUT.safetensors")]
    pub output: PathBuf,

    /// The network to fill.
    #[arg(long, value_enum, default_value_t = NetPreset::Paper)]
    pub preset: NetPreset,

    /// Configuration of the network to fill, instead of a preset.
    #[arg(long, value_name = "TOML", conflicts_with = "preset")]
    pub config: Option<PathBuf>,

    /// How values are stored.
    #[arg(long, value_enum, default_value_t = WeightPrecision::F32)]
    pub precision: WeightPrecision,

    /// Licence of the source, for the header.
    #[arg(long, value_name = "TEXT")]
    pub licence: Option<String>,
}

/// A shipped network configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum NetPreset {
    /// As the paper describes it.
    Paper,
    /// The one that ships: matching's depth, refined.
    Small,
    /// The paper's graph, narrow and on pretrained features.
    Narrow,
    /// For tests.
    Tiny,
}

/// Bits per weight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum WeightPrecision {
    /// 16 bits, for weights that are only used.
    F16,
    /// 32 bits, for weights that are trained on.
    F32,
}

fn format_names() -> impl TypedValueParser<Value = FormatKind> {
    let names = PossibleValuesParser::new(FormatKind::ALL.map(FormatKind::name));
    // Clap has already refused every other name.
    names.map(|name| FormatKind::ALL.into_iter().find(|kind| kind.name() == name).unwrap_or(FormatKind::Colmap))
}

fn axes_names() -> impl TypedValueParser<Value = Axes> {
    let names = PossibleValuesParser::new(Axes::ALL.map(Axes::name));
    // Clap has already refused every other name.
    names.map(|name| Axes::ALL.into_iter().find(|axes| axes.name() == name).unwrap_or(Axes::OpenGl))
}

pub fn positive(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&n| n > 0).ok_or_else(|| "must be a whole number above 0".to_owned())
}

fn at_least_two(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&n| n >= 2).ok_or_else(|| "must be a whole number of at least 2".to_owned())
}

pub fn positive_length(text: &str) -> Result<f64, String> {
    let value: Option<f64> = text.parse().ok();
    value.filter(|v| v.is_finite() && *v > 0.0).ok_or_else(|| "must be a number above 0".to_owned())
}

pub fn parse_size(text: &str) -> Result<(usize, usize), String> {
    let wrong = || "must be width x height, such as 320x256".to_owned();
    let (width, height) = text.split_once(['x', 'X', '×']).ok_or_else(wrong)?;
    match (width.trim().parse(), height.trim().parse()) {
        (Ok(width), Ok(height)) if width > 0 && height > 0 && width <= 16_384 && height <= 16_384 => {
            Ok((width, height))
        }
        _ => Err(wrong()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn sizes() {
        assert_eq!(parse_size("320x256"), Ok((320, 256)));
        assert!(parse_size("320").is_err() && parse_size("0x4").is_err() && parse_size("-1x4").is_err());
    }
}
