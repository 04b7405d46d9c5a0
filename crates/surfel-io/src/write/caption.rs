//! A small drawn alphabet for captions: single strokes with round ends, at any size, anti-aliased.
//!
//! A glyph is a list of strokes, a stroke a list of `xy` digit pairs: baseline at y = 2, small letters up
//! to 6, tall ones to 8, tails down to 0. Strokes are control polygons of quadratic splines, so corners
//! round off; a sharp corner is two strokes. Invariant: unknown characters leave a gap, never fail.

use super::picture::Picture;
use glam::Vec2;

/// Gap between glyphs, in font units.
const SPACING: f32 = 1.7;
/// Stroke width, in font units.
const WEIGHT: f32 = 0.72;

/// Draws `text` with its baseline at `origin` (pixels, y down) and small letters `x_height` pixels tall.
pub(super) fn draw(picture: &mut Picture, text: &str, origin: Vec2, x_height: f32, colour: [f32; 3]) {
    let unit = x_height / 4.0;
    let mut pen = origin.x;
    for glyph in text.chars().map(glyph) {
        for stroke in glyph.split_whitespace() {
            let curve: Vec<Vec2> = spline(&points(stroke))
                .iter()
                .map(|p| Vec2::new(pen + p.x * unit, origin.y - (p.y - 2.0) * unit))
                .collect();
            picture.stroke(&curve, WEIGHT * unit, colour);
        }
        pen += (width_of(glyph) + SPACING) * unit;
    }
}

/// Width of `text` in pixels.
pub(super) fn width(text: &str, x_height: f32) -> f32 {
    let units: f32 = text.chars().map(|c| width_of(glyph(c)) + SPACING).sum();
    (units - SPACING).max(0.0) * x_height / 4.0
}

fn width_of(glyph: &str) -> f32 {
    if glyph.is_empty() {
        return 1.0;
    }
    glyph.split_whitespace().flat_map(points).fold(0.0, |widest, p| widest.max(p.x))
}

fn points(stroke: &str) -> Vec<Vec2> {
    let digits: Vec<f32> = stroke.bytes().map(|b| f32::from(b.saturating_sub(b'0'))).collect();
    digits.chunks_exact(2).map(|xy| Vec2::new(xy[0], xy[1])).collect()
}

/// Three rounds of corner cutting: the quadratic B-spline of the polygon, clamped at open ends.
fn spline(polygon: &[Vec2]) -> Vec<Vec2> {
    let closed = polygon.len() > 3 && polygon.first() == polygon.last();
    (0..3).fold(polygon.to_vec(), |line, _| {
        if line.len() < 3 {
            return line;
        }
        let cut = line.windows(2).flat_map(|ends| [ends[0].lerp(ends[1], 0.25), ends[0].lerp(ends[1], 0.75)]);
        let mut cut: Vec<Vec2> = cut.collect();
        if closed {
            cut.push(cut[0]);
        } else {
            let last = cut.len() - 1;
            (cut[0], cut[last]) = (line[0], line[line.len() - 1]);
        }
        cut
    })
}

fn glyph(character: char) -> &'static str {
    match character.to_ascii_lowercase() {
        'a' => "0206363202 3632",
        'b' => "0802 0206363202",
        'c' => "353606023233",
        'd' => "3832 0206363202",
        'e' => "0434 343606023233",
        'f' => "28181612 0626",
        'g' => "0206363202 36323000",
        'h' => "0802 0406363432",
        'i' => "0602 0808",
        'j' => "16121000 1818",
        'k' => "0802 3603 1432",
        'l' => "0802",
        'm' => "0602 0406262422 2426464442",
        'n' => "0602 0406363432",
        'o' => "0206363202",
        'p' => "0600 0206363202",
        'q' => "0206363202 3630",
        'r' => "0602 040626",
        's' => "360604343202",
        't' => "17131222 0626",
        'u' => "0604023234 3632",
        'v' => "0622 2246",
        'w' => "0612 1226 2632 3246",
        'x' => "0632 0236",
        'y' => "0622 4610",
        'z' => "0636 3602 0232",
        '0' => "0208383202",
        '1' => "0718 1812",
        '2' => "0708383502 0232",
        '3' => "0708383515 1535320203",
        '4' => "2804 0434 2822",
        '5' => "3808 0805 050636320203",
        '6' => "0206363202 280804",
        '7' => "0838 3812",
        '8' => "0205353202 0508383505",
        '9' => "0408383404 363212",
        '.' => "0202",
        ':' => "0202 0505",
        '-' => "0424",
        '–' => "0434",
        '+' => "0424 1315",
        '/' => "0138",
        '_' => "0131",
        '(' => "18080212",
        ')' => "08181202",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_strokes_stay_closed_and_open_ends_stay_put() {
        let bowl = spline(&points("0206363202"));
        assert_eq!(bowl.first(), bowl.last());
        let hook = spline(&points("28181612"));
        assert_eq!((hook[0], hook[hook.len() - 1]), (Vec2::new(2.0, 8.0), Vec2::new(1.0, 2.0)));
    }

    #[test]
    fn every_glyph_is_made_of_digit_pairs() {
        for c in (' '..='~').chain(['–']) {
            let strokes = glyph(c).split_whitespace();
            assert!(strokes.into_iter().all(|s| s.len() % 2 == 0 && s.bytes().all(|b| b.is_ascii_digit())), "{c}");
        }
    }
}
