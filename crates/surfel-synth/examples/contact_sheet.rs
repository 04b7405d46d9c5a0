//! Draws a page of random scenes: picture, depth and normals of two views each.
//!
//! `contact_sheet ASSETS_DIR train|val FIRST_SEED COUNT OUT.png [ROOM_SHARE]`

use std::error::Error;
use surfel_synth::contact_sheet::{contact_sheet, depth_tile, normal_tile};
use surfel_synth::{AssetLibrary, SceneSampler, Split, SynthConfig, warp_statistics};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [assets, split, first, count, out, rest @ ..] = arguments.as_slice() else {
        return Err("usage: contact_sheet ASSETS_DIR train|val FIRST_SEED COUNT OUT.png [ROOM_SHARE]".into());
    };
    let split = if split == "val" { Split::Val } else { Split::Train };
    let library = AssetLibrary::open(assets, split)?;
    let mut config = SynthConfig::default();
    if let Some(share) = rest.first() {
        config.room_share = share.parse()?;
    }
    let sampler = SceneSampler::new(&library, config);
    let (first, count): (u64, u64) = (first.parse()?, count.parse()?);
    let mut tiles = Vec::new();
    for seed in first..first + count {
        let scene = sampler.scene(seed)?;
        let (left, right) = (scene.render(0), scene.render(1));
        println!("seed {seed}: {:?}", warp_statistics(&left, &right, 0.01));
        let truth = [depth_tile(&left.depth), normal_tile(&left.normal)];
        tiles.extend([left.view.image, right.view.image].into_iter().chain(truth));
    }
    let sheet = contact_sheet(&tiles, 4);
    let bytes = sheet.as_slice().iter().flatten().map(|v| (255.0 * v).round() as u8).collect();
    let page = image::RgbImage::from_vec(sheet.width() as u32, sheet.height() as u32, bytes);
    page.ok_or("the page is too large")?.save(out)?;
    Ok(())
}
