//! Reports read back: a cell by its row and column.

use serde_json::Value;

/// A table of a report printed with `--json`.
pub struct TableJson(Value);

/// The table whose title begins so.
pub fn table(report: &str, title: &str) -> TableJson {
    let report: Value = serde_json::from_str(report).unwrap_or_else(|error| panic!("{error}: {report}"));
    let tables = report["tables"].as_array().unwrap();
    let found = tables.iter().find(|table| table["title"].as_str().unwrap().starts_with(title));
    TableJson(found.unwrap_or_else(|| panic!("no table `{title}` in {report}")).clone())
}

impl TableJson {
    /// The cells of a column in the rows whose first cells are `row`, in order.
    pub fn column(&self, row: &[&str], column: &str) -> Vec<Value> {
        let columns = self.0["columns"].as_array().unwrap();
        let at = columns.iter().position(|name| name == column);
        let at = at.unwrap_or_else(|| panic!("no column `{column}` among {columns:?}"));
        let rows = self.0["rows"].as_array().unwrap().iter();
        rows.filter(|cells| row.iter().enumerate().all(|(i, word)| cells[i] == *word))
            .map(|cells| cells[at].clone())
            .collect()
    }

    /// The number of a column in the only row whose first cells are `row`.
    pub fn number(&self, row: &[&str], column: &str) -> f64 {
        let cells = self.column(row, column);
        assert_eq!(cells.len(), 1, "{row:?} names {} rows of {}", cells.len(), self.0);
        cells[0].as_f64().unwrap_or_else(|| panic!("{row:?}, {column}: {} is no number", cells[0]))
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.0["rows"].as_array().unwrap().len()
    }
}
