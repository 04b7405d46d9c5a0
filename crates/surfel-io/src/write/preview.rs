//! `preview.png`: one row per view - photo, depth, normals, mesh - the first thing people look at. Training shows
//! its samples in the same form.
//!
//! Depth is coloured by inverse depth over the 2-98 % range of what is believed of all rows, so that stray pixels cannot
//! wash it out and one colour is one depth. Invariant: every panel of a row has the same size and shows the same pixels.

use super::caption;
use super::colour_map::turbo;
use super::error::unfit;
use super::picture::{Picture, resampled};
use super::png_file::write_png;
use glam::Vec2;
use png::{BitDepth, ColorType};
use std::io::{self, Write};
use surfel_core::Grid;

/// What one view shows; all grids have the same size.
#[derive(Clone, Copy, Debug)]
pub struct PreviewRow<'a> {
    /// sRGB in \[0, 1\].
    pub photo: &'a Grid<[f32; 3]>,
    /// z-depth, scene units; 0 = none.
    pub depth: &'a Grid<f32>,
    /// Depths that decide which ones the colours tell apart; 0 = not this one. Of `depth`'s size or any other.
    pub believed: &'a Grid<f32>,
    /// Unit normals, camera frame, OpenCV axes; the zero vector = none.
    pub normal: &'a Grid<[f32; 3]>,
    /// The shaded mesh seen from the same camera, or another picture, sRGB in \[0, 1\].
    pub last: &'a Grid<[f32; 3]>,
    /// What is written under the panels.
    pub captions: [&'a str; 4],
}

/// What the preview of a reconstruction writes under the panels.
pub const CAPTIONS: [&str; 4] = ["photo", "depth", "normals", "mesh"];

/// Longest side of a panel, pixels: four of them fit a wide screen.
const PANEL: f64 = 440.0;
const MARGIN: usize = 28;
const GUTTER: usize = 14;
/// The panel with a legend.
const DEPTH_COLUMN: usize = 1;
/// Room under a panel for its caption.
const CAPTION: usize = 40;
const CORNER: f32 = 6.0;
const X_HEIGHT: f32 = 8.0;
const PAPER: [f32; 3] = [0.98, 0.98, 0.975];
const INK: [f32; 3] = [0.25, 0.26, 0.28];
const NONE: [f32; 3] = [0.17, 0.175, 0.185];

/// Writes the preview picture.
///
/// # Errors
/// When there is no row, a row mixes sizes or is empty, or `out` refuses.
pub fn write_preview(out: &mut impl Write, rows: &[PreviewRow]) -> io::Result<()> {
    let sizes = rows.iter().map(panel_size).collect::<io::Result<Vec<_>>>()?;
    let Some(widest) = sizes.iter().map(|size| size.0).max() else {
        return Err(unfit("there is no view to preview"));
    };
    let width = 2 * MARGIN + 4 * widest + 3 * GUTTER;
    // The last caption brings its own white space.
    let height = MARGIN + sizes.iter().map(|size| size.1 + CAPTION).sum::<usize>() + MARGIN / 2;
    let mut picture = Picture::new(width, height, PAPER);
    let mut top = MARGIN;
    let believed = inverse_range(rows.iter().map(|row| row.believed));
    let range = believed.or_else(|| inverse_range(rows.iter().map(|row| row.depth)));
    for (row, &(panel_width, panel_height)) in rows.iter().zip(&sizes) {
        let panels = [row.photo.clone(), depth_colours(row.depth, range), normal_colours(row.normal), row.last.clone()];
        for (column, (panel, name)) in panels.iter().zip(row.captions).enumerate() {
            let left = MARGIN + column * (widest + GUTTER);
            picture.paste(&resampled(panel, panel_width, panel_height), (left, top), CORNER);
            let baseline = Vec2::new(left as f32 + 2.0, (top + panel_height) as f32 + 22.0);
            caption::draw(&mut picture, name, baseline, X_HEIGHT, INK);
            if let (DEPTH_COLUMN, Some(range)) = (column, range) {
                depth_legend(&mut picture, range, baseline.with_x((left + panel_width) as f32 - 2.0));
            }
        }
        top += panel_height + CAPTION;
    }
    write_png(out, picture.size(), (ColorType::Rgb, BitDepth::Eight), &picture.to_bytes(), &[])
}

fn panel_size(row: &PreviewRow) -> io::Result<(usize, usize)> {
    let PreviewRow { photo, depth, normal, last, .. } = row;
    if photo.is_empty() || !(photo.same_size(depth) && photo.same_size(normal) && photo.same_size(last)) {
        return Err(unfit("the panels of a preview row are empty or differ in size"));
    }
    let scale = PANEL / photo.width().max(photo.height()) as f64;
    let scaled = |side: usize| ((side as f64 * scale).round() as usize).max(1);
    Ok((scaled(photo.width()), scaled(photo.height())))
}

/// 2 % and 98 % quantile of the inverse of valid depths, per scene unit.
fn inverse_range<'a>(depths: impl Iterator<Item = &'a Grid<f32>>) -> Option<(f32, f32)> {
    let valid = depths.flat_map(Grid::as_slice).filter(|z| z.is_finite() && **z > 0.0);
    let mut inverse: Vec<f32> = valid.map(|z| 1.0 / z).collect();
    inverse.sort_unstable_by(f32::total_cmp);
    let last = inverse.len().checked_sub(1)?;
    let quantile = |q: f64| inverse[(q * last as f64).round() as usize];
    Some((quantile(0.02), quantile(0.98)))
}

fn depth_colours(depth: &Grid<f32>, range: Option<(f32, f32)>) -> Grid<[f32; 3]> {
    let (low, high) = range.unwrap_or((0.0, 1.0));
    let span = (high - low).max(f32::MIN_POSITIVE);
    depth.map(|&z| if z.is_finite() && z > 0.0 { depth_colour((1.0 / z - low) / span) } else { NONE })
}

/// The ends of the map are nearly black and deep red, and would pass for "none"; they are left out.
fn depth_colour(nearness: f32) -> [f32; 3] {
    turbo(0.07 + 0.82 * nearness.clamp(0.0, 1.0))
}

/// The usual look of normal maps: towards the viewer is light blue, up is green, right is red.
fn normal_colours(normals: &Grid<[f32; 3]>) -> Grid<[f32; 3]> {
    normals.map(|&[x, y, z]| if x == 0.0 && y == 0.0 && z == 0.0 { NONE } else { [x, -y, -z].map(|n| n * 0.5 + 0.5) })
}

/// `near [colour bar] far`, ending at `right` on the baseline.
fn depth_legend(picture: &mut Picture, (low, high): (f32, f32), right: Vec2) {
    let (near, far) = (1.0 / high, 1.0 / low);
    let (near, far) = (label(near, far - near), label(far, far - near));
    let (bar_width, gap) = (72usize, 9.0);
    let far_left = right.x - caption::width(&far, X_HEIGHT);
    let bar_left = (far_left - gap).round() as usize - bar_width;
    caption::draw(picture, &far, right.with_x(far_left), X_HEIGHT, INK);
    let bar = Grid::from_fn(bar_width, 8, |x, _| depth_colour(1.0 - x as f32 / (bar_width - 1) as f32));
    picture.paste(&bar, (bar_left, right.y as usize - 8), 4.0);
    let near_left = bar_left as f32 - gap - caption::width(&near, X_HEIGHT);
    caption::draw(picture, &near, right.with_x(near_left), X_HEIGHT, INK);
}

/// As many decimals as tell two significant digits of the range.
fn label(depth: f32, range: f32) -> String {
    if !(1e-3..1e6).contains(&depth) {
        return format!("{depth:.1e}");
    }
    let decimals = (1.0 - range.max(depth * 1e-3).log10().floor()).clamp(0.0, 4.0) as usize;
    format!("{depth:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_stray_pixel_does_not_stretch_the_range() {
        let mut depth = Grid::from_fn(100, 10, |x, _| 4.0 + 0.05 * x as f32);
        depth[(0, 0)] = 1e-6;
        depth[(1, 0)] = 0.0;
        depth[(2, 0)] = f32::NAN;
        let (low, high) = inverse_range([&depth].into_iter()).unwrap();
        assert!((1.0 / low - 8.9).abs() < 0.1 && (1.0 / high - 4.1).abs() < 0.1);
        assert!(inverse_range([].into_iter()).is_none());
    }

    #[test]
    fn labels_fit_the_range() {
        assert_eq!((label(4.123, 5.6), label(9.7, 5.6)), ("4.1".into(), "9.7".into()));
        assert_eq!(label(612.4, 300.0), "612");
        assert_eq!(label(0.5, 0.0), "0.5000");
    }
}
