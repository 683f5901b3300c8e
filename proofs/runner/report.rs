//! Runs as a table, `results.md`; contents of manifest and results for `list` and for the README.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::manifest::{Manifest, Mutant, Row, Theorem, Tier, Wall};
use crate::prove::{self, Job};
use crate::results::{Results, Standing, Verdict};
use crate::sources::Sources;
use crate::{at, check, read};

/// Result of one run.
pub(crate) struct Outcome<'a> {
    pub(crate) job: Job<'a>,
    /// Time of the solver, s; none if there was no result.
    pub(crate) seconds: Option<f64>,
    /// Reason for a result that is not as expected.
    pub(crate) objection: Option<String>,
    /// Kani's output.
    pub(crate) log: PathBuf,
}

impl Outcome<'_> {
    /// Line of progress; `whole` is the time with building.
    pub(crate) fn line(&self, whole: Duration) -> String {
        let (verdict, time) = (self.verdict(), seconds(self.seconds));
        match &self.objection {
            None => format!("{verdict} in {time} ({:.1} s with building)", whole.as_secs_f64()),
            Some(_) => format!("{verdict}\n    see {}", self.log.display()),
        }
    }

    fn verdict(&self) -> String {
        match (&self.objection, self.job.mutant) {
            (None, None) => "verified".to_owned(),
            (None, Some(_)) => "fails as it must".to_owned(),
            (Some(objection), _) => format!("NOT AS EXPECTED: {objection}"),
        }
    }

    /// Property and domain of a harness; fault and failing check of a mutant.
    fn claim(&self) -> (&str, &str) {
        match self.job.mutant {
            None => (&self.job.row.property, &self.job.row.domain),
            Some(mutant) => (&mutant.change, &mutant.fails),
        }
    }
}

/// Results of all runs.
pub(crate) struct Report<'a> {
    /// Kani that ran.
    pub(crate) kani: &'a str,
    pub(crate) tier: Tier,
    pub(crate) outcomes: Vec<Outcome<'a>>,
    pub(crate) walls: &'a [Wall],
}

impl Report<'_> {
    /// Number of runs that ended as expected.
    pub(crate) fn as_expected(&self) -> usize {
        self.outcomes.iter().filter(|outcome| outcome.objection.is_none()).count()
    }

    /// Numbers of all runs, and the names of those that are not as expected.
    pub(crate) fn summary(&self) -> String {
        let (good, all) = (self.as_expected(), self.outcomes.len());
        let mut text = format!("{good} of {all} as expected (Kani {})", self.kani);
        for outcome in &self.outcomes {
            if outcome.objection.is_some() {
                let _ = write!(text, "\n  {}: {}", outcome.job.name(), outcome.verdict());
            }
        }
        text
    }

    /// Writes `results.md`.
    pub(crate) fn write(&self, folder: &Path) -> Result<(), String> {
        let path = folder.join("results.md");
        std::fs::write(&path, self.markdown()).map_err(at(&path))?;
        println!("report: {}", path.display());
        Ok(())
    }

    fn markdown(&self) -> String {
        let mut text = format!(
            "# Proofs of gantry-tau-core\n\n{}\n\nTier {}. A mutant is core, or the C interface, with one line wrong on purpose; it must fail in the named check.\n\n",
            self.summary(),
            self.tier
        );
        header(&mut text, "name | theorems | property | domain; the failing check | verdict | time");
        for outcome in &self.outcomes {
            let (property, domain) = outcome.claim();
            let name = format!("`{}`", outcome.job.name());
            let theorems = outcome.job.row.theorems.join(" ");
            let (verdict, time) = (outcome.verdict(), seconds(outcome.seconds));
            line(&mut text, &[&name, &theorems, property, domain, &verdict, &time]);
        }
        text.push_str("\nNot proved, and not claimed:\n\n");
        header(&mut text, "theorem | statement");
        for wall in self.walls {
            line(&mut text, &[&wall.theorem, &wall.what]);
        }
        text
    }
}

/// Head of a table, cells between bars.
fn header(text: &mut String, cells: &str) {
    // Writing to a String cannot fail.
    let _ = writeln!(text, "| {cells} |\n|{}", "---|".repeat(cells.split('|').count()));
}

fn line(text: &mut String, cells: &[&str]) {
    let cells: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
    let _ = writeln!(text, "| {} |", cells.join(" | "));
}

fn seconds(time: Option<f64>) -> String {
    time.map_or("-".to_owned(), |time| format!("{time:.1} s"))
}

/// Markers of the generated part of proofs/README.md.
const BEGIN: &str = "<!-- table: written by `cargo run -p gantry-tau-proofs -- table` -->\n";
const END: &str = "<!-- end of table -->\n";

/// Cell of the table beside the name of a row: seconds of a harness, nothing for a mutant; or why there is no result on this source.
const STALE: &str = "(stale)";
const NOT_RUN: &str = "(not run)";
const FAILED: &str = "(failed)";

/// Cells of all rows, by name.
pub(crate) type Cells = BTreeMap<String, String>;

/// Cells that the results justify on these sources.
pub(crate) fn cells(manifest: &Manifest, results: &Results, sources: &Sources) -> Cells {
    let cell = |job: &Job<'_>| match results.standing(sources, *job) {
        Standing::Current(entry) => taken(job.mutant, entry.seconds),
        Standing::Failed(_) => FAILED.to_owned(),
        Standing::Stale => STALE.to_owned(),
        Standing::NotRun => NOT_RUN.to_owned(),
    };
    prove::jobs(manifest).iter().map(|job| (job.name().to_owned(), cell(job))).collect()
}

/// Cells that the README shows, where the results of any sources justify them; otherwise those that a new table would have.
/// A change of the sources makes results stale, and must not make the README wrong until the next table.
pub(crate) fn shown(readme: &str, manifest: &Manifest, results: &Results, cells: Cells) -> Cells {
    let justified = |job: &Job<'_>, cell: &str| match results.get(job.name()) {
        None => cell == NOT_RUN,
        Some(entry) if entry.verdict == Verdict::Failed => [FAILED, STALE, NOT_RUN].contains(&cell),
        Some(entry) => [STALE, NOT_RUN, FAILED].contains(&cell) || cell == taken(job.mutant, entry.seconds),
    };
    let mut cells = cells;
    // The text before the table may name a row as well.
    let table = readme.split_once(BEGIN).map_or("", |(_, rest)| rest);
    for job in prove::jobs(manifest) {
        let rest = table.split_once(&format!("`{}`", job.name())).map(|(_, rest)| rest);
        let cell = rest.and_then(|rest| rest.split([',', '|']).next()).map(str::trim);
        if let Some(cell) = cell.filter(|cell| justified(&job, cell)) {
            cells.insert(job.name().to_owned(), cell.to_owned());
        }
    }
    cells
}

/// Cell of a row that ran.
fn taken(mutant: Option<&Mutant>, seconds: Option<f64>) -> String {
    mutant.map_or_else(|| seconds.map_or(String::new(), |seconds| format!("{seconds:.1}")), |_| String::new())
}

/// Writes the table into proofs/README.md.
pub(crate) fn write_table(
    root: &Path,
    manifest: &Manifest,
    results: &Results,
    sources: &Sources,
) -> Result<(), String> {
    let path = root.join("proofs/README.md");
    let text = with_table(&read(&path)?, manifest, &cells(manifest, results, sources))?;
    std::fs::write(&path, text).map_err(at(&path))
}

/// Text of proofs/README.md with the table between the markers.
pub(crate) fn with_table(readme: &str, manifest: &Manifest, cells: &Cells) -> Result<String, String> {
    let parts = readme.split_once(BEGIN).and_then(|(before, rest)| {
        let (_, after) = rest.split_once(END)?;
        Some((before, after))
    });
    let (before, after) = parts.ok_or("proofs/README.md: no markers of the table")?;
    Ok(format!("{before}{BEGIN}{}{END}{after}", table(manifest, cells)))
}

/// Theorems with their harnesses, solver times and mutants.
fn table(manifest: &Manifest, cells: &Cells) -> String {
    let mut text = String::from("\n");
    header(&mut text, "theorem | statement and domain | how | harnesses, s | mutants that fail");
    let shown = |name: &String| match cells.get(name).map_or(NOT_RUN, String::as_str) {
        "" => format!("`{name}`"),
        cell => format!("`{name}` {cell}"),
    };
    for theorem in &manifest.theorems {
        let rows: Vec<&Row> = manifest.rows_of(theorem).collect();
        let names: Vec<String> = rows.iter().map(|row| shown(&row.name)).collect();
        // The failing check names its theorem, unless it belongs to all of its harness.
        let falls = |mutant: &&Mutant| match mutant.fails.split_once(':') {
            Some((named, _)) => named == theorem.name,
            None => rows.iter().any(|row| row.name == mutant.harness),
        };
        let mutants: Vec<String> = manifest.mutants.iter().filter(falls).map(|mutant| shown(&mutant.name)).collect();
        let (how, names, mutants) = (how(theorem, &rows, cells), names.join(", "), mutants.join(", "));
        line(&mut text, &[&theorem.name, &theorem.statement, &how, &names, &mutants]);
    }
    text.push('\n');
    text
}

/// Evidence of a theorem: "proved" stands only where every row has a result.
fn how(theorem: &Theorem, rows: &[&Row], cells: &Cells) -> String {
    let has_run = |row: &&Row| cells.get(&row.name).is_some_and(|cell| !cell.starts_with('('));
    if rows.iter().all(has_run) {
        theorem.how.clone()
    } else {
        theorem.how.replace("proved", "not proved on this source")
    }
}

/// Prints theorems, harnesses, mutants and walls.
pub(crate) fn list(manifest: &Manifest, cells: &Cells) {
    let cell = |name: &String| match cells.get(name).map_or(NOT_RUN, String::as_str) {
        "" => "caught".to_owned(),
        cell if cell.starts_with('(') => cell.trim_matches(['(', ')']).to_owned(),
        cell => format!("{cell} s"),
    };
    for theorem in &manifest.theorems {
        println!(
            "{}  {}\n    {}",
            theorem.name,
            theorem.statement,
            how(theorem, &manifest.rows_of(theorem).collect::<Vec<_>>(), cells)
        );
    }
    for row in &manifest.harnesses {
        let solver = check::harness(&row.name).map_or("not in the source".to_owned(), |harness| match harness.unwind {
            Some(bound) => format!("{}, unwind {bound}", harness.solver),
            None => harness.solver.to_owned(),
        });
        let (theorems, time) = (row.theorems.join(" "), cell(&row.name));
        println!("{}  ({theorems}, {}, {time}, {solver})", row.name, row.tier);
        println!("    {}\n    for {}", row.property, row.domain);
        for assumption in &row.assumes {
            println!("    assumes {assumption}");
        }
    }
    for mutant in &manifest.mutants {
        let time = cell(&mutant.name);
        println!("{}  (mutant, {}, {time})\n    {}", mutant.name, mutant.tier, mutant.change);
        println!("    {} must fail: {}", mutant.harness, mutant.fails);
    }
    for wall in &manifest.walls {
        println!("not proved, {}: {}", wall.theorem, wall.what);
    }
}
