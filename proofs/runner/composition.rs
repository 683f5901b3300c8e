//! The page `composition.md`: its axioms are rows of the manifest, at the stated number of axes.

use crate::manifest::Manifest;

/// Axioms that the manifest does not have, or has at another number of axes; rows that the text
/// names and the manifest does not have.
pub(crate) fn disagreements(page: &str, manifest: &Manifest) -> Vec<String> {
    let mut wrong = Vec::new();
    for line in page.lines() {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let at = match cells.as_slice() {
            ["", axiom, _, at, _, ""] if axiom.starts_with('A') => Some(*at),
            _ => None,
        };
        // Names of rows, and not those of files.
        let names = line
            .split('`')
            .skip(1)
            .step_by(2)
            .filter(|name| name.contains('_') && !name.contains(['.', ' ']));
        for name in names {
            match manifest.row(name) {
                None => wrong.push(format!(
                    "proofs/composition.md: {name} is not a row of the manifest"
                )),
                Some(row) if at.is_some_and(|at| !row.domain.starts_with(at)) => {
                    wrong.push(format!(
                        "proofs/composition.md: {name} is of {}, not of {}",
                        row.domain,
                        at.unwrap_or_default()
                    ));
                }
                Some(_) => {}
            }
        }
    }
    wrong
}
