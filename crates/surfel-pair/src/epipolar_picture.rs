//! The picture that convinces people: matches and their epipolar lines, side by side.
//!
//! With right cameras every line runs through its point. Written by `inspect`. The invariant: the two
//! photographs keep their pixels apart from the lines, the left one in the top-left corner.

use crate::Match;
use crate::epipolar::{EpipolarGeometry, inlier_distance};
use glam::{DVec2, DVec3};
use surfel_core::{Grid, View};

/// Columns between the two photographs.
const GAP: usize = 8;
/// Half the thickness of a line, pixels.
const LINE_RADIUS: f64 = 0.7;
/// Radius of the ring around a matched point, pixels.
const RING_RADIUS: f64 = 5.0;

/// Draws view `a` left and view `b` right with about `count` well-spread matches: a ring at each point and the
/// epipolar line of its partner, one colour per match. Without a baseline there are rings only.
pub fn epipolar_picture(a: &View, b: &View, matches: &[Match], count: usize) -> Grid<[f32; 3]> {
    let offset = a.image.width() + GAP;
    let (width, height) = (offset + b.image.width(), a.image.height().max(b.image.height()));
    let mut picture = Grid::from_fn(width, height, |x, y| {
        let left = a.image.get(x as isize, y as isize);
        let right = b.image.get(x as isize - offset as isize, y as isize);
        left.or(right).copied().unwrap_or([1.0; 3])
    });
    let geometry = EpipolarGeometry::of(&a.camera, &b.camera);
    let chosen = well_spread(matches, count, a.image.width().max(a.image.height()) as f64);
    for (i, m) in chosen.iter().enumerate() {
        let colour = distinct_colour(i, chosen.len());
        let mut left = Canvas { picture: &mut picture, x0: 0, width: a.image.width(), height: a.image.height() };
        left.ring(m.a, colour);
        if let Some(line) = geometry.and_then(|geometry| geometry.line_in_a(m.b)) {
            left.line(line, colour);
        }
        let mut right = Canvas { picture: &mut picture, x0: offset, width: b.image.width(), height: b.image.height() };
        right.ring(m.b, colour);
        if let Some(line) = geometry.and_then(|geometry| geometry.line_in_b(m.a)) {
            right.line(line, colour);
        }
    }
    picture
}

/// Matches for [`epipolar_picture`] that agree among themselves, so that wrong matches do not discredit right cameras.
pub fn trustworthy(a: &View, b: &View, matches: &[Match]) -> Vec<Match> {
    match crate::consensus(matches, inlier_distance(&a.camera, &b.camera)) {
        Some(rigid) => rigid.inliers.into_iter().map(|i| matches[i]).collect(),
        None => matches.to_vec(),
    }
}

/// Takes the best match, then again and again the best one that keeps its distance from all taken; the
/// distance shrinks until enough are found.
fn well_spread(matches: &[Match], count: usize, longest_side: f64) -> Vec<Match> {
    let mut taken: Vec<Match> = Vec::new();
    let mut distance = 0.5 * longest_side;
    while taken.len() < count.min(matches.len()) && distance > 1.0 {
        for m in matches {
            let is_apart = taken.iter().all(|other| (other.a - m.a).length() > distance);
            if is_apart && taken.len() < count {
                taken.push(*m);
            }
        }
        distance *= 0.8;
    }
    taken
}

/// Fully saturated hues, evenly spaced.
fn distinct_colour(i: usize, count: usize) -> [f32; 3] {
    let hue = 6.0 * i as f32 / count.max(1) as f32;
    [5.0f32, 3.0, 1.0].map(|phase| {
        let k = (phase + hue) % 6.0;
        1.0 - k.min(4.0 - k).clamp(0.0, 1.0)
    })
}

/// One photograph inside the picture; nothing is drawn outside it.
struct Canvas<'a> {
    picture: &'a mut Grid<[f32; 3]>,
    x0: usize,
    width: usize,
    height: usize,
}

impl Canvas<'_> {
    fn line(&mut self, line: DVec3, colour: [f32; 3]) {
        self.paint(colour, |p| line.dot(p.extend(1.0)).abs() < LINE_RADIUS);
    }

    fn ring(&mut self, centre: DVec2, colour: [f32; 3]) {
        self.paint(colour, |p| ((p - centre).length() - RING_RADIUS).abs() < 1.2);
    }

    fn paint(&mut self, colour: [f32; 3], is_inside: impl Fn(DVec2) -> bool) {
        for y in 0..self.height {
            for x in 0..self.width {
                if is_inside(DVec2::new(x as f64 + 0.5, y as f64 + 0.5)) {
                    self.picture[(self.x0 + x, y)] = colour;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_core::{Camera, Intrinsics, Rigid};

    #[test]
    fn lines_of_a_rectified_pair_are_rows_through_the_points() {
        let camera = |x: f64| Camera {
            intrinsics: Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0 },
            width: 64,
            height: 48,
            camera_from_world: Rigid { translation: DVec3::new(-x, 0.0, 0.0), ..Rigid::IDENTITY },
        };
        let view = |x| View::new("gray", Grid::filled(64, 48, [0.5; 3]), camera(x));
        let m = Match { a: DVec2::new(40.0, 20.5), b: DVec2::new(30.0, 20.5), score: 1.0 };
        let picture = epipolar_picture(&view(0.0), &view(1.0), &[m], 12);
        assert_eq!((picture.width(), picture.height()), (64 + GAP + 64, 48));
        for x in [0, 63, 64 + GAP, 64 + GAP + 63] {
            assert_ne!(picture[(x, 20)], [0.5; 3], "column {x}");
            assert_eq!(picture[(x, 30)], [0.5; 3], "column {x}");
        }
        assert_eq!(picture[(64 + GAP / 2, 20)], [1.0; 3], "the gap stays white");
    }
}
