//! Histograms of frequency ratios as one SVG: small panels, counts on a logarithmic axis, the threshold at 1.
//!
//! Text and shapes only, so that any browser shows it and a diff says what changed. Invariant: a bar's height is the
//! logarithm of its count, an empty bin has no bar, and what lies beyond the axis is written as a number.

use crate::nyquist_stats::{MAX_RATIO, NUM_BINS, NyquistHistogram};
use std::fmt::Write as _;

/// One panel.
#[derive(Clone, Copy, Debug)]
pub struct Panel<'a> {
    /// Heading.
    pub title: &'a str,
    /// The counts.
    pub histogram: &'a NyquistHistogram,
}

const WIDTH: f64 = 300.0;
const HEIGHT: f64 = 190.0;
/// Room left, top, right and bottom of a panel's plot.
const MARGIN: [f64; 4] = [44.0, 34.0, 12.0, 34.0];

/// The panels row by row as an SVG document.
pub fn histogram_svg(rows: &[Vec<Panel>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let (width, height) = (WIDTH * columns as f64, HEIGHT * rows.len() as f64);
    // One scale for all panels, or heights would not compare.
    let largest = rows.iter().flatten().flat_map(|panel| &panel.histogram.bins).max().copied().unwrap_or(0);
    let decades = (largest.max(10) as f64).log10().ceil();
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"11\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    );
    for (row, panels) in rows.iter().enumerate() {
        for (column, panel) in panels.iter().enumerate() {
            draw(&mut svg, panel, WIDTH * column as f64, HEIGHT * row as f64, decades);
        }
    }
    svg.push_str("</svg>\n");
    svg
}

fn draw(svg: &mut String, panel: &Panel, x0: f64, y0: f64, decades: f64) {
    let [left, top, right, bottom] = MARGIN;
    let (plot_w, plot_h) = (WIDTH - left - right, HEIGHT - top - bottom);
    let x = |ratio: f64| x0 + left + ratio / MAX_RATIO * plot_w;
    let y = |log: f64| y0 + top + (1.0 - log / decades) * plot_h;
    let base = y(0.0);
    // Writing to a string cannot fail.
    let mut line = |text: String| {
        let _ = writeln!(svg, "{text}");
    };
    line(format!(
        "<text x=\"{:.1}\" y=\"{:.1}\" font-weight=\"bold\">{}</text>",
        x(0.0),
        y0 + 14.0,
        escaped(panel.title)
    ));
    let h = panel.histogram;
    let beyond = if h.beyond > 0 { format!(", {} beyond {MAX_RATIO}", h.beyond) } else { String::new() };
    line(format!(
        "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"#555555\">{:.1} % of {} above 1{beyond}</text>",
        x(0.0),
        y0 + 28.0,
        100.0 * h.fraction_above_one,
        h.num_surfels
    ));
    for decade in 0..=decades as usize {
        let at = y(decade as f64);
        line(format!(
            "<line x1=\"{:.1}\" y1=\"{at:.1}\" x2=\"{:.1}\" y2=\"{at:.1}\" stroke=\"#e0e0e0\"/>",
            x(0.0),
            x(MAX_RATIO)
        ));
        line(format!(
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#555555\">1e{decade}</text>",
            x(0.0) - 4.0,
            at + 4.0
        ));
    }
    let bin = MAX_RATIO / NUM_BINS as f64;
    for (i, &count) in h.bins.iter().enumerate().filter(|(_, count)| **count > 0) {
        // A single surfel must show, although its logarithm is 0.
        let top_of_bar = y((count as f64).log10().max(0.02 * decades));
        let (from, to) = (x(i as f64 * bin), x((i + 1) as f64 * bin));
        let fill = if i as f64 * bin >= 1.0 { "#c0504d" } else { "#4f81bd" };
        line(format!(
            "<rect x=\"{from:.2}\" y=\"{top_of_bar:.2}\" width=\"{:.2}\" height=\"{:.2}\" fill=\"{fill}\"/>",
            to - from,
            base - top_of_bar
        ));
    }
    line(format!(
        "<line x1=\"{0:.1}\" y1=\"{1:.1}\" x2=\"{0:.1}\" y2=\"{base:.1}\" stroke=\"#000000\" stroke-dasharray=\"4 3\"/>",
        x(1.0),
        y(decades)
    ));
    for ratio in 0..=MAX_RATIO as usize {
        line(format!(
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#555555\">{ratio}</text>",
            x(ratio as f64),
            base + 14.0
        ));
    }
    line(format!(
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">surfel frequency over Nyquist frequency</text>",
        x(MAX_RATIO / 2.0),
        base + 28.0
    ));
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_filled_bin_is_a_bar_and_those_above_one_are_red() {
        let histogram = NyquistHistogram::new([0.31, 0.32, 0.99, 1.01, 4.99, 7.0]);
        let svg = histogram_svg(&[vec![Panel { title: "before & after", histogram: &histogram }]]);
        assert_eq!(svg.matches("#4f81bd").count(), 2, "{svg}");
        assert_eq!(svg.matches("#c0504d").count(), 2);
        assert!(svg.contains("before &amp; after") && svg.contains("50.0 % of 6 above 1, 1 beyond 5"));
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
    }

    #[test]
    fn heights_are_logarithms_on_one_scale() {
        let many = NyquistHistogram::new(std::iter::repeat_n(0.5, 1000));
        let few = NyquistHistogram::new(std::iter::repeat_n(0.5, 10));
        let svg =
            histogram_svg(&[vec![Panel { title: "many", histogram: &many }, Panel { title: "few", histogram: &few }]]);
        let heights: Vec<f64> = svg
            .lines()
            .filter(|line| line.contains("#4f81bd"))
            .map(|line| line.split("height=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap())
            .collect();
        assert!((heights[0] / heights[1] - 3.0).abs() < 0.01, "{heights:?}");
        let empty = histogram_svg(&[vec![Panel { title: "none", histogram: &NyquistHistogram::new([]) }]]);
        assert!(!empty.contains("#4f81bd"));
    }
}
