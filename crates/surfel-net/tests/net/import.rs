//! Reference checkpoints of every name and shape, made up here, and what our network takes from them.

use crate::reference_names::{Names, Widths, mvsplat, release, trunk};
use burn::tensor::Device;
use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use surfel_net::config::EpipolarConfig;
use surfel_net::import::{ImportError, ImportReport, Reference, Source, import};
use surfel_net::{NetConfig, Preset, SurfelNet, checkpoint};
use surfel_torch::{Object, Tensor};

/// A value that tells where it came from: small, and different for every tensor and place.
fn value(name: &str, index: usize) -> f32 {
    let seed = name.bytes().fold(17u32, |hash, byte| hash.wrapping_mul(31).wrapping_add(u32::from(byte)));
    let mixed = seed.wrapping_add(index as u32).wrapping_mul(2_654_435_761);
    (mixed >> 8) as f32 / (1 << 24) as f32 - 0.5
}

fn values(name: &str, shape: &[usize]) -> Vec<f32> {
    (0..shape.iter().product()).map(|index| value(name, index)).collect()
}

fn write_ckpt(path: &Path, root: &str, names: &Names) {
    let tensor = |(name, shape): &(String, Vec<usize>)| {
        (name.clone(), Object::Tensor(Tensor::from_f32(shape.clone(), &values(name, shape))))
    };
    let tensors = Object::Dict(names.iter().map(tensor).collect());
    let object = Object::Dict(vec![("epoch".to_owned(), Object::Int(3)), (root.to_owned(), tensors)]);
    surfel_torch::write(&object, std::io::BufWriter::new(File::create(path).unwrap())).unwrap();
}

fn write_safetensors(path: &Path, names: &Names) {
    let bytes =
        |(name, shape): &(String, Vec<usize>)| values(name, shape).iter().flat_map(|v| v.to_le_bytes()).collect();
    let data: Vec<Vec<u8>> = names.iter().map(bytes).collect();
    let view = |i: usize| {
        let view = safetensors::tensor::TensorView::new(safetensors::Dtype::F32, names[i].1.clone(), &data[i]);
        (names[i].0.as_str(), view.unwrap())
    };
    std::fs::write(path, safetensors::serialize((0..names.len()).map(view), None).unwrap()).unwrap();
}

fn run(path: &Path, config: NetConfig) -> Result<(SurfelNet, ImportReport), ImportError> {
    import(&mut Source::open(path)?, config, &Device::flex())
}

/// Shapes and values of a network by name, as it is saved.
fn saved(net: &SurfelNet, folder: &Path) -> BTreeMap<String, (Vec<usize>, Vec<f32>)> {
    let path = folder.join("ours.safetensors");
    checkpoint::save(net, &path).unwrap();
    let bytes = std::fs::read(path).unwrap();
    let tensors = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let floats = |data: &[u8]| data.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    tensors.iter().map(|(name, view)| (name.to_owned(), (view.shape().to_vec(), floats(view.data())))).collect()
}

fn transposed(name: &str, rows: usize, columns: usize) -> Vec<f32> {
    (0..columns * rows).map(|i| value(name, (i % rows) * columns + i / rows)).collect()
}

/// The preset with the widths of a reference.
fn config_of(widths: &Widths) -> NetConfig {
    let list = |values: &[usize]| format!("{values:?}");
    let unet = |unet: &crate::reference_names::Unet| {
        let (multipliers, attention) = (list(&unet.multipliers), list(&unet.attention_at));
        format!("unet = {{ channels = {}, multipliers = {multipliers}, attention_at = {attention} }}", unet.channels)
    };
    let [stem, middle, c] = widths.cnn;
    let text = include_str!("../../presets/paper.toml")
        .replace("channels = 128\nwidths = [64, 96]", &format!("channels = {c}\nwidths = [{stem}, {middle}]"))
        .replace("num_candidates = 128", &format!("num_candidates = {}", widths.candidates))
        .replace("unet = { channels = 128, multipliers = [1, 1, 1], attention_at = [4] }", &unet(&widths.cost))
        .replace("upsampled_channels = 128", &format!("upsampled_channels = {c}"))
        .replace("unet = { channels = 32, multipliers = [1, 1, 1, 1, 1], attention_at = [16] }", &unet(&widths.refine));
    NetConfig::from_toml(&text).unwrap()
}

#[test]
fn a_whole_mvsplat_checkpoint_becomes_the_paper_network() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("re10k.ckpt");
    let names = mvsplat(&Widths::mvsplat());
    write_ckpt(&path, "state_dict", &names);
    let (net, report) = run(&path, NetConfig::preset(Preset::Paper)).unwrap();
    assert_eq!(report.reference, Reference::MvSplat);
    assert_eq!(report.left, []);
    assert_eq!(report.taken.len(), names.len());
    assert!(report.missing.iter().all(|name| name.starts_with("aggregation.")), "{:?}", report.missing);
    assert_eq!(report.missing.len(), 18);
    let head = &net.config().head;
    assert_eq!((head.hidden_channels, head.scale_min, head.scale_max), (Some(168), 0.5, 15.0));

    let ours = saved(&net, folder.path());
    let get = |name: &str| ours[name].1.clone();
    let same = |name: &str, theirs: &str| assert_eq!(get(name), values(theirs, &ours[name].0), "{name}");
    same("cnn.stem.weight", "encoder.backbone.backbone.conv1.weight");
    same("cnn.blocks.3.second.weight", "encoder.backbone.backbone.layer2.1.conv2.weight");
    same("cnn.blocks.4.skip.bias", "encoder.backbone.backbone.layer3.0.downsample.0.bias");
    same("transformer.layers.2.within.norm.gamma", "encoder.backbone.transformer.layers.2.self_attn.norm1.weight");
    same("transformer.layers.5.norm.beta", "encoder.backbone.transformer.layers.5.cross_attn_ffn.norm2.bias");
    let name = "encoder.backbone.transformer.layers.1.cross_attn_ffn.mlp.0.weight";
    assert_eq!(get("transformer.layers.1.widen.weight"), transposed(name, 1024, 256));
    let name = "encoder.backbone.transformer.layers.4.self_attn.k_proj.weight";
    assert_eq!(get("transformer.layers.4.within.key.weight"), transposed(name, 128, 128));
    let net_name = "encoder.depth_predictor.corr_refine_net";
    same("coarse.enter.weight", &format!("{net_name}.0.weight"));
    same("coarse.enter_norm.beta", &format!("{net_name}.1.bias"));
    same("coarse.unet.down.2.attention.project.weight", &format!("{net_name}.3.input_blocks.5.1.qkv.weight"));
    same("coarse.unet.up.1.attention.merge.weight", &format!("{net_name}.3.output_blocks.1.1.proj_out.weight"));
    same("coarse.unet.grow.0.weight", &format!("{net_name}.3.output_blocks.1.2.conv.weight"));
    same("coarse.unet.grow.1.weight", &format!("{net_name}.3.output_blocks.3.1.conv.weight"));
    same("coarse.unet.middle.1.first_norm.gamma", &format!("{net_name}.3.middle_block.2.in_layers.1.weight"));
    same("coarse.leave.bias", &format!("{net_name}.4.bias"));
    same("coarse.head.1.weight", "encoder.depth_predictor.depth_head_lowres.2.weight");
    let net_name = "encoder.depth_predictor.refine_unet.3";
    same("refinement.unet.shrink.3.weight", &format!("{net_name}.input_blocks.8.0.op.weight"));
    same("refinement.unet.up.9.block.skip.weight", &format!("{net_name}.output_blocks.9.0.skip_connection.weight"));
    same("refinement.unet.leave_norm.gamma", &format!("{net_name}.out.1.weight"));
    same("refinement.upsampler.weight", "encoder.depth_predictor.upsampler.0.weight");

    // Scales 0 and 1, the quaternion x y z w as w x y z, 16 of 25 harmonics of each colour.
    let rows: Vec<usize> =
        [2, 3, 8, 5, 6, 7].into_iter().chain((0..3).flat_map(|c| (0..16).map(move |n| 9 + 25 * c + n))).collect();
    let head = "encoder.depth_predictor.to_gaussians";
    same("head.first.weight", &format!("{head}.0.weight"));
    let bias = format!("{head}.2.bias");
    assert_eq!(get("head.second.bias"), rows.iter().map(|&row| value(&bias, row)).collect::<Vec<_>>());
    let (weight, len) = (format!("{head}.2.weight"), 168 * 9);
    let expected: Vec<f32> =
        rows.iter().flat_map(|row| values(&weight, &[84, len])[row * len..][..len].to_vec()).collect();
    assert_eq!(get("head.second.weight"), expected);

    // Disparity 1 / far + span * relative goes in, a correction in 1 / scene unit comes out.
    let (far, span, area) = (0.01f32, 0.99f32, 9);
    let (weight, bias) = ("encoder.depth_predictor.refine_unet.0.weight", "encoder.depth_predictor.refine_unet.0.bias");
    let (ours_weight, ours_bias) = (get("refinement.enter.weight"), get("refinement.enter.bias"));
    for output in [0, 31] {
        let mut absolute = value(bias, output);
        let mut relative = ours_bias[output];
        for input in 0..37 {
            for tap in 0..area {
                let at = (output * 37 + input) * area + tap;
                let x = 0.01 * (at % 83) as f32;
                relative += ours_weight[at] * x;
                absolute += value(weight, at) * if input == 35 { far + span * x } else { x };
            }
        }
        assert!((relative - absolute).abs() < 1e-4, "{relative} {absolute}");
    }
    let name = "encoder.depth_predictor.to_disparity.2.weight";
    let corrected = get("refinement.to_disparity.1.weight");
    assert!((corrected[5] * span - value(name, 5)).abs() < 1e-6);
    assert_eq!(corrected[64 * 9 + 5], value(name, 64 * 9 + 5));
}

#[test]
fn attention_along_lines_stays_fresh() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("re10k.ckpt");
    write_ckpt(&path, "state_dict", &mvsplat(&Widths::mvsplat()));
    let mut config = NetConfig::preset(Preset::Paper);
    config.transformer.as_mut().unwrap().epipolar = Some(EpipolarConfig { num_samples: 32, num_heads: 4 });
    let (_, report) = run(&path, config).unwrap();
    let (along, others): (Vec<_>, Vec<_>) = report.missing.iter().partition(|name| name.contains(".along."));
    assert_eq!((along.len(), others.len()), (6 * 8, 18));
    // Theirs of the six layers: four projections and a norm.
    assert_eq!(report.left.len(), 6 * 6);
}

#[test]
fn the_release_gives_all_but_its_monocular_and_local_parts() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("surfelsplat.ckpt");
    let widths = Widths::narrow_release();
    let mut names = release(&widths);
    let copies: Names = names.iter().filter(|(name, _)| name.contains("to_gaussian.head")).cloned().collect();
    names.extend(
        copies.into_iter().map(|(name, shape)| (name.replace("depth_predictor.to_gaussian", "gaussian_head"), shape)),
    );
    names.push(("encoder.depth_predictor.dinov2_backbone.dinov2.cls_token".to_owned(), vec![1, 1, 4]));
    names.push(("decoder.background_color".to_owned(), vec![3]));
    write_ckpt(&path, "state_dict", &names);
    let (net, report) = run(&path, config_of(&widths)).unwrap();
    assert_eq!(report.reference, Reference::SurfelSplat);
    // All of the trunk, depth and head; see the count in `reference_names`.
    assert_eq!(report.taken.len(), 677 - 150 - 30 - 4);
    assert_eq!(report.left.len(), names.len() - report.taken.len());
    let reasons = report.reasons();
    let of = |words: &str| reasons.iter().filter(|(why, _)| why.contains(words)).map(|(_, count)| count).sum::<usize>();
    assert_eq!(of("monocular"), 151);
    assert_eq!(of("inside each view"), 30);
    assert_eq!(of("never runs"), 4);
    assert_eq!(of("second copy"), 4);
    assert_eq!(of("no part of the encoder"), 1);
    assert_eq!(report.parts()["aggregation"], (0, 18));
    assert_eq!(report.parts()["head"], (4, 4));
    let head = &net.config().head;
    assert_eq!((head.hidden_channels, head.scale_min, head.scale_max), (Some(166), 0.001, 30.0));
    let ours = saved(&net, folder.path());
    let bias = "encoder.depth_predictor.to_gaussian.head.2.bias";
    let rows = [2, 3, 4, 5, 6, 7, 8, 9].map(|row| value(bias, row));
    assert_eq!(ours["head.second.bias"].1[..8], rows);
    assert_eq!(ours["head.second.bias"].1[6 + 16], value(bias, 8 + 25));
    let grow = "encoder.depth_predictor.refine_unet.3.output_blocks.3.2.conv.weight";
    assert_eq!(ours["refinement.unet.grow.1.weight"].1, values(grow, &ours["refinement.unet.grow.1.weight"].0));
    let grow = "encoder.depth_predictor.refine_unet.3.output_blocks.5.1.conv.weight";
    assert_eq!(ours["refinement.unet.grow.2.weight"].1, values(grow, &ours["refinement.unet.grow.2.weight"].0));
}

#[test]
fn other_widths_of_depth_and_head_are_left_with_their_shapes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("release.ckpt");
    let widths = Widths::narrow_release();
    write_ckpt(&path, "state_dict", &release(&widths));
    let mut narrower = config_of(&widths);
    narrower.refinement.unet.channels = 8;
    let (_, report) = run(&path, narrower).unwrap();
    let left = report.left.iter().find(|left| left.name.ends_with("refine_unet.0.weight")).unwrap();
    assert_eq!(
        left.why,
        "has shape [16, 21, 3, 3], of which no [8, 13, 3, 3] can be made that this configuration needs"
    );
    assert!(report.missing.contains(&"refinement.enter.weight".to_owned()));
    assert_eq!(report.parts()["transformer"], (96, 96));
    // A bias never comes without its weights, though its own shape fits.
    let left = report.left.iter().find(|left| left.name.ends_with("to_gaussian.head.2.bias")).unwrap();
    assert_eq!(left.why, "fits, but the rest of its layer does not");
    assert_eq!(report.parts()["head"], (0, 4));
}

#[test]
fn a_unimatch_file_gives_its_115_tensors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("gmdepth.pth");
    let mut names = trunk(&Widths::mvsplat());
    names.push(("feature_flow_attn.q_proj.weight".to_owned(), vec![4, 4]));
    write_ckpt(&path, "model", &names);
    let (net, report) = run(&path, NetConfig::preset(Preset::Paper)).unwrap();
    assert_eq!(report.reference, Reference::UniMatch);
    assert_eq!(report.taken.len(), 115);
    assert_eq!(report.left.len(), 1);
    assert_eq!(report.parts()["cnn"], (19, 19));
    assert_eq!(net.config(), &NetConfig::preset(Preset::Paper));
    let ours = saved(&net, folder.path());
    assert_eq!(ours["cnn.stem.weight"].1, values("backbone.conv1.weight", &[64, 3, 7, 7]));

    // A trunk with a hole is refused.
    names.retain(|(name, _)| name != "transformer.layers.3.cross_attn_ffn.merge.weight");
    write_ckpt(&path, "model", &names);
    let error = run(&path, NetConfig::preset(Preset::Paper)).unwrap_err().to_string();
    assert!(
        error.contains("114 of the 115") && error.contains("layers.3.cross_attn_ffn.merge.weight is missing"),
        "{error}"
    );
}

#[test]
fn safetensors_and_checkpoints_give_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let widths = Widths::narrow_release();
    let (torch, safe) = (folder.path().join("a.ckpt"), folder.path().join("a.safetensors"));
    write_ckpt(&torch, "state_dict", &mvsplat(&widths));
    write_safetensors(&safe, &mvsplat(&widths));
    let of = |path: &Path| {
        let (net, report) = run(path, config_of(&widths)).unwrap();
        let mut ours = saved(&net, folder.path());
        ours.retain(|name, _| report.taken.contains_key(name));
        (report.taken, ours)
    };
    assert_eq!(of(&torch), of(&safe));
}

#[test]
fn strangers_and_damage_are_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.pth");
    write_ckpt(&path, "state_dict", &vec![("layer.weight".to_owned(), vec![2])]);
    let error = run(&path, NetConfig::preset(Preset::Paper)).unwrap_err().to_string();
    assert!(error.contains("x.pth") && error.contains("layer.weight") && error.contains("UniMatch"), "{error}");

    write_ckpt(&path, "model", &trunk(&Widths::mvsplat()));
    let error = run(&path, NetConfig::preset(Preset::Tiny)).unwrap_err().to_string();
    assert!(error.contains("0 of the") && error.contains("preset paper"), "{error}");

    let names = trunk(&Widths::narrow_release());
    let safe = folder.path().join("x.safetensors");
    write_safetensors(&safe, &names);
    let good = std::fs::read(&safe).unwrap();
    let mut bad = good.clone();
    let at = bad.len() - 4;
    bad[at..].copy_from_slice(&f32::INFINITY.to_le_bytes());
    std::fs::write(&safe, bad).unwrap();
    let config = || config_of(&Widths::narrow_release());
    assert!(run(&safe, config()).unwrap_err().to_string().contains("not a finite number"));
    std::fs::write(&safe, &good[..good.len() - 1]).unwrap();
    assert!(run(&safe, config()).unwrap_err().to_string().contains("another length"));
    let mut lying = good.clone();
    lying[..8].copy_from_slice(&(1u64 << 40).to_le_bytes());
    std::fs::write(&safe, lying).unwrap();
    assert!(run(&safe, config()).unwrap_err().to_string().contains("its header claims"));
    assert!(run(&folder.path().join("none.pth"), config()).unwrap_err().to_string().contains("none.pth"));
}
