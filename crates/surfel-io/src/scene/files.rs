//! The image files below a scene's root, and how a camera file's name for one leads to it.
//!
//! Folders are ranked (`images` before `images_2` before the rest); folders of masks, depths and normals
//! never hold photographs. Everything is sorted, so the result does not depend on the file system.

use super::entry::ImageKey;
use super::error::SceneError;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

const EXTENSIONS: [&str; 9] = ["jpg", "jpeg", "png", "webp", "tif", "tiff", "bmp", "ppm", "pgm"];
const MASK_FOLDERS: [&str; 5] = ["mask", "masks", "object_mask", "object_masks", "silhouettes"];
const NOT_PHOTOGRAPHS: [&str; 9] =
    ["depth", "normal", "disp", "pseudo_gt", "semantic", "label", "confidence", "rendered", "cache"];

/// Deeper folders and more files than these are somebody's disk, not a scene.
const MAX_DEPTH: usize = 5;
const MAX_FILES: usize = 200_000;

/// The image files below one folder.
#[derive(Debug)]
pub(super) struct ImageFiles {
    root: PathBuf,
    /// Photographs by folder, in order of rank; paths relative to the root.
    folders: Vec<Vec<PathBuf>>,
    by_name: HashMap<String, Vec<PathBuf>>,
    by_stem: HashMap<String, Vec<PathBuf>>,
    masks: Vec<PathBuf>,
}

impl ImageFiles {
    /// Lists the images below `root`.
    pub fn below(root: &Path) -> Result<Self, SceneError> {
        let mut found = Vec::new();
        walk(root, Path::new(""), 0, &mut found)?;
        found.sort();
        let (masks, photographs): (Vec<PathBuf>, Vec<PathBuf>) =
            found.into_iter().partition(|path| is_in_mask_folder(path));
        let mut by_folder: BTreeMap<(u32, PathBuf), Vec<PathBuf>> = BTreeMap::new();
        for path in photographs {
            let folder = path.parent().unwrap_or(Path::new("")).to_owned();
            if let Some(rank) = folder_rank(&folder) {
                by_folder.entry((rank, folder)).or_default().push(path);
            }
        }
        let folders: Vec<Vec<PathBuf>> = by_folder.into_values().collect();
        let (mut by_name, mut by_stem) = (HashMap::<_, Vec<_>>::new(), HashMap::<_, Vec<_>>::new());
        for path in folders.iter().flatten() {
            by_name.entry(name_of(path)).or_default().push(path.clone());
            by_stem.entry(stem_of(path)).or_default().push(path.clone());
        }
        Ok(Self { root: root.to_owned(), folders, by_name, by_stem, masks })
    }

    /// True when there is no photograph.
    pub fn is_empty(&self) -> bool {
        self.folders.is_empty()
    }

    /// The file of each key (all of one kind), relative to the root.
    pub fn find_all(&self, keys: &[&ImageKey]) -> Vec<Option<PathBuf>> {
        match keys.first() {
            Some(ImageKey::Rank(_)) => self.by_rank(keys.len()),
            Some(ImageKey::Name(_)) => keys.iter().map(|key| self.by_name(key)).collect(),
            _ => self.by_number(keys),
        }
    }

    fn by_name(&self, key: &ImageKey) -> Option<PathBuf> {
        let ImageKey::Name(name) = key else { return None };
        let name = name.replace('\\', "/");
        let wanted = Path::new(name.trim_start_matches("./"));
        if has_image_extension(wanted) && self.root.join(wanted).is_file() {
            return Some(wanted.to_owned());
        }
        // The folders of the name may be those of another machine: the longest common tail decides, then
        // the rank of the folder (the order of the list).
        let best = |candidates: &[PathBuf], wanted: &Path| {
            let tail = |path: &PathBuf| common_tail(&path.with_extension(""), wanted);
            candidates.iter().rev().max_by_key(|path| tail(path)).cloned()
        };
        let same_name = self.by_name.get(&name_of(wanted));
        let found = same_name.and_then(|candidates| best(candidates, &wanted.with_extension("")));
        found.or_else(|| {
            let bare = if has_image_extension(wanted) { wanted.with_extension("") } else { wanted.to_owned() };
            best(self.by_stem.get(&name_of(&bare))?, &bare)
        })
    }

    /// In the first folder that holds any of the numbers.
    fn by_number(&self, keys: &[&ImageKey]) -> Vec<Option<PathBuf>> {
        let number: fn(&str) -> Option<u64> = match keys.first() {
            Some(ImageKey::Rect(_)) => rect_number,
            _ => number_of_stem,
        };
        for folder in &self.folders {
            let mut numbered: HashMap<u64, &PathBuf> = HashMap::new();
            for path in folder {
                if let Some(number) = number(&stem_of(path)) {
                    let preferred = stem_of(path).contains("_3_r5000");
                    if preferred || !numbered.contains_key(&number) {
                        numbered.insert(number, path);
                    }
                }
            }
            let find = |key: &&ImageKey| match key {
                ImageKey::Number(number) | ImageKey::Rect(number) => numbered.get(number).map(|&path| path.clone()),
                _ => None,
            };
            let found: Vec<_> = keys.iter().map(find).collect();
            if found.iter().any(Option::is_some) {
                return found;
            }
        }
        vec![None; keys.len()]
    }

    /// The first folder that holds exactly `count` images.
    fn by_rank(&self, count: usize) -> Vec<Option<PathBuf>> {
        match self.folders.iter().find(|folder| folder.len() == count) {
            Some(folder) => folder.iter().cloned().map(Some).collect(),
            None => vec![None; count],
        }
    }

    /// The mask of a photograph: same name + `.png`, same stem, or the same number with other padding.
    pub fn mask_of(&self, photograph: &Path) -> Option<PathBuf> {
        let (name, stem) = (name_of(photograph), stem_of(photograph));
        let whole_number = |stem: &str| stem.parse::<u64>().ok();
        let tier = |mask: &PathBuf| {
            let mask_stem = stem_of(mask);
            match () {
                () if mask_stem == name => Some(0),
                () if mask_stem == stem => Some(1),
                () if whole_number(&stem).is_some() && whole_number(&mask_stem) == whole_number(&stem) => Some(2),
                () => None,
            }
        };
        let folders = |path: &Path| path.with_file_name("x");
        let (_, _, best) = self
            .masks
            .iter()
            .filter_map(|mask| {
                Some((tier(mask)?, usize::MAX - common_tail(&folders(mask), &folders(photograph)), mask))
            })
            .min()?;
        Some(best.clone())
    }

    /// A path from the camera file, as given or below the root.
    pub fn existing(&self, name: &str) -> Option<PathBuf> {
        let path = self.root.join(name.replace('\\', "/"));
        path.is_file().then_some(path)
    }

    /// Photographs in the best folder, for messages.
    pub fn sample(&self) -> String {
        let Some(folder) = self.folders.first() else { return "there is no image file there".into() };
        let names: Vec<String> = folder.iter().take(3).map(|path| path.display().to_string()).collect();
        format!("the images there are {}{}", names.join(", "), if folder.len() > 3 { ", ..." } else { "" })
    }
}

fn walk(root: &Path, folder: &Path, depth: usize, found: &mut Vec<PathBuf>) -> Result<(), SceneError> {
    let here = root.join(folder);
    let fault = |source| SceneError::Read { path: here.clone(), source };
    for item in std::fs::read_dir(&here).map_err(fault)? {
        let item = item.map_err(fault)?;
        let path = folder.join(item.file_name());
        if item.file_name().to_string_lossy().starts_with('.') || found.len() >= MAX_FILES {
            continue;
        }
        if has_image_extension(&path) && item.path().is_file() {
            found.push(path);
        } else if depth < MAX_DEPTH && item.path().is_dir() {
            walk(root, &path, depth + 1, found)?;
        }
    }
    Ok(())
}

/// Lower is better; `None` for folders that hold no photographs.
fn folder_rank(folder: &Path) -> Option<u32> {
    let names: Vec<String> = folder.iter().map(|part| part.to_string_lossy().to_lowercase()).collect();
    if names.iter().any(|name| NOT_PHOTOGRAPHS.iter().any(|other| name.starts_with(other))) {
        return None;
    }
    let Some(last) = names.last() else { return Some(2) };
    let own = match last.as_str() {
        "images" | "image" => 0,
        "rgb" | "color" | "colour" | "blended_images" | "rect" | "rectified" | "input" => 1,
        _ => match last.strip_prefix("images_") {
            Some(factor) => 10 + factor.parse().unwrap_or(90u32).min(90),
            None => 3,
        },
    };
    Some(own + 100 * (names.len() as u32 - 1))
}

fn is_in_mask_folder(path: &Path) -> bool {
    path.parent().is_some_and(|folder| {
        folder.iter().any(|part| MASK_FOLDERS.contains(&part.to_string_lossy().to_lowercase().as_str()))
    })
}

pub(super) fn has_image_extension(path: &Path) -> bool {
    path.extension().is_some_and(|ext| EXTENSIONS.contains(&ext.to_string_lossy().to_lowercase().as_str()))
}

fn name_of(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

pub(super) fn stem_of(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Number of equal trailing components.
fn common_tail(a: &Path, b: &Path) -> usize {
    a.iter().rev().zip(b.iter().rev()).take_while(|(a, b)| a == b).count()
}

/// The number a stem consists of or ends with: 23 for `000023` and `frame_00023`.
pub(super) fn number_of_stem(stem: &str) -> Option<u64> {
    let digits = stem.len() - stem.bytes().rev().take_while(u8::is_ascii_digit).count();
    stem[digits..].parse().ok()
}

/// 23 for DTU's `rect_023_3_r5000`.
fn rect_number(stem: &str) -> Option<u64> {
    stem.strip_prefix("rect_")?.split('_').next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(names: &[&str]) -> (tempfile::TempDir, ImageFiles) {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, b"").unwrap();
        }
        let files = ImageFiles::below(folder.path()).unwrap();
        (folder, files)
    }

    fn named(files: &ImageFiles, name: &str) -> Option<String> {
        files.by_name(&ImageKey::Name(name.into())).map(|path| path.display().to_string())
    }

    #[test]
    fn names_survive_moved_folders_and_changed_extensions() {
        let (_folder, files) =
            files(&["images_4/a.png", "images/a.png", "images/b.jpg", "depth/a.png", "train/r_0.png", "test/r_0.png"]);
        assert_eq!(named(&files, "a.png").as_deref(), Some("images/a.png"));
        assert_eq!(named(&files, "/photos/of/me/images_4/a.png").as_deref(), Some("images_4/a.png"));
        assert_eq!(named(&files, "b.png").as_deref(), Some("images/b.jpg"));
        assert_eq!(named(&files, "./test/r_0").as_deref(), Some("test/r_0.png"));
        assert_eq!(named(&files, "rgb\\b.jpg").as_deref(), Some("images/b.jpg"));
        assert_eq!(named(&files, "c.png"), None);
    }

    #[test]
    fn masks_match_by_name_stem_or_number() {
        let (_folder, files) =
            files(&["image/000023.jpg", "mask/023.png", "masks/b.jpg.png", "masks/b.png", "masks/c.png"]);
        let mask = |name: &str| files.mask_of(Path::new(name)).map(|path| path.display().to_string());
        assert_eq!(mask("image/000023.jpg").as_deref(), Some("mask/023.png"));
        assert_eq!(mask("image/b.jpg").as_deref(), Some("masks/b.jpg.png"));
        assert_eq!(mask("image/c.jpg").as_deref(), Some("masks/c.png"));
        assert_eq!(mask("image/d.jpg"), None);
    }

    #[test]
    fn numbers_match_with_any_padding_and_dtu_counts_from_one() {
        let (_folder, files) =
            files(&["images/rect_001_0_r5000.png", "images/rect_001_3_r5000.png", "images/rect_002_3_r5000.png"]);
        let found = files.find_all(&[&ImageKey::Rect(1), &ImageKey::Rect(7)]);
        assert_eq!(found, [Some("images/rect_001_3_r5000.png".into()), None]);
        assert_eq!(number_of_stem("frame_00023"), Some(23));
        assert_eq!(number_of_stem("key"), None);
    }
}
