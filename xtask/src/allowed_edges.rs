//! The table of allowed edges in `ARCHITECTURE.md`: which crate may use which of ours.
//!
//! A Markdown table between two marker comments with the columns crate, may use (ours), burn. Invariant: what
//! people read is what is checked; there is no second list.

use anyhow::{Context, Result, bail};
use std::collections::{BTreeMap, BTreeSet};

const BEGIN: &str = "<!-- allowed-edges: begin -->";
const END: &str = "<!-- allowed-edges: end -->";

/// What one crate is allowed.
#[derive(Debug, Default, PartialEq)]
pub struct Allowed {
    /// Names of our crates it may use in its library or binary.
    pub uses: BTreeSet<String>,
    /// Whether its default build may contain burn.
    pub burn: bool,
}

/// Reads the table out of the text of `ARCHITECTURE.md`.
///
/// # Errors
/// When the markers are missing, a row does not have three cells, or a crate has two rows.
pub fn parse(document: &str) -> Result<BTreeMap<String, Allowed>> {
    let after = document.split_once(BEGIN).with_context(|| format!("ARCHITECTURE.md has no `{BEGIN}`"))?.1;
    let table = after.split_once(END).with_context(|| format!("ARCHITECTURE.md has no `{END}`"))?.0;
    let mut edges = BTreeMap::new();
    // The first two rows are the heading and the line below it.
    for row in table.lines().filter(|line| line.starts_with('|')).skip(2) {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        let [name, uses, burn] = cells[..] else {
            bail!("ARCHITECTURE.md: the row `{row}` must have three cells: crate, may use (ours), burn");
        };
        let burn = match burn {
            "yes" => true,
            "no" => false,
            other => bail!("ARCHITECTURE.md: the row `{row}` says `{other}` for burn; it must be yes or no"),
        };
        let names = names_in(name);
        let [name] = &names[..] else {
            bail!("ARCHITECTURE.md: the row `{row}` must begin with one crate name in backquotes");
        };
        let allowed = Allowed { uses: names_in(uses).into_iter().collect(), burn };
        if edges.insert(name.clone(), allowed).is_some() {
            bail!("ARCHITECTURE.md: {name} has two rows");
        }
    }
    Ok(edges)
}

/// Everything in backquotes.
fn names_in(cell: &str) -> Vec<String> {
    cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document(rows: &str) -> String {
        format!("text\n{BEGIN}\n\n| crate | may use | burn |\n|---|---|---|\n{rows}\n\n{END}\n| `x` | no table | no |")
    }

    #[test]
    fn reads_what_people_read() {
        let edges = parse(&document("| `a` | none | no |\n| `b` | `a`, `c` | yes |")).unwrap();
        assert_eq!(edges.len(), 2);
        assert_eq!(edges["a"], Allowed::default());
        assert_eq!(edges["b"].uses, BTreeSet::from(["a".to_owned(), "c".to_owned()]));
        assert!(edges["b"].burn);
    }

    #[test]
    fn says_what_is_wrong_with_a_table() {
        let fault = |text: &str| parse(text).unwrap_err().to_string();
        assert!(fault("no markers").contains("has no"));
        assert!(fault(&document("| `a` | none |")).contains("three cells"));
        assert!(fault(&document("| `a` | none | maybe |")).contains("yes or no"));
        assert!(fault(&document("| a | none | no |")).contains("backquotes"));
        assert!(fault(&document("| `a` | none | no |\n| `a` | none | no |")).contains("two rows"));
    }
}
