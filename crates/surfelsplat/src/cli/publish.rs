//! A report goes to stdout, and into a folder when one is named.

use super::print_line;
use anyhow::Result;
use std::path::Path;
use surfel_eval::report::Report;

/// Prints the report as Markdown or JSON; with `folder`, also writes `report.md`, `report.json` and the figures there.
pub fn publish(report: &Report, folder: Option<&Path>, json: bool) -> Result<()> {
    if let Some(folder) = folder {
        report.write(folder)?;
    }
    print_line(&if json { report.to_json() } else { report.to_markdown() });
    Ok(())
}
