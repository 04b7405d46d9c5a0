//! What buildings are painted with: stone, brick and plaster of the library, and panes.
//!
//! Lengths in millimetres. Invariant: one repeat of a pattern has the length it was asked for, however large the mesh.

use super::error::AssetError;
use super::instance::Paint;
use super::library::AssetLibrary;
use crate::random::Random;
use crate::texture::Texture;
use std::path::{Path, PathBuf};

/// A paint once the radius of what it is put on is known.
pub(super) type PaintBySize = Box<dyn FnOnce(f64) -> Paint>;

/// Parts of the library's materials that buildings are made of, by words in their file names.
const MASONRY_WORDS: [&str; 9] = ["brick", "plaster", "stucco", "rock", "wall", "clay", "marble", "tile", "dirt"];

/// Stone, brick or plaster of the library, now and then spots of two colours; one repeat is `tile` wide.
pub(super) fn masonry_paint(library: &AssetLibrary, tile: f64, random: &mut Random) -> Result<PaintBySize, AssetError> {
    if random.chance(0.3) {
        let mut colour = |low: f64, high: f64| {
            let grey = random.range(low, high);
            std::array::from_fn(|_| (grey * random.range(0.85, 1.15)) as f32)
        };
        let colours = [colour(0.25, 0.5), colour(0.5, 0.8)];
        let seed = random.bits();
        return Ok(Box::new(move |radius| {
            Paint::Procedural(Texture::Noise { seed, size: tile / radius, octaves: 5, colours })
        }));
    }
    let image = library.image(masonry_file(library, random))?;
    Ok(Box::new(move |radius| Paint::Wrapped { image, repeats: (radius / tile) as f32 }))
}

/// A material that walls and pavements are made of; any when the library has none by these names.
pub(super) fn masonry_file<'a>(library: &'a AssetLibrary, random: &mut Random) -> &'a Path {
    let is_masonry = |file: &&PathBuf| {
        let name = file.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        MASONRY_WORDS.iter().any(|word| name.contains(word))
    };
    let files: Vec<&PathBuf> = library.materials().iter().filter(is_masonry).collect();
    match files.len() {
        0 => &library.materials()[random.below(library.materials().len())],
        count => files[random.below(count)],
    }
}

/// Dark and clouded, as rooms behind glass are.
pub(super) fn glass_paint(random: &mut Random) -> PaintBySize {
    let mut colour = |low: f64, high: f64| {
        let grey = random.range(low, high);
        std::array::from_fn(|_| (grey * random.range(0.8, 1.2)) as f32)
    };
    let (colours, size, seed) = ([colour(0.02, 0.2), colour(0.1, 0.45)], random.range(500.0, 3000.0), random.bits());
    Box::new(move |radius| Paint::Procedural(Texture::Noise { seed, size: size / radius, octaves: 5, colours }))
}
