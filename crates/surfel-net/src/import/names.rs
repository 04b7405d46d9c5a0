//! Which tensor of a reference is which parameter of ours (the table of spec 2.12).
//!
//! Invariant: every parameter that a reference has is named here; those without a name are new in this network.

use super::Reference;
use super::arrange::Step;
use crate::config::{NetConfig, UnetConfig};
use surfel_core::sh;

/// Where a parameter comes from.
#[derive(Debug, PartialEq)]
pub(super) struct Origin {
    /// Name in the encoder.
    pub name: String,
    /// How it becomes ours.
    pub step: Step,
}

/// The origin of our parameter `name`.
pub(super) fn origin(name: &str, config: &NetConfig, reference: Reference) -> Option<Origin> {
    let path: Vec<&str> = name.split('.').collect();
    match path.as_slice() {
        ["cnn", rest @ ..] => cnn(rest).map(|name| same(format!("backbone.backbone.{name}"))),
        ["transformer", "layers", i, rest @ ..] => {
            layer(rest).map(|origin| origin.below(&format!("backbone.transformer.layers.{i}")))
        }
        ["coarse" | "refinement", ..] => depth(&path, config).map(|origin| origin.below("depth_predictor")),
        ["head", which, kind] => {
            let head = reference.head()?;
            let num_sh = sh::num_coefficients(config.head.sh_degree);
            match *which {
                "first" => Some(same(format!("{head}.0.{kind}"))),
                "second" => {
                    Some(Origin { name: format!("{head}.2.{kind}"), step: Step::Rows(reference.head_outputs(num_sh)) })
                }
                _ => None,
            }
        }
        _ => None,
    }
}

impl Origin {
    fn below(self, parent: &str) -> Self {
        Self { name: format!("{parent}.{}", self.name), ..self }
    }
}

fn same(name: String) -> Origin {
    Origin { name, step: Step::Same }
}

/// A norm's parameter in PyTorch's words.
fn norm(kind: &str) -> &str {
    if kind == "gamma" { "weight" } else { "bias" }
}

fn cnn(path: &[&str]) -> Option<String> {
    Some(match path {
        ["stem", kind] => format!("conv1.{kind}"),
        ["project", kind] => format!("conv2.{kind}"),
        ["blocks", i, rest @ ..] => {
            let i: usize = i.parse().ok()?;
            let inner = match rest {
                ["first", kind] => format!("conv1.{kind}"),
                ["second", kind] => format!("conv2.{kind}"),
                ["skip", kind] => format!("downsample.0.{kind}"),
                _ => return None,
            };
            format!("layer{}.{}.{inner}", i / 2 + 1, i % 2)
        }
        _ => return None,
    })
}

/// PyTorch keeps the matrix of a linear layer as outputs x inputs.
fn layer(path: &[&str]) -> Option<Origin> {
    let linear = |name: String| Some(Origin { name, step: Step::Transpose });
    let attention = |parent: &str, part: &str, kind: &str| match part {
        "query" | "key" | "value" => linear(format!("{parent}.{}_proj.{kind}", &part[..1])),
        "merge" => linear(format!("{parent}.merge.{kind}")),
        "norm" => Some(same(format!("{parent}.norm1.{}", norm(kind)))),
        _ => None,
    };
    match path {
        ["within", part, kind] => attention("self_attn", part, kind),
        ["across", part, kind] => attention("cross_attn_ffn", part, kind),
        ["widen", kind] => linear(format!("cross_attn_ffn.mlp.0.{kind}")),
        ["narrow", kind] => linear(format!("cross_attn_ffn.mlp.2.{kind}")),
        ["norm", kind] => Some(same(format!("cross_attn_ffn.norm2.{}", norm(kind)))),
        _ => None,
    }
}

fn depth(path: &[&str], config: &NetConfig) -> Option<Origin> {
    Some(match path {
        ["coarse", "enter", kind] => same(format!("corr_refine_net.0.{kind}")),
        ["coarse", "enter_norm", kind] => same(format!("corr_refine_net.1.{}", norm(kind))),
        ["coarse", "unet", rest @ ..] => unet(rest, &config.cost_volume.as_ref()?.unet)?.below("corr_refine_net.3"),
        ["coarse", "leave", kind] => same(format!("corr_refine_net.4.{kind}")),
        ["coarse", "residual", kind] => same(format!("regressor_residual.{kind}")),
        ["coarse", "head", i, kind] => same(format!("depth_head_lowres.{}.{kind}", 2 * i.parse::<usize>().ok()?)),
        ["refinement", "upsampler", kind] => same(format!("upsampler.0.{kind}")),
        ["refinement", "project", kind] => same(format!("proj_feature.{kind}")),
        ["refinement", "enter", kind] => same(format!("refine_unet.0.{kind}")),
        ["refinement", "enter_norm", kind] => same(format!("refine_unet.1.{}", norm(kind))),
        ["refinement", "unet", rest @ ..] => unet(rest, &config.refinement.unet)?.below("refine_unet.3"),
        ["refinement", "to_disparity", i, kind] => {
            same(format!("to_disparity.{}.{kind}", 2 * i.parse::<usize>().ok()?))
        }
        _ => return None,
    })
}

/// Theirs counts every block of the way down and up; Down and Up layers are blocks or the last part of one.
fn unet(path: &[&str], config: &UnetConfig) -> Option<Origin> {
    let number = |text: &str| text.parse::<usize>().ok();
    let attends = |level: usize| config.attention_at.contains(&(1 << level));
    let levels = config.multipliers.len();
    Some(match path {
        ["enter", kind] => same(format!("input_blocks.0.0.{kind}")),
        ["down", i, rest @ ..] => step(rest)?.below(&format!("input_blocks.{}", 1 + 2 * number(i)?)),
        ["shrink", i, kind] => same(format!("input_blocks.{}.0.op.{kind}", 2 + 2 * number(i)?)),
        ["middle", i, rest @ ..] => residual(rest)?.below(&format!("middle_block.{}", 2 * number(i)?)),
        ["up", i, rest @ ..] => step(rest)?.below(&format!("output_blocks.{i}")),
        ["grow", i, kind] => {
            let i = number(i)?;
            let slot = if attends(levels - 1 - i) { 2 } else { 1 };
            same(format!("output_blocks.{}.{slot}.conv.{kind}", 2 * i + 1))
        }
        ["leave", kind] => same(format!("out.0.{kind}")),
        ["leave_norm", kind] => same(format!("out.1.{}", norm(kind))),
        _ => return None,
    })
}

/// A residual block and its attention.
fn step(path: &[&str]) -> Option<Origin> {
    // Theirs are one-dimensional convolutions over all pixels.
    let flat = |name: &str, kind: &str| {
        let step = if kind == "weight" { Step::AppendOne } else { Step::Same };
        Origin { name: format!("1.{name}.{kind}"), step }
    };
    match path {
        ["block", rest @ ..] => Some(residual(rest)?.below("0")),
        ["attention", "project", kind] => Some(flat("qkv", kind)),
        ["attention", "merge", kind] => Some(flat("proj_out", kind)),
        ["attention", "norm", kind] => Some(same(format!("1.norm.{}", norm(kind)))),
        _ => None,
    }
}

fn residual(path: &[&str]) -> Option<Origin> {
    Some(same(match path {
        ["first", kind] => format!("in_layers.0.{kind}"),
        ["first_norm", kind] => format!("in_layers.1.{}", norm(kind)),
        ["second", kind] => format!("out_layers.0.{kind}"),
        ["second_norm", kind] => format!("out_layers.1.{}", norm(kind)),
        ["skip", kind] => format!("skip_connection.{kind}"),
        _ => return None,
    }))
}
