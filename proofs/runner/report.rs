//! Results as a table, `results.json` and `results.md`; contents of the manifest for `list` and for the README.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::{Value, json};

use crate::manifest::{Manifest, Mutant, Row, Tier, Wall};
use crate::prove::Job;
use crate::{at, check};

/// Result of one run.
pub(crate) struct Outcome<'a> {
    pub(crate) job: Job<'a>,
    /// Time limit and time of the solver, s; no time if there was no result.
    pub(crate) limit: f64,
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

    fn json(&self) -> Value {
        let Job { harness, row, mutant } = self.job;
        let (property, domain) = self.claim();
        json!({
            "name": self.job.name(),
            "harness": harness.name,
            "solver": harness.solver,
            "unwind": harness.unwind,
            "theorems": row.theorems,
            "property": property,
            "domain": domain,
            "assumes": row.assumes,
            "tier": self.job.tier().to_string(),
            "expected": if mutant.is_some() { "fails" } else { "verified" },
            "as_expected": self.objection.is_none(),
            "objection": self.objection,
            "seconds": self.seconds,
            "limit_seconds": self.limit,
            "log": self.log,
        })
    }
}

/// Results of all runs.
pub(crate) struct Report<'a> {
    /// Kani that ran, and the one that `proofs/kani-version` names.
    pub(crate) kani: &'a str,
    pub(crate) pinned: &'a str,
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

    /// Writes `results.json` and `results.md`.
    pub(crate) fn write(&self, folder: &Path) -> Result<(), String> {
        let json = json!({
            // Raised when a field goes or changes its meaning.
            "format": 2,
            "kani": self.kani,
            "kani_pinned": self.pinned,
            "tier": self.tier.to_string(),
            "as_expected": self.as_expected(),
            "total": self.outcomes.len(),
            "results": self.outcomes.iter().map(Outcome::json).collect::<Value>(),
        });
        for (name, text) in [("results.json", format!("{json:#}\n")), ("results.md", self.markdown())] {
            let path = folder.join(name);
            std::fs::write(&path, text).map_err(at(&path))?;
        }
        println!("results: {}", folder.join("results.{json,md}").display());
        Ok(())
    }

    fn markdown(&self) -> String {
        let mut text = format!(
            "# Proofs of gantry-tau-core\n\n{}\n\nTier {}. A mutant is core with one line wrong on purpose; it must fail in the named check.\n\n",
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

/// Text of proofs/README.md with the table of the manifest between the markers.
pub(crate) fn with_table(readme: &str, manifest: &Manifest) -> Result<String, String> {
    let parts = readme.split_once(BEGIN).and_then(|(before, rest)| {
        let (_, after) = rest.split_once(END)?;
        Some((before, after))
    });
    let (before, after) = parts.ok_or("proofs/README.md: no markers of the table")?;
    Ok(format!("{before}{BEGIN}{}{END}{after}", table(manifest)))
}

/// Theorems with their harnesses, solver times and mutants.
fn table(manifest: &Manifest) -> String {
    let mut text = String::from("\n");
    header(&mut text, "theorem | statement and domain | how | harnesses, s | mutants that fail");
    for theorem in &manifest.theorems {
        let proves = |row: &&Row| row.theorems.contains(&theorem.name);
        let rows: Vec<&Row> = manifest.harnesses.iter().filter(proves).collect();
        let time = |row: &Row| row.measured_s.map_or("(not run yet)".to_owned(), |seconds| seconds.to_string());
        let names: Vec<String> = rows.iter().map(|row| format!("`{}` {}", row.name, time(row))).collect();
        // The failing check names its theorem, unless it belongs to all of its harness.
        let falls = |mutant: &&Mutant| match mutant.fails.split_once(':') {
            Some((named, _)) => named == theorem.name,
            None => rows.iter().any(|row| row.name == mutant.harness),
        };
        let mutants: Vec<String> =
            manifest.mutants.iter().filter(falls).map(|mutant| format!("`{}`", mutant.name)).collect();
        let (names, mutants) = (names.join(", "), mutants.join(", "));
        line(&mut text, &[&theorem.name, &theorem.statement, &theorem.how, &names, &mutants]);
    }
    text.push('\n');
    text
}

/// Prints theorems, harnesses, mutants and walls.
pub(crate) fn list(manifest: &Manifest) {
    let measured = |s: Option<f64>| s.map_or("not run yet".to_owned(), |s| format!("{s} s"));
    for theorem in &manifest.theorems {
        println!("{}  {}\n    {}", theorem.name, theorem.statement, theorem.how);
    }
    for row in &manifest.harnesses {
        let solver = check::harness(&row.name).map_or("not in the source".to_owned(), |harness| match harness.unwind {
            Some(bound) => format!("{}, unwind {bound}", harness.solver),
            None => harness.solver.to_owned(),
        });
        let (theorems, time) = (row.theorems.join(" "), measured(row.measured_s));
        println!("{}  ({theorems}, {}, {time}, {solver})", row.name, row.tier);
        println!("    {}\n    for {}", row.property, row.domain);
        for assumption in &row.assumes {
            println!("    assumes {assumption}");
        }
    }
    for mutant in &manifest.mutants {
        let time = measured(mutant.measured_s);
        println!("{}  (mutant, {}, {time})\n    {}", mutant.name, mutant.tier, mutant.change);
        println!("    {} must fail: {}", mutant.harness, mutant.fails);
    }
    for wall in &manifest.walls {
        println!("not proved, {}: {}", wall.theorem, wall.what);
    }
}
