//! Draws a page of scenes: two pictures, depth and normals of each.
//!
//! `contact_sheet OUT.png` draws every kind of analytic scene;
//! `contact_sheet OUT.png ASSETS_DIR train|val FIRST_SEED COUNT [ROOM_SHARE]` draws scanned objects.

use std::error::Error;
use surfel_core::Grid;
use surfel_synth::contact_sheet::{contact_sheet, depth_tile, normal_tile};
use surfel_synth::{AssetLibrary, RenderedView, SceneSampler, Split, SynthConfig, warp_statistics};
use surfel_synth::{SceneKind, SceneOptions};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (out, pairs) = match arguments.as_slice() {
        [out] => (out, analytic()),
        [out, assets, split, first, count, rest @ ..] => {
            let split = if split == "val" { Split::Val } else { Split::Train };
            let room_share = rest.first().map_or(Ok(SynthConfig::default().room_share), |share| share.parse())?;
            (out, scanned(&AssetLibrary::open(assets, split)?, room_share, first.parse()?, count.parse()?)?)
        }
        _ => return Err("usage: contact_sheet OUT.png [ASSETS_DIR train|val FIRST_SEED COUNT [ROOM_SHARE]]".into()),
    };
    let mut tiles: Vec<Grid<[f32; 3]>> = Vec::new();
    for [left, right] in pairs {
        println!("{:?}", warp_statistics(&left, &right, 0.01));
        let truth = [depth_tile(&left.depth), normal_tile(&left.normal)];
        tiles.extend([left.view.image, right.view.image].into_iter().chain(truth));
    }
    let sheet = contact_sheet(&tiles, 4);
    let bytes = sheet.as_slice().iter().flatten().map(|v| (255.0 * v).round() as u8).collect();
    let page = image::RgbImage::from_vec(sheet.width() as u32, sheet.height() as u32, bytes);
    page.ok_or("the page is too large")?.save(out)?;
    Ok(())
}

fn analytic() -> Vec<[RenderedView; 2]> {
    use SceneKind::{Boxes, HeightField, Plane, Sphere, StillLife, Torus};
    let kinds = [Sphere, Torus, Boxes, HeightField, Plane, StillLife];
    let pair = |(seed, kind)| {
        let options = SceneOptions { kind, seed, ..SceneOptions::default() };
        let (scene, cameras) = (options.scene(), options.cameras());
        [0, 1].map(|i| scene.render(&cameras[i], i.to_string(), &Default::default()))
    };
    (0..).zip(kinds).map(pair).collect()
}

fn scanned(
    library: &AssetLibrary,
    room_share: f64,
    first: u64,
    count: u64,
) -> Result<Vec<[RenderedView; 2]>, Box<dyn Error>> {
    let sampler = SceneSampler::new(library, SynthConfig { room_share, ..SynthConfig::default() });
    let pair = |seed| {
        let scene = sampler.scene(seed)?;
        Ok([scene.render(0), scene.render(1)])
    };
    (first..first + count).map(pair).collect()
}
