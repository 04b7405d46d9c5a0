//! Every tensor that the reference checkpoints hold, with its shape, written out from spec 2.10 and 2.12.
//!
//! Independent of the import: lists what a file contains, not what becomes of it.

pub type Names = Vec<(String, Vec<usize>)>;

/// The sizes in which the references differ from each other.
#[derive(Clone, Debug)]
pub struct Widths {
    /// Channels of the backbone's stages and its output.
    pub cnn: [usize; 3],
    pub candidates: usize,
    pub cost: Unet,
    pub refine: Unet,
}

#[derive(Clone, Debug)]
pub struct Unet {
    pub channels: usize,
    pub multipliers: Vec<usize>,
    pub attention_at: Vec<usize>,
}

impl Widths {
    pub fn mvsplat() -> Self {
        Self {
            cnn: [64, 96, 128],
            candidates: 128,
            cost: Unet { channels: 128, multipliers: vec![1, 1, 1], attention_at: vec![4] },
            refine: Unet { channels: 32, multipliers: vec![1; 5], attention_at: vec![16] },
        }
    }

    /// The release's structure with fewer channels.
    pub fn narrow_release() -> Self {
        Self {
            cnn: [8, 12, 16],
            candidates: 20,
            cost: Unet { channels: 16, multipliers: vec![1, 2, 2], attention_at: vec![4, 8] },
            refine: Unet { channels: 16, multipliers: vec![1, 1, 2, 2, 2], attention_at: vec![8, 16] },
        }
    }
}

fn push(names: &mut Names, name: impl Into<String>, shape: &[usize]) {
    names.push((name.into(), shape.to_vec()));
}

fn both(names: &mut Names, name: &str, shape: &[usize]) {
    push(names, format!("{name}.weight"), shape);
    push(names, format!("{name}.bias"), &shape[..1]);
}

/// `backbone.*` and `transformer.*`: 115 tensors.
pub fn trunk(widths: &Widths) -> Names {
    let [stem, middle, c] = widths.cnn;
    let mut names = Names::new();
    push(&mut names, "backbone.conv1.weight", &[stem, 3, 7, 7]);
    for (layer, inputs, outputs) in [(1, stem, stem), (2, stem, middle), (3, middle, c)] {
        for block in 0..2 {
            let inputs = if block == 0 { inputs } else { outputs };
            push(&mut names, format!("backbone.layer{layer}.{block}.conv1.weight"), &[outputs, inputs, 3, 3]);
            push(&mut names, format!("backbone.layer{layer}.{block}.conv2.weight"), &[outputs, outputs, 3, 3]);
        }
        if layer > 1 {
            both(&mut names, &format!("backbone.layer{layer}.0.downsample.0"), &[outputs, inputs, 1, 1]);
        }
    }
    both(&mut names, "backbone.conv2", &[c, c, 1, 1]);
    for i in 0..6 {
        for part in ["self_attn", "cross_attn_ffn"] {
            let part = format!("transformer.layers.{i}.{part}");
            for projection in ["q_proj", "k_proj", "v_proj", "merge"] {
                push(&mut names, format!("{part}.{projection}.weight"), &[c, c]);
            }
            both(&mut names, &format!("{part}.norm1"), &[c]);
        }
        let part = format!("transformer.layers.{i}.cross_attn_ffn");
        push(&mut names, format!("{part}.mlp.0.weight"), &[8 * c, 2 * c]);
        push(&mut names, format!("{part}.mlp.2.weight"), &[c, 8 * c]);
        both(&mut names, &format!("{part}.norm2"), &[c]);
    }
    names
}

fn residual(names: &mut Names, at: &str, inputs: usize, outputs: usize) {
    both(names, &format!("{at}.in_layers.0"), &[outputs, inputs, 3, 3]);
    both(names, &format!("{at}.in_layers.1"), &[outputs]);
    both(names, &format!("{at}.out_layers.0"), &[outputs, outputs, 3, 3]);
    both(names, &format!("{at}.out_layers.1"), &[outputs]);
    if inputs != outputs {
        both(names, &format!("{at}.skip_connection"), &[outputs, inputs, 1, 1]);
    }
}

fn attention(names: &mut Names, at: &str, c: usize) {
    both(names, &format!("{at}.qkv"), &[3 * c, c, 1]);
    both(names, &format!("{at}.proj_out"), &[c, c, 1]);
    both(names, &format!("{at}.norm"), &[c]);
}

fn unet(names: &mut Names, at: &str, unet: &Unet) {
    let base = unet.channels;
    let widths: Vec<usize> = unet.multipliers.iter().map(|m| m * base).collect();
    let attends = |level: usize| unet.attention_at.contains(&(1 << level));
    both(names, &format!("{at}.input_blocks.0.0"), &[base, base, 3, 3]);
    let (mut skips, mut c, mut block) = (vec![base], base, 1);
    for (level, &width) in widths.iter().enumerate() {
        residual(names, &format!("{at}.input_blocks.{block}.0"), c, width);
        if attends(level) {
            attention(names, &format!("{at}.input_blocks.{block}.1"), width);
        }
        c = width;
        skips.push(c);
        block += 1;
        if level + 1 < widths.len() {
            both(names, &format!("{at}.input_blocks.{block}.0.op"), &[c, c, 3, 3]);
            skips.push(c);
            block += 1;
        }
    }
    residual(names, &format!("{at}.middle_block.0"), c, c);
    residual(names, &format!("{at}.middle_block.2"), c, c);
    let mut block = 0;
    for level in (0..widths.len()).rev() {
        for second in [false, true] {
            residual(names, &format!("{at}.output_blocks.{block}.0"), c + skips.pop().unwrap(), widths[level]);
            c = widths[level];
            if attends(level) {
                attention(names, &format!("{at}.output_blocks.{block}.1"), c);
            }
            if second && level > 0 {
                let slot = if attends(level) { 2 } else { 1 };
                both(names, &format!("{at}.output_blocks.{block}.{slot}.conv"), &[c, c, 3, 3]);
            }
            block += 1;
        }
    }
    both(names, &format!("{at}.out.0"), &[base, c, 3, 3]);
    both(names, &format!("{at}.out.1"), &[base]);
}

/// `depth_predictor.*` without heads.
fn depth(widths: &Widths) -> Names {
    let (c, d, u, r) = (widths.cnn[2], widths.candidates, widths.cost.channels, widths.refine.channels);
    let mut names = Names::new();
    both(&mut names, "corr_refine_net.0", &[u, d + c, 3, 3]);
    both(&mut names, "corr_refine_net.1", &[u]);
    unet(&mut names, "corr_refine_net.3", &widths.cost);
    both(&mut names, "corr_refine_net.4", &[d, u, 3, 3]);
    both(&mut names, "regressor_residual", &[d, d + c, 1, 1]);
    both(&mut names, "depth_head_lowres.0", &[2 * d, d, 3, 3]);
    both(&mut names, "depth_head_lowres.2", &[d, 2 * d, 3, 3]);
    both(&mut names, "upsampler.0", &[c, 2 * c, 3, 3]);
    both(&mut names, "proj_feature", &[r, c, 3, 3]);
    both(&mut names, "refine_unet.0", &[r, r + 5, 3, 3]);
    both(&mut names, "refine_unet.1", &[r]);
    unet(&mut names, "refine_unet.3", &widths.refine);
    both(&mut names, "to_disparity.0", &[2 * r, r, 3, 3]);
    both(&mut names, "to_disparity.2", &[2, 2 * r, 3, 3]);
    names.into_iter().map(|(name, shape)| (format!("depth_predictor.{name}"), shape)).collect()
}

fn head(names: &mut Names, at: &str, features: usize, outputs: usize) {
    both(names, &format!("{at}.0"), &[2 * outputs, features, 3, 3]);
    both(names, &format!("{at}.2"), &[outputs, 2 * outputs, 3, 3]);
}

fn in_encoder(names: Names) -> Names {
    names.into_iter().map(|(name, shape)| (format!("encoder.{name}"), shape)).collect()
}

fn trunk_in_encoder(widths: &Widths) -> Names {
    trunk(widths).into_iter().map(|(name, shape)| (format!("backbone.{name}"), shape)).collect()
}

/// An MVSplat checkpoint.
pub fn mvsplat(widths: &Widths) -> Names {
    let mut names = [trunk_in_encoder(widths), depth(widths)].concat();
    head(&mut names, "depth_predictor.to_gaussians", widths.refine.channels + widths.cnn[2] + 3, 84);
    in_encoder(names)
}

/// A checkpoint of the release, without DINO and the copy of the head; foreign branches in miniature.
pub fn release(widths: &Widths) -> Names {
    let mut names = [trunk_in_encoder(widths), depth(widths)].concat();
    let features = widths.refine.channels + widths.cnn[2] + 3;
    head(&mut names, "depth_predictor.to_gaussian.head", features, 83);
    head(&mut names, "depth_predictor.to_gaussians", features, 83);
    let mono =
        |names: &mut Names, name: String| both(names, &format!("depth_predictor.monocular_depth_head.{name}"), &[2, 2]);
    [0, 1, 3, 4, 6, 7, 9, 10].iter().for_each(|i| mono(&mut names, format!("feature_extraction.{i}")));
    for stage in 1..4 {
        for conv in ["conv.0", "conv.1", "post_conv.0", "post_conv.1"] {
            mono(&mut names, format!("upsample{stage}.{conv}"));
        }
        for block in 0..[3, 4, 3][stage - 1] {
            for part in ["conv1", "norm1", "conv2", "norm2"] {
                mono(&mut names, format!("residual{stage}.{block}.{part}"));
            }
        }
    }
    ["qkv", "proj", "norm"].iter().for_each(|part| mono(&mut names, format!("attention.{part}")));
    [0, 1, 3, 4, 6, 7, 9, 10, 12, 14, 16, 18].iter().for_each(|i| mono(&mut names, format!("final_refinement.{i}")));
    for part in [
        "normal_query_proj",
        "normal_key_proj",
        "normal_value_proj",
        "normal_output_proj",
        "img_proj",
        "refined_normal_k_proj",
        "refined_normal_v_proj",
        "cross_output_proj",
        "final_proj",
        "norm1",
        "norm2",
        "norm3",
        "ffn.0",
        "ffn.2",
        "upsampler.0",
    ] {
        both(&mut names, &format!("feature_aggregation.{part}"), &[2, 2]);
    }
    in_encoder(names)
}

fn count(names: &Names, prefix: &str) -> usize {
    let of = names.iter().filter(|(name, _)| name.starts_with(prefix));
    of.map(|(_, shape)| shape.iter().product::<usize>()).sum()
}

/// The lists are right if they give the numbers of spec 2.10 and 2.12.
#[test]
fn the_lists_have_the_numbers_of_the_specification() {
    assert_eq!(release(&Widths::narrow_release()).len(), 677);
    let names = mvsplat(&Widths::mvsplat());
    let of = |prefix: &str| count(&names, &format!("encoder.{prefix}"));
    assert_eq!(of("backbone.backbone"), 1_049_120);
    assert_eq!(of("backbone.transformer"), 3_150_336);
    assert_eq!(of("depth_predictor.corr_refine_net"), 5_862_144);
    assert_eq!(of("depth_predictor.regressor_residual"), 32_896);
    assert_eq!(of("depth_predictor.depth_head_lowres"), 590_208);
    assert_eq!(of("depth_predictor.upsampler"), 295_040);
    assert_eq!(of("depth_predictor.proj_feature"), 36_896);
    assert_eq!(of("depth_predictor.refine_unet"), 545_728);
    assert_eq!(of("depth_predictor.to_disparity"), 19_650);
    assert_eq!(trunk(&Widths::mvsplat()).len(), 115);
}
