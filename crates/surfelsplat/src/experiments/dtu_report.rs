//! The tables of the DTU benchmark: every score, then ours beside the paper's table 1.
//!
//! Invariant: a mean is only shown over the scans that were scored, and the paper's rows are averaged over the same
//! ones.

use super::dtu::DtuResult;
use surfel_eval::cull::Cull;
use surfel_eval::paper_tables::{DTU_SCANS, TABLE_1};
use surfel_eval::report::{Cell, Report, Table};

/// What the meshes were compared with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GroundName {
    /// The official structured-light scans.
    Official,
    /// Reference points of a scene.
    Points(String),
}

/// The report of all results.
pub fn report(results: &[DtuResult], ground: &GroundName) -> Report {
    let columns = ["mesh", "scan", "culling", "masks", "d2s", "s2d", "overall", "points", "triangles"];
    let mut table = Table::new("DTU protocol, millimetres", columns);
    for r in results {
        table.push([
            r.name.clone().into(),
            Cell::Text(r.scan.to_string()),
            r.cull.name().into(),
            Cell::Count(r.num_masks as u64),
            Cell::Value(r.score.d2s, 3),
            Cell::Value(r.score.s2d, 3),
            Cell::Value(r.score.overall, 3),
            Cell::Count(r.score.num_data_points as u64),
            Cell::Count(r.num_triangles as u64),
        ]);
    }
    let mut tables = vec![table];
    let in_table_1 = results.iter().any(|r| DTU_SCANS.contains(&r.scan));
    if *ground == GroundName::Official && in_table_1 {
        tables.push(beside_table_1(results));
    }
    Report { title: "DTU surface benchmark".to_owned(), notes: notes(ground), tables, figures: Vec::new() }
}

fn notes(ground: &GroundName) -> Vec<String> {
    let mut notes = vec![
        "Points 0.2 mm apart, distances from 20 mm on discarded. d2s: mesh to reference (accuracy); s2d: reference to \
         mesh (completeness); overall: their mean. Culling `dense`: masks of all photographs grown by 24 px at 1600 \
         px width, as the script of 2D Gaussian splatting does it; `sparse`: masks and first-seen faces of the input \
         photographs, as the sparse-view literature does it; `none`: the mesh as it is."
            .to_owned(),
    ];
    match ground {
        GroundName::Official => notes.push(
            "Reference: the official structured-light scans with ObsMask and Plane. Compare `overall` with the \
             paper's table 1, whose rows follow published overall values although its caption says D2S. The paper \
             does not say which two photographs it uses and fine-tunes on test scans."
                .to_owned(),
        ),
        GroundName::Points(origin) => notes.push(format!(
            "Reference: {origin}. These are NOT the official structured-light scans, and there is no ObsMask and no \
             Plane: nothing here may be compared with the paper's table 1 or any published DTU figure."
        )),
    }
    notes
}

/// Ours, per mesh name and culling rule, over the rows of table 1.
fn beside_table_1(results: &[DtuResult]) -> Table {
    let scans: Vec<u32> = DTU_SCANS.into_iter().filter(|scan| results.iter().any(|r| r.scan == *scan)).collect();
    let columns = ["method".to_owned()].into_iter().chain(scans.iter().map(u32::to_string)).chain(["mean".to_owned()]);
    let mut table = Table::new("Overall beside the paper's table 1, millimetres", columns);
    for row in &TABLE_1 {
        let values: Vec<f64> = scans.iter().filter_map(|&scan| row.scan(scan)).collect();
        table.push(cells(row.method.to_owned(), &values, 2));
    }
    for rule in Cull::ALL {
        let of = |scan: u32| {
            let scores: Vec<f64> =
                results.iter().filter(|r| r.cull == rule && r.scan == scan).map(|r| r.score.overall).collect();
            scores.iter().sum::<f64>() / scores.len() as f64
        };
        if results.iter().any(|r| r.cull == rule) {
            let values: Vec<f64> = scans.iter().map(|&scan| of(scan)).collect();
            table.push(cells(format!("ours, culling {}", rule.name()), &values, 3));
        }
    }
    table
}

fn cells(method: String, values: &[f64], decimals: usize) -> Vec<Cell> {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    [Cell::Text(method)].into_iter().chain(values.iter().chain([&mean]).map(|&v| Cell::Value(v, decimals))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_eval::dtu::DtuScore;

    fn result(scan: u32, overall: f64) -> DtuResult {
        let score = DtuScore { d2s: overall, s2d: overall, overall, num_data_points: 1, num_surface_points: 1 };
        DtuResult { name: "m".into(), scan, cull: Cull::Dense, num_masks: 49, num_triangles: 1, score }
    }

    #[test]
    fn the_papers_rows_are_averaged_over_the_scans_that_were_scored() {
        let table = &report(&[result(24, 1.0), result(37, 2.0)], &GroundName::Official).tables[1];
        assert_eq!(table.columns, ["method", "24", "37", "mean"]);
        let paper = table.rows.iter().find(|row| row[0] == Cell::Text("SurfelSplat (paper)".into())).unwrap();
        assert_eq!(paper[3], Cell::Value((1.23 + 1.69) / 2.0, 2));
        assert_eq!(table.rows.last().unwrap()[3], Cell::Value(1.5, 3));
    }

    #[test]
    fn other_references_are_never_put_beside_the_paper() {
        let report = report(&[result(24, 1.0)], &GroundName::Points("stereo points".into()));
        assert_eq!(report.tables.len(), 1);
        assert!(report.notes[1].contains("stereo points") && report.notes[1].contains("NOT the official"));
    }
}
