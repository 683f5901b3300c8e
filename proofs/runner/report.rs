//! Results as a table, `results.json` and `results.md`; contents of the manifest for `list` and for the README.

use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

use serde::Serialize;

use crate::check;
use crate::manifest::{Manifest, Row, Tier};
use crate::prove::Job;

/// One run, as `results.json` holds it.
#[derive(Debug, Serialize)]
pub(crate) struct Outcome {
    /// Name of the harness or the mutant.
    name: String,
    /// Harness that ran: the name itself, but for a mutant.
    harness: &'static str,
    solver: &'static str,
    unwind: Option<u32>,
    theorems: Vec<String>,
    /// Property of the harness; for a mutant, the fault in core.
    property: String,
    /// Domain of the property; for a mutant, the check that must fail.
    domain: String,
    /// Assumptions behind substituted functions.
    assumes: Vec<String>,
    tier: Tier,
    /// "verified", or "fails" for a mutant.
    expected: &'static str,
    as_expected: bool,
    /// Reason for a result that is not as expected.
    objection: Option<String>,
    /// Solver time; none if there was no result.
    seconds: Option<f64>,
    limit_seconds: f64,
    /// Kani's output.
    log: String,
}

impl Outcome {
    pub(crate) fn new(
        job: Job<'_>,
        limit: f64,
        seconds: Option<f64>,
        objection: Option<String>,
        log: &Path,
    ) -> Self {
        let Job {
            row,
            harness,
            mutant,
        } = job;
        let (property, domain, expected) = match mutant {
            None => (&row.property, &row.domain, "verified"),
            Some(mutant) => (&mutant.change, &mutant.fails, "fails"),
        };
        Self {
            name: job.name().to_owned(),
            harness: harness.name,
            solver: harness.solver,
            unwind: harness.unwind,
            theorems: row.theorems.clone(),
            property: property.clone(),
            domain: domain.clone(),
            assumes: row.assumes.clone(),
            tier: job.tier(),
            expected,
            as_expected: objection.is_none(),
            objection,
            seconds,
            limit_seconds: limit,
            log: log.display().to_string(),
        }
    }

    /// Line of progress; `whole` is the time with building.
    pub(crate) fn line(&self, whole: Duration) -> String {
        match &self.objection {
            None => format!(
                "{} in {} ({:.1} s with building)",
                self.verdict(),
                seconds(self.seconds),
                whole.as_secs_f64()
            ),
            Some(why) => format!("NOT AS EXPECTED: {why}\n    see {}", self.log),
        }
    }

    fn verdict(&self) -> &'static str {
        match (&self.objection, self.expected) {
            (None, "fails") => "fails as it must",
            (None, expected) => expected,
            (Some(_), _) => "NOT AS EXPECTED",
        }
    }
}

/// All runs, as `results.json` holds them.
#[derive(Debug, Serialize)]
pub(crate) struct Report<'a> {
    /// Version of the file's format; raised when a field goes or changes its meaning.
    format: u32,
    /// Kani that ran, and the one that `proofs/kani-version` names.
    kani: &'a str,
    kani_pinned: &'a str,
    tier: Tier,
    as_expected: usize,
    total: usize,
    results: Vec<Outcome>,
    #[serde(skip)]
    manifest: &'a Manifest,
}

impl<'a> Report<'a> {
    pub(crate) fn new(
        kani: &'a str,
        kani_pinned: &'a str,
        tier: Tier,
        results: Vec<Outcome>,
        manifest: &'a Manifest,
    ) -> Self {
        Self {
            format: 2,
            kani,
            kani_pinned,
            tier,
            as_expected: results.iter().filter(|outcome| outcome.as_expected).count(),
            total: results.len(),
            results,
            manifest,
        }
    }

    /// True if every run was as expected. An empty run proves nothing.
    pub(crate) fn all_as_expected(&self) -> bool {
        self.total > 0 && self.as_expected == self.total
    }

    pub(crate) fn print(&self) {
        let longest = self.results.iter().map(|outcome| outcome.name.len()).max();
        let width = longest.unwrap_or(0);
        println!(
            "\n{:width$}  {:12}  {:16}  {:>8}  {:>6}",
            "name", "theorems", "verdict", "time", "limit"
        );
        for outcome in &self.results {
            println!(
                "{:width$}  {:12}  {:16}  {:>8}  {:>4} s",
                outcome.name,
                outcome.theorems.join(" "),
                outcome.verdict(),
                seconds(outcome.seconds),
                outcome.limit_seconds,
            );
        }
        println!("{}", self.summary());
    }

    fn summary(&self) -> String {
        format!(
            "{} of {} as expected (Kani {})",
            self.as_expected, self.total, self.kani
        )
    }

    /// Writes `results.json` and `results.md`.
    pub(crate) fn write(&self, folder: &Path) -> Result<(), String> {
        let json = serde_json::to_string_pretty(self).map_err(|error| error.to_string())?;
        for (name, text) in [("results.json", json), ("results.md", self.markdown())] {
            let path = folder.join(name);
            std::fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()))?;
        }
        println!("results: {}", folder.join("results.{json,md}").display());
        Ok(())
    }

    fn markdown(&self) -> String {
        let mut text = format!(
            "# Proofs of gantry-tau-core\n\n{}, tier {}.\n\
             A mutant is core with one line wrong on purpose; it must fail in the named check.\n\n",
            self.summary(),
            self.tier
        );
        let head = [
            "name",
            "theorems",
            "property",
            "domain; the failing check",
            "verdict",
            "time",
        ];
        header(&mut text, &head);
        for outcome in &self.results {
            let verdict = outcome.objection.as_deref().unwrap_or(outcome.verdict());
            let name = format!("`{}`", outcome.name);
            let theorems = outcome.theorems.join(" ");
            let time = seconds(outcome.seconds);
            let cells = [
                &name,
                &theorems,
                &outcome.property,
                &outcome.domain,
                verdict,
                &time,
            ];
            line(&mut text, &cells);
        }
        text.push_str("\nNot proved, and not claimed:\n\n");
        header(&mut text, &["theorem", "statement"]);
        for wall in &self.manifest.walls {
            line(&mut text, &[&wall.theorem, &wall.what]);
        }
        text
    }
}

fn header(text: &mut String, cells: &[&str]) {
    line(text, cells);
    line(text, &vec!["---"; cells.len()]);
}

fn line(text: &mut String, cells: &[&str]) {
    let cells: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
    // Writing to a String cannot fail.
    let _ = writeln!(text, "| {} |", cells.join(" | "));
}

fn seconds(time: Option<f64>) -> String {
    time.map_or("-".to_owned(), |time| format!("{time:.1} s"))
}

/// Removes the results of an earlier run: a run that comes to no result must not look like it.
pub(crate) fn forget(folder: &Path) {
    for name in ["results.json", "results.md"] {
        // Most often there is none.
        let _ = std::fs::remove_file(folder.join(name));
    }
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
    header(
        &mut text,
        &[
            "theorem",
            "statement and domain",
            "how",
            "harnesses, s",
            "mutants that fail",
        ],
    );
    for theorem in &manifest.theorems {
        let proves = |row: &&Row| row.theorems.contains(&theorem.name);
        let rows: Vec<&Row> = manifest.harnesses.iter().filter(proves).collect();
        let names = rows.iter().map(|row| match row.measured_s {
            Some(seconds) => format!("`{}` {seconds}", row.name),
            None => format!("`{}` (not run yet)", row.name),
        });
        let mutants = manifest.mutants.iter();
        let falls = mutants.filter(|mutant| rows.iter().any(|row| row.name == mutant.harness));
        let mutants: Vec<String> = falls.map(|mutant| format!("`{}`", mutant.name)).collect();
        let cells = [
            &theorem.name,
            &theorem.statement,
            &theorem.how,
            &names.collect::<Vec<_>>().join(", "),
            &mutants.join(", "),
        ];
        line(&mut text, &cells.map(String::as_str));
    }
    text.push('\n');
    text
}

/// Prints theorems, harnesses, mutants and walls.
pub(crate) fn list(manifest: &Manifest) {
    let measured = |s: Option<f64>| s.map_or("not run yet".to_owned(), |s| format!("{s} s"));
    for theorem in &manifest.theorems {
        println!(
            "{}  {}\n    {}",
            theorem.name, theorem.statement, theorem.how
        );
    }
    let declared = check::declared();
    for row in &manifest.harnesses {
        let source = declared.get(row.name.as_str());
        let solver = source.map_or("not in the source".to_owned(), |harness| {
            match harness.unwind {
                Some(bound) => format!("{}, unwind {bound}", harness.solver),
                None => harness.solver.to_owned(),
            }
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
        println!(
            "{}  (mutant, {}, {time})\n    {}",
            mutant.name, mutant.tier, mutant.change
        );
        println!("    {} must fail: {}", mutant.harness, mutant.fails);
    }
    for wall in &manifest.walls {
        println!("not proved, {}: {}", wall.theorem, wall.what);
    }
}
