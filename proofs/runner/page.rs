//! `proofs/RESULTS.md`: theorems, harnesses, mutants and walls, with the results that there are.
//! `table` writes it.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use crate::manifest::{Manifest, Mutant, Row, Theorem};
use crate::prove::{self, Job};
use crate::report::{header, line, solver};
use crate::results::{Results, Standing, Standings, Verdict};
use crate::sources::Sources;
use crate::{at, read};

/// File from the repository's root.
pub(crate) const PATH: &str = "proofs/RESULTS.md";

/// Width of its text; the rows of its tables are longer.
const WIDTH: usize = 100;

/// Result of a row, as the page shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Cell {
    /// On this source, with the seconds of the solver.
    Current(Option<f64>),
    Failed,
    /// Of other sources.
    Stale,
    NotRun,
}

/// Results of all rows, by name.
pub(crate) type Cells = BTreeMap<String, Cell>;

impl Cell {
    /// One word for it; `as_expected` for a result on this source.
    pub(crate) fn word<'a>(&self, as_expected: &'a str) -> &'a str {
        match self {
            Self::Current(_) => as_expected,
            Self::Failed => "failed",
            Self::Stale => "stale",
            Self::NotRun => "not run",
        }
    }

    /// Last columns of its row in the page: seconds and verdict of a harness, verdict of a mutant.
    fn columns(&self, is_mutant: bool) -> Vec<String> {
        if is_mutant {
            return vec![self.word("caught").to_owned()];
        }
        let seconds = match self {
            Self::Current(Some(seconds)) => format!("{seconds:.1}"),
            _ => String::new(),
        };
        vec![seconds, self.word("verified").to_owned()]
    }
}

/// Cells that these standings justify.
pub(crate) fn cells(standings: &Standings<'_>) -> Cells {
    let cells = standings.iter().map(|(job, standing)| {
        let cell = match standing {
            Standing::Current(entry) => Cell::Current(entry.seconds),
            Standing::Failed(_) => Cell::Failed,
            Standing::Stale => Cell::Stale,
            Standing::NotRun => Cell::NotRun,
        };
        (job.name().to_owned(), cell)
    });
    cells.collect()
}

/// Cells that the page shows, where the results of any sources justify them; otherwise those that a
/// new page would have. A change of the sources makes results stale, and must not make the page
/// wrong until it is written again.
pub(crate) fn shown(page: &str, manifest: &Manifest, results: &Results, mut cells: Cells) -> Cells {
    let rows: BTreeMap<&str, Vec<&str>> = page.lines().filter_map(columns).collect();
    for job in prove::jobs(manifest) {
        let Some(columns) = rows.get(job.name()) else {
            continue;
        };
        let justified = justified(results, job).into_iter().find(|cell| {
            let cell = cell.columns(job.mutant.is_some());
            columns.ends_with(&cell.iter().map(String::as_str).collect::<Vec<_>>())
        });
        if let Some(cell) = justified {
            cells.insert(job.name().to_owned(), cell);
        }
    }
    cells
}

/// Name and columns of a row of one of the page's tables.
fn columns(row: &str) -> Option<(&str, Vec<&str>)> {
    let mut columns = row
        .strip_prefix("| `")?
        .strip_suffix('|')?
        .split('|')
        .map(str::trim);
    Some((columns.next()?.strip_suffix('`')?, columns.collect()))
}

/// Cells that the result of a row justifies, on any sources.
fn justified(results: &Results, job: Job<'_>) -> Vec<Cell> {
    match results.get(job.name()) {
        None => vec![Cell::NotRun],
        Some(entry) if entry.verdict == Verdict::Failed => {
            vec![Cell::Failed, Cell::Stale, Cell::NotRun]
        }
        Some(entry) => vec![
            Cell::Current(entry.seconds),
            Cell::Stale,
            Cell::NotRun,
            Cell::Failed,
        ],
    }
}

/// The page of a repository; empty if there is none.
pub(crate) fn load(root: &Path) -> Result<String, String> {
    let path = root.join(PATH);
    if path.exists() {
        read(&path)
    } else {
        Ok(String::new())
    }
}

/// Writes the page.
pub(crate) fn write(
    root: &Path,
    manifest: &Manifest,
    results: &Results,
    sources: &Sources,
) -> Result<(), String> {
    let path = root.join(PATH);
    let cells = cells(&results.standings(manifest, sources));
    std::fs::write(&path, text(manifest, &cells)).map_err(at(&path))
}

/// Text of the page.
pub(crate) fn text(manifest: &Manifest, cells: &Cells) -> String {
    let mut text = String::from(HEAD);
    let verified = manifest
        .harnesses
        .iter()
        .filter(|row| is_current(cells, &row.name))
        .count();
    let caught = manifest
        .mutants
        .iter()
        .filter(|mutant| is_current(cells, &mutant.name))
        .count();
    let (harnesses, mutants) = (manifest.harnesses.len(), manifest.mutants.len());
    // Writing to a String cannot fail.
    let _ = writeln!(
        text,
        "\nOn this source {verified} of {harnesses} harnesses are verified, {caught} of {mutants} mutants caught."
    );
    text.push_str("\n## Theorems\n\n");
    for theorem in &manifest.theorems {
        let names: Vec<String> = manifest
            .rows_of(theorem)
            .map(|row| format!("`{}`", row.name))
            .collect();
        item(
            &mut text,
            &format!("**{}**: {}.", theorem.name, theorem.statement),
        );
        paragraph(
            &mut text,
            &format!("*How:* {}.", evidence(theorem, manifest, cells)),
        );
        paragraph(&mut text, &format!("*Harnesses:* {}.", names.join(", ")));
    }
    text.push_str("\n## Harnesses\n\n");
    header(&mut text, "harness | theorems | tier | solver | s | result");
    for row in &manifest.harnesses {
        harness_row(&mut text, row, cells);
    }
    text.push_str("\n## Properties and domains\n\n");
    for row in &manifest.harnesses {
        property(&mut text, row);
    }
    text.push_str("\n## Mutants\n\n");
    header(
        &mut text,
        "mutant | theorem | fault | harness that must fail | tier | result",
    );
    for mutant in &manifest.mutants {
        mutant_row(&mut text, mutant, manifest, cells);
    }
    text.push_str(
        "\n## Walls\n\nStatements beyond the solvers: tested, and not claimed as proved.\n\n",
    );
    for wall in &manifest.walls {
        item(&mut text, &format!("**{}**: {}.", wall.theorem, wall.what));
    }
    text
}

/// Head of the page.
const HEAD: &str = "# Results of the proofs

<!-- Written by `cargo run -p gantry-tau-proofs -- table`. -->

[README.md](README.md) explains how to read this page, and [theorems.md](theorems.md) the theorems.
\"verified\" and \"caught\" are results on this source, with the seconds of the solver. \"stale\" is a
result of other sources, \"failed\" a run that did not end as expected. A theorem is called proved if
every one of its harnesses is verified on this source.
";

/// Evidence of a theorem: \"proved\" only where every row has a result on this source.
pub(crate) fn evidence(theorem: &Theorem, manifest: &Manifest, cells: &Cells) -> String {
    if manifest
        .rows_of(theorem)
        .all(|row| is_current(cells, &row.name))
    {
        theorem.how.clone()
    } else {
        theorem.how.replace("proved", "not proved on this source")
    }
}

fn is_current(cells: &Cells, name: &str) -> bool {
    matches!(cells.get(name), Some(Cell::Current(_)))
}

/// Theorem of the check that must fail; those of the harness if the check names none.
fn theorems_of(mutant: &Mutant, manifest: &Manifest) -> String {
    let named = mutant.fails.split_once(':').map(|(name, _)| name);
    let named = named.filter(|name| {
        manifest
            .theorems
            .iter()
            .any(|theorem| theorem.name == *name)
    });
    match named {
        Some(theorem) => theorem.to_owned(),
        None => manifest
            .row(&mutant.harness)
            .map(|row| row.theorems.join(" "))
            .unwrap_or_default(),
    }
}

/// Property, domain and assumptions of a harness.
fn property(text: &mut String, row: &Row) {
    item(text, &format!("`{}`: {}.", row.name, row.property));
    paragraph(text, &format!("*For* {}.", row.domain));
    for assumption in &row.assumes {
        paragraph(text, &format!("*Assumes:* {assumption}."));
    }
    if !row.leaves_out.is_empty() {
        paragraph(
            text,
            &format!("*Does not reach:* {}.", row.leaves_out.join("; ")),
        );
    }
}

fn harness_row(text: &mut String, row: &Row, cells: &Cells) {
    let name = format!("`{}`", row.name);
    let mut columns = vec![
        name,
        row.theorems.join(" "),
        row.tier.to_string(),
        solver(&row.name),
    ];
    columns.extend(cells.get(&row.name).unwrap_or(&Cell::NotRun).columns(false));
    line(text, &columns);
}

fn mutant_row(text: &mut String, mutant: &Mutant, manifest: &Manifest, cells: &Cells) {
    let (name, harness) = (
        format!("`{}`", mutant.name),
        format!("`{}`", mutant.harness),
    );
    let mut columns = vec![
        name,
        theorems_of(mutant, manifest),
        mutant.change.clone(),
        harness,
        mutant.tier.to_string(),
    ];
    columns.extend(
        cells
            .get(&mutant.name)
            .unwrap_or(&Cell::NotRun)
            .columns(true),
    );
    line(text, &columns);
}

/// Adds an item of a list.
pub(crate) fn item(text: &mut String, words: &str) {
    wrap(text, "- ", words);
}

/// Adds a line to the last item of a list.
fn paragraph(text: &mut String, words: &str) {
    wrap(text, "  ", words);
}

/// Adds lines of at most [`WIDTH`] characters, the first with a prefix and the others indented by
/// it.
fn wrap(text: &mut String, prefix: &str, words: &str) {
    let mut width = 0_usize;
    for word in words.split(' ') {
        let length = word.chars().count();
        let next = width.saturating_add(1).saturating_add(length);
        if width == 0 {
            text.push_str(prefix);
            width = prefix.len().saturating_add(length);
        } else if next > WIDTH && !is_markup(word) {
            text.push_str("\n  ");
            width = length.saturating_add(2);
        } else {
            text.push(' ');
            width = next;
        }
        text.push_str(word);
    }
    text.push('\n');
}

/// True for a word that Markdown would not take as text at the beginning of a line.
fn is_markup(word: &str) -> bool {
    let number = word.trim_end_matches(['.', ')']);
    let is_number = number != word && number.parse::<u32>().is_ok();
    is_number || ["-", "+", "*", "="].contains(&word) || word.starts_with(['#', '>'])
}
