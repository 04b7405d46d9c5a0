//! Does every surfel obey the Nyquist criterion? The paper's verification as histograms (spec 7.7).
//!
//! Surfels as first placed, after the adaptation and as finally rendered, each against the sampling rate of the finest
//! view that sees it, in the dimensionally consistent reading and in the paper's literal one (millimetres). Invariant:
//! the three states hold the same surfels in the same order, so a surfel left out of one is left out of all.

use crate::reconstruct::{DepthSource, Options, Walked};
use glam::Vec3;
use surfel_core::Camera;
use surfel_core::nyquist::{NyquistMode, frequency_ratio};
use surfel_eval::histogram_plot::{Panel, histogram_svg};
use surfel_eval::nyquist_stats::{NyquistHistogram, SampledSurfel};
use surfel_eval::report::{Cell, Figure, Report, Table};

/// Opacity below which the surfels of a pixel show no surface.
const SOLID: f32 = 0.5;

/// The same surfels in their three states, as the finest view samples them.
#[derive(Clone, Debug, Default)]
pub struct SurfelStates {
    /// As first placed.
    pub before: Vec<SampledSurfel>,
    /// After the low-pass filter.
    pub adapted: Vec<SampledSurfel>,
    /// As rendered.
    pub last: Vec<SampledSurfel>,
}

impl SurfelStates {
    /// The states of a finished road, lengths in `mm_per_unit` millimetres per scene unit; surfels outside the depth
    /// range or where the rendered opacity is below one half are left out (spec 7.7).
    pub fn of(walked: &Walked, options: &Options, mm_per_unit: f64) -> Self {
        let first = walked.scales_before_and_after_adaptation(options);
        let scale = walked.road.scene_from_working.scale * mm_per_unit;
        let margin = options.surfels.visibility_margin;
        let mut states = Self::default();
        let rows = first.initial.iter().zip(&first.adapted).zip(&walked.surfels.scales).zip(&walked.surfels.centres);
        for (((before, adapted), last), &centre) in rows {
            let Some((camera, depth)) = finest_view(walked, centre, margin) else { continue };
            let sampled = |scales: &[f32; 2]| SampledSurfel {
                scales: scales.map(|s| (f64::from(s) * scale) as f32),
                depth: (depth * scale) as f32,
                focal: [camera.intrinsics.fx, camera.intrinsics.fy],
            };
            states.before.push(sampled(before));
            states.adapted.push(sampled(adapted));
            states.last.push(sampled(last));
        }
        states
    }

    /// Appends those of another scene.
    pub fn extend(&mut self, other: Self) {
        self.before.extend(other.before);
        self.adapted.extend(other.adapted);
        self.last.extend(other.last);
    }

    /// Histograms before, after and of the final surfels. `s` is the width of the low-pass filter in pixels: the
    /// consistent reading measures the adapted surfels, the literal one adapts by its own formula.
    pub fn histograms(&self, mode: NyquistMode, s: f64) -> [NyquistHistogram; 3] {
        let ratios = |surfels: &[SampledSurfel]| NyquistHistogram::new(surfels.iter().map(|f| f.frequency_ratio(mode)));
        let after = match mode {
            NyquistMode::Consistent => ratios(&self.adapted),
            NyquistMode::PaperLiteral => NyquistHistogram::new(self.before.iter().map(|f| f.adapted_ratio(mode, s))),
        };
        [ratios(&self.before), after, ratios(&self.last)]
    }
}

/// The view with the finest sampling rate among those that see `centre` as solid surface within their range, and the
/// depth there, working units.
fn finest_view(walked: &Walked, centre: [f32; 3], margin: f64) -> Option<(&Camera, f64)> {
    let point = Vec3::from(centre).as_dvec3();
    let mut solid = false;
    let mut finest: Option<(&Camera, f64, f64)> = None;
    for ((view, maps), &(near, far)) in walked.road.views.iter().zip(&walked.maps).zip(&walked.road.ranges) {
        let Some((pixel, z)) = view.camera.project(point) else { continue };
        let (mx, my) = (margin * view.camera.width as f64, margin * view.camera.height as f64);
        let inside = pixel.x > -mx
            && pixel.y > -my
            && pixel.x < view.camera.width as f64 + mx
            && pixel.y < view.camera.height as f64 + my;
        if !inside {
            continue;
        }
        let alpha = maps.alpha.get(pixel.x.floor() as isize, pixel.y.floor() as isize);
        solid |= (near..=far).contains(&z) && alpha.is_some_and(|&alpha| alpha >= SOLID);
        let rate = view.camera.intrinsics.mean_focal() / z;
        if finest.is_none_or(|(.., best)| rate > best) {
            finest = Some((&view.camera, z, rate));
        }
    }
    finest.filter(|_| solid).map(|(camera, z, _)| (camera, z))
}

/// The report: what was counted, one row per reading and state, and the plot.
pub fn report(states: &SurfelStates, options: &Options, scenes: &str, mm_per_unit: f64) -> Report {
    let s = low_pass(options);
    let columns = ["reading", "surfels", "counted", "above 1", "median ratio", "largest ratio"];
    let mut table = Table::new("Surfel frequency over Nyquist frequency", columns);
    let readings = [(NyquistMode::Consistent, "consistent"), (NyquistMode::PaperLiteral, "paper, literal")];
    let names = ["before adaptation", "after adaptation", "final"];
    let histograms = readings.map(|(mode, _)| states.histograms(mode, s));
    for ((_, reading), histograms) in readings.iter().zip(&histograms) {
        for (name, histogram) in names.iter().zip(histograms) {
            table.push([
                (*reading).into(),
                (*name).into(),
                Cell::Count(histogram.num_surfels),
                Cell::Share(histogram.fraction_above_one),
                Cell::Value(histogram.median_ratio, 3),
                Cell::Value(histogram.max_ratio, 3),
            ]);
        }
    }
    let titles: Vec<Vec<String>> =
        readings.iter().map(|(_, reading)| names.iter().map(|name| format!("{reading}: {name}")).collect()).collect();
    let panel = |(title, histogram)| Panel { title, histogram };
    let rows: Vec<Vec<Panel>> = titles
        .iter()
        .zip(&histograms)
        .map(|(titles, histograms)| titles.iter().map(String::as_str).zip(histograms).map(panel).collect())
        .collect();
    Report {
        title: "Nyquist criterion of the surfels".to_owned(),
        notes: notes(options, scenes, mm_per_unit, bound(s)),
        tables: vec![table, bins_table(&readings.map(|(_, name)| name), &names, &histograms)],
        figures: vec![Figure {
            title: "Histograms of surfel frequency over Nyquist frequency".to_owned(),
            file: "nyquist.svg".to_owned(),
            content: histogram_svg(&rows).into_bytes(),
        }],
    }
}

/// The largest consistent ratio after low-pass filtering by `s` pixels: `2 / (pi s)`.
pub fn bound(s: f64) -> f64 {
    frequency_ratio(s, 1.0)
}

fn notes(options: &Options, scenes: &str, mm_per_unit: f64, bound: f64) -> Vec<String> {
    vec![
        format!("Scenes: {scenes}. The criterion holds where the ratio is at most 1."),
        format!(
            "Consistent: rate f/d per length; after a low-pass of {} px no ratio can exceed {bound:.4}. Literal: rate \
             fx fy/d² as printed in the paper, which only means something in millimetres (here {mm_per_unit} mm per \
             scene unit) and near one pixel per millimetre; scales are raised to 2/pi mm first, as its proof assumes.",
            low_pass(options)
        ),
        first_scale(options),
        "Each surfel counts once, against the finest view that sees it; surfels outside the depth range or under a \
         rendered opacity of 0.5 are left out. 100 bins from 0 to 5, counts on a logarithmic axis."
            .to_owned(),
    ]
}

/// Where the scales before the adaptation come from.
fn first_scale(options: &Options) -> String {
    match &options.depth {
        DepthSource::Matching => format!(
            "No network predicts the first scale: it is set to {} px of footprint, so the histogram before adaptation \
             shows that choice; the final surfels are the adapted ones.",
            options.surfels.footprint_px
        ),
        DepthSource::Network(_) => "Before: the first pass of the network's head; after: those surfels adapted, which \
             shape the regions that features are gathered from; final: the second pass, which is rendered as it is."
            .to_owned(),
    }
}

/// Width of the low-pass filter in pixels.
fn low_pass(options: &Options) -> f64 {
    match &options.depth {
        DepthSource::Matching => options.surfels.low_pass_px,
        DepthSource::Network(net) => net.config().nyquist.s,
    }
}

fn bins_table(readings: &[&str; 2], names: &[&str; 3], histograms: &[[NyquistHistogram; 3]; 2]) -> Table {
    let series: Vec<(String, &NyquistHistogram)> = readings
        .iter()
        .zip(histograms)
        .flat_map(|(reading, row)| names.iter().zip(row).map(move |(name, h)| (format!("{reading}, {name}"), h)))
        .collect();
    let columns = ["from".to_owned()].into_iter().chain(series.iter().map(|(name, _)| name.clone()));
    let mut table = Table::new("Counts per bin", columns);
    let width = surfel_eval::nyquist_stats::MAX_RATIO / surfel_eval::nyquist_stats::NUM_BINS as f64;
    for bin in 0..surfel_eval::nyquist_stats::NUM_BINS {
        // Bins that are empty in every series would only lengthen the table.
        if series.iter().any(|(_, h)| h.bins[bin] > 0) {
            let counts = series.iter().map(|(_, h)| Cell::Count(h.bins[bin]));
            table.push([Cell::Value(bin as f64 * width, 2)].into_iter().chain(counts));
        }
    }
    table
}
