//! Tables of scores as Markdown for people and JSON for programs, with the pictures that go with them.
//!
//! Invariant: every row has as many cells as its table has columns, and both forms show the same cells.

use serde::{Serialize, Serializer};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use surfel_io::write::{StagedDir, WriteError};

/// A report: a title, what was measured how, tables and pictures.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// Heading.
    pub title: String,
    /// Paragraphs before the tables: protocol, settings, versions.
    pub notes: Vec<String>,
    /// The tables, in order.
    pub tables: Vec<Table>,
    /// Pictures, after the tables.
    pub figures: Vec<Figure>,
}

/// A picture that is written beside the report.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Figure {
    /// What it shows.
    pub title: String,
    /// File name, relative to the report.
    pub file: String,
    /// The bytes of the file: PNG, SVG, ...
    #[serde(skip)]
    pub content: Vec<u8>,
}

/// A table with named columns.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Table {
    /// Heading.
    pub title: String,
    /// Column names, with units.
    pub columns: Vec<String>,
    /// Rows of as many cells as there are columns.
    pub rows: Vec<Vec<Cell>>,
}

/// One entry of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// A word.
    Text(String),
    /// A count.
    Count(u64),
    /// A measured value and the number of decimals people are shown; not finite means "no value".
    Value(f64, usize),
    /// A share in \[0, 1\], shown as per cent with one decimal.
    Share(f64),
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl Serialize for Cell {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Text(text) => serializer.serialize_str(text),
            Self::Count(count) => serializer.serialize_u64(*count),
            Self::Value(value, _) | Self::Share(value) if value.is_finite() => serializer.serialize_f64(*value),
            Self::Value(..) | Self::Share(_) => serializer.serialize_none(),
        }
    }
}

impl Cell {
    fn to_markdown(&self) -> String {
        match self {
            Self::Text(text) => text.replace('|', "\\|").replace('\n', " "),
            Self::Count(count) => count.to_string(),
            Self::Value(value, decimals) if value.is_finite() => format!("{value:.decimals$}"),
            Self::Share(share) if share.is_finite() => format!("{:.1} %", 100.0 * share),
            Self::Value(..) | Self::Share(_) => "–".to_owned(),
        }
    }
}

impl Table {
    /// An empty table.
    pub fn new<S: Into<String>>(title: impl Into<String>, columns: impl IntoIterator<Item = S>) -> Self {
        Self { title: title.into(), columns: columns.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// Appends a row.
    ///
    /// # Panics
    /// If it has not one cell per column.
    pub fn push(&mut self, row: impl IntoIterator<Item = Cell>) {
        let row: Vec<Cell> = row.into_iter().collect();
        assert_eq!(row.len(), self.columns.len(), "a row of table `{}` needs one cell per column", self.title);
        self.rows.push(row);
    }

    /// The table as Markdown, columns aligned so that the source reads as a table too; words left, numbers right.
    pub fn to_markdown(&self) -> String {
        let body: Vec<Vec<String>> = self.rows.iter().map(|row| row.iter().map(Cell::to_markdown).collect()).collect();
        let is_text = |column: usize| self.rows.iter().any(|row| matches!(row[column], Cell::Text(_)));
        let left: Vec<bool> = (0..self.columns.len()).map(is_text).collect();
        let cells = |column: usize| body.iter().map(move |row| &row[column]).chain([&self.columns[column]]);
        let width = |column: usize| cells(column).map(|cell| cell.chars().count()).max().unwrap_or(0).max(3);
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        let line = |cells: &[String]| {
            let padded = cells.iter().zip(&widths).zip(&left).map(|((cell, &width), &left)| {
                if left { format!(" {cell:<width$} |") } else { format!(" {cell:>width$} |") }
            });
            format!("|{}\n", padded.collect::<String>())
        };
        let rule = widths.iter().zip(&left).map(|(&width, &left)| {
            let dashes = "-".repeat(width);
            if left { format!(" {dashes} |") } else { format!(" {}: |", &dashes[1..]) }
        });
        let heading = if self.title.is_empty() { String::new() } else { format!("## {}\n\n", self.title) };
        let rows: String = body.iter().map(|row| line(row)).collect();
        format!("{heading}{}|{}\n{rows}", line(&self.columns), rule.collect::<String>())
    }
}

impl Report {
    /// The whole report as Markdown.
    pub fn to_markdown(&self) -> String {
        let mut parts = vec![format!("# {}\n", self.title)];
        parts.extend(self.notes.iter().map(|note| format!("{note}\n")));
        parts.extend(self.tables.iter().map(Table::to_markdown));
        parts.extend(self.figures.iter().map(|figure| format!("![{}]({})\n", figure.title, figure.file)));
        parts.join("\n")
    }

    /// Writes `report.md`, `report.json` and the figures into a folder, all or none; returns their paths.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, WriteError> {
        let staged = StagedDir::new(folder)?;
        staged.write("report.md", |out| out.write_all(self.to_markdown().as_bytes()))?;
        staged.write("report.json", |out| out.write_all(self.to_json().as_bytes()))?;
        for figure in &self.figures {
            staged.write(&figure.file, |out| out.write_all(&figure.content))?;
        }
        staged.commit()
    }

    /// The whole report as indented JSON; values without meaning are null.
    pub fn to_json(&self) -> String {
        // Cells never produce what JSON cannot hold, so this cannot fail.
        serde_json::to_string_pretty(self).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> Report {
        let mut table = Table::new("Depth", ["scene", "within 1 %", "median, mm", "pixels"]);
        table.push(["dtu|24".into(), Cell::Share(0.9134), Cell::Value(1.28812, 2), Cell::Count(381_777)]);
        table.push(["a".into(), Cell::Share(f64::NAN), Cell::Value(f64::NAN, 2), Cell::Count(0)]);
        let notes = vec!["Missing counts as a miss.".into()];
        Report { title: "Scores".into(), notes, tables: vec![table], figures: Vec::new() }
    }

    #[test]
    fn markdown_is_a_readable_table() {
        let expected = "# Scores\n\nMissing counts as a miss.\n\n## Depth\n\n\
            | scene   | within 1 % | median, mm | pixels |\n\
            | ------- | ---------: | ---------: | -----: |\n\
            | dtu\\|24 |     91.3 % |       1.29 | 381777 |\n\
            | a       |          – |          – |      0 |\n";
        assert_eq!(report().to_markdown(), expected);
    }

    #[test]
    fn json_keeps_full_precision_and_null_for_no_value() {
        let json: serde_json::Value = serde_json::from_str(&report().to_json()).unwrap();
        let rows = &json["tables"][0]["rows"];
        assert_eq!(rows[0][2], 1.28812);
        assert!(rows[1][1].is_null() && rows[1][2].is_null());
        assert_eq!(rows[0][0], "dtu|24");
    }

    #[test]
    fn files_hold_both_forms_and_the_figures() {
        let folder = tempfile::tempdir().unwrap();
        let figure = Figure { title: "A plot".into(), file: "plot.svg".into(), content: b"<svg/>".to_vec() };
        let report = Report { figures: vec![figure], ..report() };
        let paths = report.write(&folder.path().join("out")).unwrap();
        let names: Vec<_> = paths.iter().map(|path| path.file_name().unwrap().to_str().unwrap()).collect();
        assert_eq!(names, ["plot.svg", "report.json", "report.md"]);
        let markdown = std::fs::read_to_string(&paths[2]).unwrap();
        assert!(markdown.ends_with("\n![A plot](plot.svg)\n"), "{markdown}");
        assert_eq!(std::fs::read(&paths[0]).unwrap(), b"<svg/>");
    }

    #[test]
    #[should_panic(expected = "one cell per column")]
    fn a_short_row_is_refused() {
        Table::new("t", ["a", "b"]).push([Cell::Count(1)]);
    }
}
