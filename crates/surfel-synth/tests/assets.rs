//! Scenes from the shared assets folder; skipped, loudly, where it is missing.
#![cfg(feature = "assets")]

use std::path::PathBuf;
use surfel_synth::render::{NOTHING, SURROUNDINGS};
use surfel_synth::{
    AssetError, AssetLibrary, RenderedView, SceneSampler, SceneSource, Split, SynthConfig, warp_statistics,
};

fn folder() -> Option<PathBuf> {
    let workspace = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..");
    let shared = std::env::var_os("SURFELSPLAT_SHARED").map_or_else(|| workspace.join("../shared"), PathBuf::from);
    let assets = shared.join("data/assets");
    if !assets.join("index.json").exists() {
        eprintln!("SKIPPED: no assets at {}; set SURFELSPLAT_SHARED", assets.display());
        return None;
    }
    Some(assets)
}

fn small() -> SynthConfig {
    SynthConfig { width: 128, height: 104, num_objects: [1, 3], ..SynthConfig::default() }
}

fn same(a: &RenderedView, b: &RenderedView) -> bool {
    a.view.image == b.view.image && a.depth == b.depth && a.normal == b.normal && a.object == b.object
}

#[test]
fn the_two_sides_of_the_split_share_nothing() {
    let Some(folder) = folder() else { return };
    let train = AssetLibrary::open(&folder, Split::Train).unwrap();
    let val = AssetLibrary::open(&folder, Split::Val).unwrap();
    assert!(train.meshes().len() > 150 && val.meshes().len() > 15);
    for entry in val.meshes() {
        assert!(matches!(train.mesh(&entry.name), Err(AssetError::Unknown(_))), "{}", entry.name);
    }
}

#[test]
fn a_seed_gives_the_same_scene_on_any_number_of_threads_and_after_any_history() {
    let Some(folder) = folder() else { return };
    let render = |threads: usize, memory: usize, warm_up: Option<u64>| {
        let library = AssetLibrary::open(&folder, Split::Val).unwrap().with_memory_limit(memory);
        let sampler = SceneSampler::new(&library, small());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            if let Some(seed) = warm_up {
                sampler.scene(seed).unwrap();
            }
            let scene = sampler.scene(11).unwrap();
            [scene.render(1), scene.render(0)]
        })
    };
    let (first, second) = (render(1, 1 << 30, None), render(3, 1, Some(5)));
    assert!(same(&first[0], &second[0]) && same(&first[1], &second[1]));
    assert!(!same(&first[0], &first[1]));
}

#[test]
fn further_cameras_stand_at_their_places_and_change_no_other_view() {
    let Some(folder) = folder() else { return };
    let library = AssetLibrary::open(&folder, Split::Val).unwrap();
    for (room_share, street_share) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)] {
        let config = SynthConfig { room_share, street_share, ..small() };
        let further = SynthConfig { further_places: vec![0.25, 1.5], ..config.clone() };
        let [without, with] = [config, further].map(|config| SceneSampler::new(&library, config).scene(7).unwrap());
        assert_eq!((without.num_views(), with.num_views()), (2, 4));
        assert!(same(&without.render(1), &with.render(1)) && !same(&with.render(2), &with.render(0)));
        let [first, second, between, beside] = [0, 1, 2, 3].map(|i| with.cameras[i].centre());
        let baseline = (second - first).length();
        assert!(between.distance(first) < 0.3 * baseline && between.distance(second) < 0.8 * baseline);
        assert!(beside.distance(first) > 1.2 * baseline && beside.distance(second) < 0.6 * baseline);
    }
}

#[test]
fn views_agree_with_each_other_and_with_their_masks() {
    let Some(folder) = folder() else { return };
    let library = AssetLibrary::open(&folder, Split::Val).unwrap();
    for (room_share, street_share, seeds) in [(0.0, 0.0, 0..6), (1.0, 0.0, 6..8), (0.0, 1.0, 8..11)] {
        let config =
            SynthConfig { room_share, street_share, exposure_stops: 0.1, pair_angle_deg: [6.0, 12.0], ..small() };
        let sampler = SceneSampler::new(&library, config);
        for seed in seeds {
            let scene = sampler.scene(seed).unwrap();
            let (left, right) = (scene.render(0), scene.render(1));
            let statistics = warp_statistics(&left, &right, 0.015);
            println!("seed {seed}: {statistics:?}");
            assert!(statistics.num_compared * 4 > statistics.num_with_depth, "seed {seed}: {statistics:?}");
            assert!(statistics.median < 0.04, "seed {seed}: {statistics:?}");
            for (&object, &depth) in left.object.as_slice().iter().zip(left.depth.as_slice()) {
                assert_eq!(object == NOTHING, depth == 0.0);
                assert!(
                    object == NOTHING || object == SURROUNDINGS || usize::from(object) <= scene.stage.instances.len()
                );
            }
            let on_objects = left.object_mask().as_slice().iter().filter(|&&on| on).count();
            assert!(on_objects > 100, "seed {seed} shows no object");
        }
    }
}

#[test]
fn streets_change_no_other_scene_and_show_buildings_before_the_sky() {
    let Some(folder) = folder() else { return };
    let library = AssetLibrary::open(&folder, Split::Val).unwrap();
    let scene = |street_share: f64, seed: u64| {
        let config = SynthConfig { room_share: 0.0, street_share, ..small() };
        SceneSampler::new(&library, config).scene(seed).unwrap()
    };
    // Whatever the share, a scene is the tabletop it was without streets, or the street it is among streets only.
    for seed in 0..6 {
        let [none, some, all] = [0.0, 0.5, 1.0].map(|share| scene(share, seed).render(0));
        assert!(!same(&none, &all) && (same(&some, &none) || same(&some, &all)), "seed {seed}");
    }
    let (mut sky, mut walls) = (0, 0);
    for seed in 0..4 {
        let view = scene(1.0, seed).render(0);
        sky += view.object.as_slice().iter().filter(|&&object| object == NOTHING).count();
        walls += view.object_mask().as_slice().iter().filter(|&&on| on).count();
        let farthest = view.depth.as_slice().iter().copied().fold(0.0, f32::max);
        assert!((4e3..2e5).contains(&farthest), "seed {seed}: {farthest} mm");
    }
    let pixels = 4 * small().width * small().height;
    assert!(sky > pixels / 50 && walls > pixels / 5, "{sky} and {walls} of {pixels}");
}

#[test]
fn clean_pairs_have_the_stated_geometry() {
    let Some(folder) = folder() else { return };
    let library = AssetLibrary::open(&folder, Split::Val).unwrap();
    let scene = SceneSampler::new(&library, SynthConfig::clean_pair(160, 128)).scene(2).unwrap();
    let baseline = (scene.cameras[0].centre() - scene.cameras[1].centre()).length();
    assert!((baseline - 125.0).abs() < 1e-6, "{baseline}");
    assert!((scene.cameras[0].intrinsics.fx - 1.8 * 160.0).abs() < 1e-9);
    let view = scene.render(0);
    let objects = view.object_mask();
    let mut depths: Vec<f32> =
        view.depth.as_slice().iter().zip(objects.as_slice()).filter(|(_, on)| **on).map(|(d, _)| *d).collect();
    depths.sort_by(f32::total_cmp);
    let median = depths[depths.len() / 2];
    assert!((400.0..900.0).contains(&median), "{median} mm");
}

#[test]
fn the_exact_surface_of_a_scene_projects_onto_its_exact_depth() {
    let Some(folder) = folder() else { return };
    let library = Box::new(AssetLibrary::open(&folder, Split::Val).unwrap());
    let source = SceneSource::Scanned { library, split: Split::Val, config: SynthConfig::clean_pair(160, 128) };
    let scene = source.scene(3, 3.0).unwrap();
    assert_eq!(scene.name, "val-3");
    assert!(scene.surface.points.len() > 1000 && scene.objects.is_some_and(|mesh| mesh.triangles.len() > 1000));
    let (mut seen, mut on_depth) = (0, 0);
    for point in &scene.surface.points {
        let agrees = |view: &RenderedView| {
            let (pixel, z) = view.view.camera.project(*point).unwrap();
            let near =
                |x: isize, y: isize| view.depth.get(x, y).is_some_and(|&depth| (f64::from(depth) - z).abs() < 0.01 * z);
            // The pixel itself may show what lies beside a silhouette.
            let (x, y) = (pixel.x.floor() as isize, pixel.y.floor() as isize);
            (-1..=1).any(|dx| (-1..=1).any(|dy| near(x + dx, y + dy)))
        };
        seen += 1;
        on_depth += usize::from(scene.views.iter().any(agrees));
    }
    assert!(on_depth * 100 > seen * 97, "{on_depth} of {seen}");
}
