//! What a weights file says about itself, and whether it can be believed.

use burn::tensor::Device;
use std::path::{Path, PathBuf};
use surfel_net::checkpoint::{About, Header, Precision, save_as, verify};
use surfel_net::{CheckpointError, NetConfig, Preset, SurfelNet, checkpoint};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
}

fn tiny() -> SurfelNet {
    SurfelNet::new(NetConfig::preset(Preset::Tiny), &Device::flex()).unwrap()
}

fn header(path: &Path) -> Header {
    Header::of("net", &std::fs::read(path).unwrap()).unwrap()
}

/// All values of a file, by name.
fn values(path: &Path) -> Vec<(String, Vec<f32>)> {
    let bytes = std::fs::read(path).unwrap();
    let tensors = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let file = surfel_features::weights::TensorFile::parse("net", &bytes).unwrap();
    let mut names: Vec<String> = tensors.names().into_iter().map(str::to_owned).collect();
    names.sort();
    let values = |name: &String| file.values(name, tensors.tensor(name).unwrap().shape()).unwrap();
    names.iter().map(|name| (name.clone(), values(name))).collect()
}

#[test]
fn a_file_alone_builds_its_network() {
    let folder = Folder::new();
    let (first, second) = (folder.path("a.safetensors"), folder.path("b.safetensors"));
    let mut config = NetConfig::preset(Preset::Tiny);
    config.head.hidden_channels = Some(20);
    config.cost_volume.as_mut().unwrap().num_candidates = 18;
    let net = SurfelNet::new(config.clone(), &Device::flex()).unwrap();
    let about = About {
        licence: Some("MIT".to_owned()),
        data: Some("spheres and \"planes\"".to_owned()),
        training: Some("100 steps\nloss 0.5".to_owned()),
    };
    save_as(&net, &first, Precision::F32, &about).unwrap();
    let loaded = SurfelNet::from_file(&first, &Device::flex()).unwrap();
    assert_eq!(loaded.config(), &config);
    assert_eq!(header(&first).about, about);
    save_as(&loaded, &second, Precision::F32, &about).unwrap();
    assert_eq!(std::fs::read(&first).unwrap(), std::fs::read(&second).unwrap(), "the same weights, other bytes");
}

#[test]
fn every_preset_survives_its_own_toml() {
    for preset in [Preset::Paper, Preset::Small, Preset::Tiny] {
        let config = NetConfig::preset(preset);
        assert_eq!(NetConfig::from_toml(&config.to_toml()).unwrap(), config);
    }
}

#[test]
fn half_precision_halves_the_file_and_rounds() {
    let folder = Folder::new();
    let (full, half) = (folder.path("full.safetensors"), folder.path("half.safetensors"));
    let net = tiny();
    checkpoint::save(&net, &full).unwrap();
    save_as(&net, &half, Precision::F16, &About::default()).unwrap();
    let size = |path: &Path| std::fs::metadata(path).unwrap().len() as f64;
    assert!(size(&half) < 0.6 * size(&full));
    for ((name, full), (_, half)) in values(&full).iter().zip(&values(&half)) {
        let close = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-3 * a.abs() + 1e-7;
        assert!(full.iter().zip(half).all(close), "{name}");
    }
    assert!(SurfelNet::from_file(&half, &Device::flex()).is_ok());
    assert!(verify(&half).unwrap().faults.is_empty());
}

#[test]
fn a_good_file_is_good() {
    let folder = Folder::new();
    let path = folder.path("net.safetensors");
    let net = tiny();
    checkpoint::save(&net, &path).unwrap();
    let verification = verify(&path).unwrap();
    assert_eq!(verification.faults, [""; 0]);
    assert!(verification.has_checksum);
    assert_eq!(verification.num_parameters, net.parts().iter().map(|(_, count)| count).sum::<usize>());
}

#[test]
fn damage_is_found_and_named() {
    let folder = Folder::new();
    let path = folder.path("net.safetensors");
    checkpoint::save(&tiny(), &path).unwrap();
    let good = std::fs::read(&path).unwrap();

    // One bit of one value.
    let mut flipped = good.clone();
    *flipped.last_mut().unwrap() ^= 1;
    std::fs::write(&path, flipped).unwrap();
    let faults = verify(&path).unwrap().faults;
    assert!(faults.len() == 1 && faults[0].contains("checksum"), "{faults:?}");
    let error = SurfelNet::from_file(&path, &Device::flex()).unwrap_err();
    assert!(error.to_string().contains("checksum"), "{error}");

    // The last value is not a number.
    let mut poisoned = good.clone();
    let at = poisoned.len() - 4;
    poisoned[at..].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(&path, poisoned).unwrap();
    let faults = verify(&path).unwrap().faults;
    assert!(faults.len() == 2 && faults[1].contains("not a finite number"), "{faults:?}");

    // Another configuration in the header than the tensors have; same length, so that the file stays whole.
    let text = b"num_candidates = 16";
    let at = good.windows(text.len()).position(|window| window == text).unwrap();
    let mut other = good.clone();
    other[at..][..text.len()].copy_from_slice(b"num_candidates = 18");
    std::fs::write(&path, other).unwrap();
    let faults = verify(&path).unwrap().faults;
    assert!(faults.iter().any(|fault| fault.contains("has shape")), "{faults:?}");

    // A name that the network does not have, and so one that it misses.
    let text = b"\"head.first.bias\"";
    let at = good.windows(text.len()).position(|window| window == text).unwrap();
    let mut renamed = good.clone();
    renamed[at..][..text.len()].copy_from_slice(b"\"head.third.bias\"");
    std::fs::write(&path, renamed).unwrap();
    let faults = verify(&path).unwrap().faults.join("\n");
    assert!(faults.contains("no tensor named head.first.bias"), "{faults}");
    assert!(faults.contains("holds head.third.bias, which its network does not have"), "{faults}");

    std::fs::write(&path, &good[..good.len() - 10]).unwrap();
    assert!(verify(&path).unwrap_err().to_string().contains("not a complete safetensors file"));
}

#[test]
fn a_file_of_another_program_has_no_configuration() {
    let folder = Folder::new();
    let path = folder.path("x.safetensors");
    let view = safetensors::tensor::TensorView::new(safetensors::Dtype::U8, vec![1], &[1]).unwrap();
    std::fs::write(&path, safetensors::serialize([("x", view)], None).unwrap()).unwrap();
    assert!(matches!(SurfelNet::from_file(&path, &Device::flex()), Err(CheckpointError::NoConfig { .. })));
    assert!(matches!(verify(&path), Err(CheckpointError::NoConfig { .. })));
    let missing = SurfelNet::from_file(folder.path("none"), &Device::flex()).unwrap_err();
    assert!(missing.to_string().contains("cannot be read"), "{missing}");
}
