//! Reliability diagrams as one SVG: per method, the share of right answers over their confidence.
//!
//! Text and shapes only. Invariant: honesty is the diagonal; a bin's column is as wide as the others and the less
//! opaque the fewer answers it holds, so that rare boasts do not look common.

use crate::calibration::{Calibration, NUM_BINS};
use std::fmt::Write as _;

const SIDE: f64 = 220.0;
/// Room left, top, right and bottom of a panel's plot.
const MARGIN: [f64; 4] = [44.0, 40.0, 16.0, 38.0];

/// One square panel per title and count, side by side, as an SVG document.
pub fn calibration_svg(panels: &[(String, Calibration)]) -> String {
    let [left, top, right, bottom] = MARGIN;
    let (panel, height) = (left + SIDE + right, top + SIDE + bottom);
    let width = panel * panels.len() as f64;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"11\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    );
    for (i, (title, calibration)) in panels.iter().enumerate() {
        draw(&mut svg, title, calibration, panel * i as f64 + left);
    }
    svg.push_str("</svg>\n");
    svg
}

fn draw(svg: &mut String, title: &str, calibration: &Calibration, x0: f64) {
    let base = MARGIN[1] + SIDE;
    let (x, y) = (|share: f64| x0 + share * SIDE, |share: f64| base - share * SIDE);
    // Writing to a string cannot fail.
    let mut line = |text: String| {
        let _ = writeln!(svg, "{text}");
    };
    let text = |x: f64, y: f64, attributes: &str, text: &str| {
        format!("<text x=\"{x:.1}\" y=\"{y:.1}\" {attributes}>{text}</text>")
    };
    let title = title.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    line(text(x0, 14.0, "font-weight=\"bold\"", &title));
    let error = calibration.error().map_or("no answers".to_owned(), |error| {
        format!("{} answers, calibration error {error:.3}", calibration.count())
    });
    line(text(x0, 29.0, "fill=\"#555555\"", &error));
    line(format!(
        "<rect x=\"{x0:.1}\" y=\"{:.1}\" width=\"{SIDE}\" height=\"{SIDE}\" fill=\"none\" stroke=\"#888888\"/>",
        y(1.0)
    ));
    let most = calibration.bins.iter().map(|bin| bin.count).max().unwrap_or(0).max(1) as f64;
    for (i, bin) in calibration.bins.iter().enumerate().filter(|(_, bin)| bin.count > 0) {
        let (from, share) = (i as f64 / NUM_BINS as f64, bin.share_right());
        let opacity = 0.15 + 0.85 * (bin.count as f64 / most).sqrt();
        line(format!(
            "<rect x=\"{:.2}\" y=\"{:.2}\" width=\"{:.2}\" height=\"{:.2}\" fill=\"#4f81bd\" opacity=\"{opacity:.2}\"/>",
            x(from) + 1.0,
            y(share),
            SIDE / NUM_BINS as f64 - 2.0,
            share * SIDE
        ));
        line(format!(
            "<circle cx=\"{:.2}\" cy=\"{:.2}\" r=\"2.5\" fill=\"#c0504d\"/>",
            x(bin.mean_confidence()),
            y(share)
        ));
    }
    line(format!(
        "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"#000000\" stroke-dasharray=\"4 3\"/>",
        x(0.0),
        y(0.0),
        x(1.0),
        y(1.0)
    ));
    for tick in [0.0, 0.5, 1.0] {
        line(text(x(tick), base + 14.0, "text-anchor=\"middle\" fill=\"#555555\"", &format!("{tick}")));
        line(text(x0 - 5.0, y(tick) + 4.0, "text-anchor=\"end\" fill=\"#555555\"", &format!("{tick}")));
    }
    line(text(x(0.5), base + 30.0, "text-anchor=\"middle\"", "confidence"));
    let (middle_x, middle_y) = (x0 - 28.0, y(0.5));
    let turned = format!("text-anchor=\"middle\" transform=\"rotate(-90 {middle_x:.1} {middle_y:.1})\"");
    line(text(middle_x, middle_y, &turned, "share that is right"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_honest_bin_ends_on_the_diagonal_and_empty_bins_are_not_drawn() {
        let mut calibration = Calibration::default();
        for i in 0..20 {
            calibration.add(0.25, i % 4 == 0);
        }
        let svg = calibration_svg(&[("a & b".to_owned(), calibration), ("none".to_owned(), Calibration::default())]);
        assert_eq!(svg.matches("#4f81bd").count(), 1, "{svg}");
        assert!(svg.contains("a &amp; b") && svg.contains("no answers"));
        let dot = svg.lines().find(|line| line.starts_with("<circle")).unwrap();
        let number = |name: &str| -> f64 {
            dot.split(&format!("{name}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
        };
        let (right, up) = (number("cx") - MARGIN[0], MARGIN[1] + SIDE - number("cy"));
        assert!((right - up).abs() < 0.02 && (right - 0.25 * SIDE).abs() < 0.02, "{dot}");
    }
}
