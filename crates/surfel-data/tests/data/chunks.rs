//! Chunks of RealEstate10K, and the released kind with depth and normals.

use crate::support::{Plane, assert_photographs, camera, depth_png, jpeg, png, write};
use std::collections::BTreeSet;
use std::fs::File;
use std::path::Path;
use surfel_core::{Camera, Grid};
use surfel_data::chunks::{Chunk, ChunkOptions, ChunkSet};
use surfel_data::{SceneViews, load};
use surfel_torch::{Dtype, Object, Tensor};

const SIZE: (usize, usize) = (64, 36);
/// Of depth pictures, scene units.
const DEPTH_UNIT: f64 = 1e-4;

fn bytes(bytes: Vec<u8>) -> Object {
    Object::Tensor(Tensor::from_bytes(Dtype::U8, vec![bytes.len()], bytes))
}

fn row(camera: &Camera) -> Vec<f32> {
    let (k, pose) = (camera.intrinsics, camera.camera_from_world);
    let (w, h) = (camera.width as f64, camera.height as f64);
    let mut row = vec![k.fx / w, k.fy / h, k.cx / w, k.cy / h, 0.0, 0.0];
    for i in 0..3 {
        row.extend(pose.rotation.row(i).to_array());
        row.push(pose.translation[i]);
    }
    row.into_iter().map(|v| v as f32).collect()
}

/// The fields of a scene of `num_views` photographs of the plane.
fn fields(key: &str, num_views: usize) -> Vec<(String, Object)> {
    let cameras: Vec<Camera> = (0..num_views).map(|i| camera(SIZE.0, SIZE.1, i)).collect();
    let rows: Vec<f32> = cameras.iter().flat_map(row).collect();
    let images = cameras.iter().map(|c| bytes(jpeg(&Plane::slanted().photograph("", *c).image))).collect();
    let stamps = (0..num_views as i64).flat_map(|t| (33_000 * t).to_le_bytes()).collect();
    vec![
        ("url".to_owned(), Object::Str("https://example.org/clip".to_owned())),
        ("timestamps".to_owned(), Object::Tensor(Tensor::from_bytes(Dtype::I64, vec![num_views], stamps))),
        ("cameras".to_owned(), Object::Tensor(Tensor::from_f32(vec![num_views, 18], &rows))),
        ("images".to_owned(), Object::List(images)),
        ("key".to_owned(), Object::Str(key.to_owned())),
    ]
}

fn write_chunk(path: &Path, scenes: Vec<Vec<(String, Object)>>) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let list = Object::List(scenes.into_iter().map(Object::Dict).collect());
    surfel_torch::write(&list, File::create(path).unwrap()).unwrap();
}

#[test]
fn a_set_is_read_chunk_by_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    write_chunk(&root.join("000000.torch"), vec![fields("aa", 3), fields("bb", 2)]);
    write_chunk(&root.join("000001.torch"), vec![fields("cc", 4)]);
    write(&root.join("index.json"), r#"{"aa": "000000.torch", "bb": "000000.torch", "cc": "000001.torch"}"#);
    let set = ChunkSet::open(root, ChunkOptions::CLIPS).unwrap();
    assert_eq!(set.keys().collect::<Vec<_>>(), ["aa", "bb", "cc"]);
    assert_eq!(set.files(), ["000000.torch", "000001.torch"]);
    let mut lengths = Vec::new();
    for file in set.files() {
        let mut chunk = set.chunk(file).unwrap();
        for i in 0..chunk.len() {
            let scene = chunk.scene(i).unwrap();
            lengths.push((scene.name().to_owned(), scene.num_views()));
        }
    }
    assert_eq!(lengths, [("aa".to_owned(), 3), ("bb".to_owned(), 2), ("cc".to_owned(), 4)]);
    let (mut chunk, place) = set.chunk_of("bb").unwrap();
    let mut scene = chunk.scene(place).unwrap();
    assert_eq!((scene.name(), scene.range(), scene.unit_to_world()), ("bb", (1.0, 100.0), 1.0));
    let view = scene.view(1).unwrap();
    let expected = camera(SIZE.0, SIZE.1, 1);
    assert_eq!((view.camera.width, view.camera.height), SIZE);
    assert!((view.camera.intrinsics.fx - expected.intrinsics.fx).abs() < 1e-4);
    assert!((view.camera.intrinsics.cy - expected.intrinsics.cy).abs() < 1e-4);
    let (a, b) = (view.camera.camera_from_world, expected.camera_from_world);
    assert!(
        (a.translation - b.translation).length() < 1e-6
            && (a.rotation - b.rotation).to_cols_array().iter().all(|d| d.abs() < 1e-6)
    );
    assert!(view.depth.is_none() && view.normal.is_none() && view.mask.is_none());
    // The photographs are those of the cameras.
    let truth = Plane::slanted().photograph("", view.camera).depth;
    assert_photographs(&surfel_data::TrainingView { depth: truth, ..view }, &Plane::slanted(), 1e-5, 0.04);
}

#[test]
fn each_pass_has_its_own_order_and_each_seed_its_own_passes() {
    let folder = tempfile::tempdir().unwrap();
    let index: Vec<String> = (0..40).map(|i| format!("\"k{i}\": \"{i:06}.torch\"")).collect();
    write(&folder.path().join("index.json"), format!("{{{}}}", index.join(",")));
    let set = ChunkSet::open(folder.path(), ChunkOptions::CLIPS).unwrap();
    let orders: Vec<Vec<&str>> =
        (0..4).flat_map(|seed| (0..4).map(move |pass| (seed, pass))).map(|(s, p)| set.shuffled_files(s, p)).collect();
    for order in &orders {
        assert_eq!(order.iter().copied().collect::<BTreeSet<_>>(), set.files().into_iter().collect());
    }
    assert_eq!(orders.iter().collect::<BTreeSet<_>>().len(), orders.len());
    assert_eq!(orders[5], set.shuffled_files(1, 1));
}

/// A scene with depth and normals at half size, the second frame without.
fn with_truth(key: &str) -> Vec<(String, Object)> {
    let view = Plane::slanted().photograph("", camera(SIZE.0 / 2, SIZE.1 / 2, 0));
    let mut normal = view.normal.unwrap().map(|n| n.map(|v| 0.5 + 0.5 * v));
    normal[(0, 0)] = [0.0; 3];
    normal[(1, 0)] = [128.0 / 255.0; 3];
    // One of the opposite sense.
    normal[(2, 0)] = normal[(2, 0)].map(|v| 1.0 - v);
    let depth = depth_png(&view.depth.unwrap(), DEPTH_UNIT);
    let mut fields = fields(key, 2);
    fields.push(("depths".to_owned(), Object::List(vec![bytes(depth), Object::None])));
    fields.push(("normals".to_owned(), Object::List(vec![bytes(png(&normal)), Object::None])));
    fields
}

#[test]
fn depth_and_normals_are_read_where_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("000000.torch");
    write_chunk(&path, vec![with_truth("scan1"), fields("scan2", 2)]);
    let mut chunk = Chunk::open(&path, ChunkOptions { depth_unit: DEPTH_UNIT, ..ChunkOptions::DTU }).unwrap();
    let mut scene = chunk.scene(0).unwrap();
    assert_eq!((scene.range(), scene.unit_to_world()), ((2.125, 4.525), 200.0));
    let view = scene.view(0).unwrap();
    let known = assert_photographs(&view, &Plane::slanted(), 1e-4, 0.04);
    assert!(known >= (SIZE.0 - 2) * (SIZE.1 - 2), "{known}");
    let normals = view.normal.unwrap();
    let expected = Plane::slanted().photograph("", view.camera).normal.unwrap();
    for (x, y) in [(4, 0), (5, 1), (6, 4), (30, 20), (63, 35)] {
        let close = normals[(x, y)].iter().zip(expected[(x, y)]).all(|(a, b)| (a - b).abs() < 0.01);
        assert!(close, "{:?} instead of {:?}", normals[(x, y)], expected[(x, y)]);
    }
    assert_eq!([normals[(0, 0)], normals[(1, 1)], normals[(2, 0)], normals[(3, 1)]], [[0.0; 3]; 4]);
    let second = scene.view(1).unwrap();
    assert!(second.depth.is_none() && second.normal.is_none());
    assert!(chunk.scene(1).unwrap().view(0).unwrap().depth.is_none());
}

#[test]
fn a_sample_of_a_chunk_is_of_one_size() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("000000.torch");
    write_chunk(&path, vec![fields("aa", 5)]);
    let mut chunk = Chunk::open(&path, ChunkOptions::CLIPS).unwrap();
    let choice = surfel_data::choice::Choice { contexts: vec![0, 4], targets: vec![2] };
    let scene = load(&mut chunk.scene(0).unwrap(), &choice, 32, 24).unwrap();
    assert_eq!(scene.targets[0].name, "aa 2");
    assert!(scene.contexts.iter().all(|view| (view.image.width(), view.image.height()) == (32, 24)));
    let error = load(&mut chunk.scene(0).unwrap(), &choice, 32, 64).unwrap_err().to_string();
    assert!(error.contains("view aa 0 has 64 x 36 pixels"), "{error}");
}

#[test]
fn what_is_missing_or_damaged_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (root, path) = (folder.path(), folder.path().join("000000.torch"));
    let said = |text: String, words: &[&str]| {
        words.iter().for_each(|words| assert!(text.contains(words), "{words}: {text}"));
    };
    let set = || ChunkSet::open(root, ChunkOptions::CLIPS);
    said(set().unwrap_err().to_string(), &["index.json"]);
    write(&root.join("index.json"), "[1, 2]");
    said(set().unwrap_err().to_string(), &["index.json", "no list of a chunk"]);
    write(&root.join("index.json"), "{}");
    said(set().unwrap_err().to_string(), &["lists no scene"]);
    write(&root.join("index.json"), r#"{"aa": "../secret.torch"}"#);
    said(set().unwrap_err().to_string(), &["../secret.torch", "beside the index"]);
    write(&root.join("index.json"), r#"{"aa": "000000.torch", "zz": "000000.torch"}"#);
    said(set().unwrap().chunk_of("aa").err().unwrap().to_string(), &["000000.torch"]);
    write_chunk(&path, vec![fields("aa", 2)]);
    said(
        set().unwrap().chunk_of("zz").err().unwrap().to_string(),
        &["index.json", "zz is in 000000.torch, but it is not"],
    );
    said(set().unwrap().chunk_of("yy").err().unwrap().to_string(), &["does not list a scene yy"]);

    let opened = || Chunk::open(&path, ChunkOptions::CLIPS);
    let whole = std::fs::read(&path).unwrap();
    write(&path, &whole[..whole.len() / 2]);
    said(opened().err().unwrap().to_string(), &["000000.torch", "not complete"]);
    let without = |name: &str| fields("aa", 2).into_iter().filter(|(field, _)| field != name).collect::<Vec<_>>();
    let with = |name: &str, value: Object| [without(name), vec![(name.to_owned(), value)]].concat();
    for name in ["key", "cameras", "images"] {
        write_chunk(&path, vec![fields("aa", 2), without(name)]);
        said(opened().err().unwrap().to_string(), &["scene 1 has no", name]);
    }
    for (name, value, words) in [
        ("key", Object::Int(3), "no text"),
        ("images", Object::Int(3), "no list"),
        ("images", Object::List(vec![Object::Int(3)]), "no list of encoded pictures"),
        ("cameras", Object::None, "no tensor"),
        ("cameras", Object::Tensor(Tensor::from_f32(vec![3, 18], &[0.0; 54])), "its 2 images need 18 numbers"),
        ("depths", Object::List(vec![Object::None]), "a list of 1 for 2 images"),
    ] {
        write_chunk(&path, vec![with(name, value)]);
        said(opened().err().unwrap().to_string(), &[name, words]);
    }
    surfel_torch::write(&Object::Int(3), File::create(&path).unwrap()).unwrap();
    said(opened().err().unwrap().to_string(), &["holds an int, not a list of scenes"]);

    // A camera that mirrors, and one without a focal length.
    let mut rows: Vec<f32> = (0..2).flat_map(|i| row(&camera(SIZE.0, SIZE.1, i))).collect();
    (18 + 6..18 + 9).for_each(|i| rows[i] = -rows[i]);
    write_chunk(&path, vec![with("cameras", Object::Tensor(Tensor::from_f32(vec![2, 18], &rows)))]);
    said(opened().unwrap().scene(0).err().unwrap().to_string(), &["000000.torch", "scene aa frame 1", "mirror"]);
    rows[0] = f32::NAN;
    write_chunk(&path, vec![with("cameras", Object::Tensor(Tensor::from_f32(vec![2, 18], &rows)))]);
    said(opened().unwrap().scene(0).err().unwrap().to_string(), &["scene aa frame 0", "are no camera"]);

    // Half a photograph, no photograph, a depth picture of another kind or shape.
    let whole = jpeg(&Plane::slanted().photograph("", camera(SIZE.0, SIZE.1, 0)).image);
    let images = Object::List(vec![bytes(whole[..whole.len() / 2].to_vec()), bytes(b"no picture".to_vec())]);
    write_chunk(&path, vec![with("images", images)]);
    let mut chunk = opened().unwrap();
    said(chunk.scene(0).unwrap().view(0).unwrap_err().to_string(), &["scene aa image 0", "cut short"]);
    said(chunk.scene(0).unwrap().view(1).unwrap_err().to_string(), &["scene aa image 1", "cannot be decoded"]);
    let depths = |picture: Vec<u8>| with("depths", Object::List(vec![bytes(picture), Object::None]));
    write_chunk(&path, vec![depths(png(&Grid::filled(64, 36, [0.3; 3])))]);
    said(opened().unwrap().scene(0).unwrap().view(0).unwrap_err().to_string(), &["scene aa depth 0", "16-bit gray"]);
    write_chunk(&path, vec![depths(depth_png(&Grid::filled(64, 64, 1.0), 0.1))]);
    said(opened().unwrap().scene(0).unwrap().view(0).unwrap_err().to_string(), &["depth 0", "64x64", "another shape"]);
}

/// Written by PyTorch itself (`fixtures/make.py`).
#[test]
fn a_chunk_of_pytorch_is_read() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/chunk.torch");
    let mut chunk = Chunk::open(&path, ChunkOptions::CLIPS).unwrap();
    assert_eq!(chunk.keys().collect::<Vec<_>>(), ["0123456789abcdef", "fedcba9876543210"]);
    let mut scene = chunk.scene(0).unwrap();
    assert_eq!(scene.num_views(), 3);
    let view = scene.view(2).unwrap();
    assert_eq!((view.image.width(), view.image.height()), (8, 6));
    let expected = [70.0, 60.0, 100.0].map(|v: f32| v / 255.0);
    assert!(view.image[(7, 3)].iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6));
    let k = view.camera.intrinsics;
    assert_eq!([k.fx, k.fy, k.cx, k.cy], [6.0, 6.0, 4.0, 3.0]);
    assert_eq!(view.camera.camera_from_world.translation, glam::DVec3::new(2.0, 0.0, 0.0));
}
