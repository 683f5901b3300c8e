//! Runs as a table, `results.md`; contents of manifest and results for `list`.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::manifest::{Manifest, Tier, Wall};
use crate::page::{self, Cell, Cells};
use crate::prove::Job;
use crate::{at, check};

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
            None => format!(
                "{verdict} in {time} ({:.1} s with building)",
                whole.as_secs_f64()
            ),
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
        self.outcomes
            .iter()
            .filter(|outcome| outcome.objection.is_none())
            .count()
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
        header(
            &mut text,
            "name | theorems | property | domain; the failing check | verdict | time",
        );
        for outcome in &self.outcomes {
            let (property, domain) = outcome.claim();
            let name = format!("`{}`", outcome.job.name());
            let theorems = outcome.job.row.theorems.join(" ");
            let (verdict, time) = (outcome.verdict(), seconds(outcome.seconds));
            line(
                &mut text,
                &[name.as_str(), &theorems, property, domain, &verdict, &time],
            );
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
pub(crate) fn header(text: &mut String, cells: &str) {
    // Writing to a String cannot fail.
    let _ = writeln!(
        text,
        "| {cells} |\n|{}",
        "---|".repeat(cells.split('|').count())
    );
}

pub(crate) fn line(text: &mut String, cells: &[impl AsRef<str>]) {
    let cells: Vec<String> = cells
        .iter()
        .map(|cell| cell.as_ref().replace('|', "\\|"))
        .collect();
    let _ = writeln!(text, "| {} |", cells.join(" | "));
}

fn seconds(time: Option<f64>) -> String {
    time.map_or("-".to_owned(), |time| format!("{time:.1} s"))
}

/// Prints theorems, harnesses, mutants and walls.
pub(crate) fn list(manifest: &Manifest, cells: &Cells) {
    for theorem in &manifest.theorems {
        println!(
            "{}  {}\n    {}",
            theorem.name,
            theorem.statement,
            page::evidence(theorem, manifest, cells)
        );
    }
    for row in &manifest.harnesses {
        let (theorems, standing) = (
            row.theorems.join(" "),
            standing(cells, &row.name, "verified"),
        );
        println!(
            "{}  ({theorems}, {}, {standing}, {})",
            row.name,
            row.tier,
            solver(&row.name)
        );
        println!("    {}\n    for {}", row.property, row.domain);
        for assumption in &row.assumes {
            println!("    assumes {assumption}");
        }
    }
    for mutant in &manifest.mutants {
        let standing = standing(cells, &mutant.name, "caught");
        println!(
            "{}  (mutant, {}, {standing})\n    {}",
            mutant.name, mutant.tier, mutant.change
        );
        println!("    {} must fail: {}", mutant.harness, mutant.fails);
    }
    for wall in &manifest.walls {
        println!("not proved, {}: {}", wall.theorem, wall.what);
    }
}

/// Seconds of a row with a result on this source, or its standing.
fn standing(cells: &Cells, name: &str, as_expected: &str) -> String {
    match cells.get(name).unwrap_or(&Cell::NotRun) {
        Cell::Current(Some(seconds)) => format!("{seconds:.1} s"),
        cell => cell.word(as_expected).to_owned(),
    }
}

/// Solver and loop bound of a harness.
pub(crate) fn solver(name: &str) -> String {
    match check::harness(name) {
        None => "not in the source".to_owned(),
        Some(harness) => match harness.unwind {
            Some(bound) => format!("{}, unwind {bound}", harness.solver),
            None => harness.solver.to_owned(),
        },
    }
}
