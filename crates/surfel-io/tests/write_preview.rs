//! The preview picture, decoded: what is where, and in which colour.

use surfel_core::Grid;
use surfel_io::write::preview::{CAPTIONS, PreviewRow, write_preview};

const PAPER: [u8; 3] = [250, 250, 249];

fn distance(a: [u8; 3], b: [u8; 3]) -> u8 {
    a.into_iter().zip(b).map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0)
}

#[test]
fn four_panels_in_a_row_over_their_captions() {
    let (width, height) = (110, 80);
    let photo = Grid::filled(width, height, [0.2, 0.4, 0.6]);
    // Near on the left, far on the right, none in the lower half.
    let depth = Grid::from_fn(width, height, |x, y| if y < 40 { 2.0 + x as f32 / 10.0 } else { 0.0 });
    let normal = Grid::from_fn(width, height, |_, y| if y < 40 { [0.0, 0.0, -1.0] } else { [0.0; 3] });
    let mesh = Grid::filled(width, height, [0.9, 0.1, 0.1]);
    let row =
        PreviewRow { photo: &photo, depth: &depth, believed: &depth, normal: &normal, last: &mesh, captions: CAPTIONS };
    // A far wall that nobody believes in leaves the colours alone.
    let wall = Grid::from_fn(width, height, |x, y| if y < 40 { 2.0 + x as f32 / 10.0 } else { 500.0 });
    let doubted = PreviewRow { depth: &wall, ..row };
    let mut bytes = Vec::new();
    write_preview(&mut bytes, &[row, doubted]).unwrap();
    let picture = image::load_from_memory(&bytes).unwrap().into_rgb8();

    // Panels are 440 x 320 with margins of 28 and gutters of 14.
    assert_eq!(picture.width(), 2 * 28 + 4 * 440 + 3 * 14);
    let at = |panel: u32, x: u32, y: u32| picture.get_pixel(28 + panel * 454 + x, 28 + y).0;
    assert_eq!(at(0, 220, 160), [51, 102, 153]);
    assert_eq!(at(3, 220, 160), [230, 26, 26]);
    let (near, far, none) = (at(1, 20, 80), at(1, 420, 80), at(1, 220, 240));
    assert!(near[0] > near[2] && far[2] > far[0], "near {near:?}, far {far:?}");
    assert!(none.iter().all(|&channel| channel < 60));
    let below = 320 + 40;
    assert_eq!([at(1, 20, below + 80), at(1, 420, below + 80)], [near, far]);
    assert!(distance(at(1, 220, below + 240), at(1, 434, 80)) < 30, "the wall is as far as colours go");
    assert!(distance(at(2, 220, 80), [128, 128, 255]) <= 1 && at(2, 220, 240) == none);
    // Corners are round, the margin is paper, and there is writing under every panel.
    for panel in 0..4 {
        assert_eq!(at(panel, 0, 0), PAPER);
        let caption = (0..100).flat_map(|x| (322..356).map(move |y| (x, y)));
        let num_ink = caption.filter(|&(x, y)| distance(at(panel, x, y), PAPER) > 100).count();
        assert!(num_ink > 50, "panel {panel}: {num_ink} pixels of ink");
    }
}

/// A row that shows `colour` in every panel but that of `depth`.
fn plain_row<'a>(colour: &'a Grid<[f32; 3]>, depth: &'a Grid<f32>) -> PreviewRow<'a> {
    PreviewRow { photo: colour, depth, believed: depth, normal: colour, last: colour, captions: CAPTIONS }
}

#[test]
fn a_view_without_any_depth_still_has_a_preview() {
    let (colour, depth) = (Grid::filled(3, 200, [0.5; 3]), Grid::filled(3, 200, 0.0));
    let mut bytes = Vec::new();
    write_preview(&mut bytes, &[plain_row(&colour, &depth)]).unwrap();
    assert_eq!(image::load_from_memory(&bytes).unwrap().height(), 28 + 440 + 40 + 14);
}

#[test]
fn rows_of_mixed_sizes_are_refused() {
    let (colour, depth) = (Grid::filled(4, 3, [0.5; 3]), Grid::filled(4, 4, 1.0));
    assert!(write_preview(&mut Vec::new(), &[plain_row(&colour, &depth)]).is_err());
    assert!(write_preview(&mut Vec::new(), &[]).is_err());
}
