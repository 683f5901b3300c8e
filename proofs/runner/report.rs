//! What came of it: a table, `results.json`, `results.md`.

use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

use serde::Serialize;

use crate::job::Job;
use crate::manifest::{Expected, Manifest, Tier};

/// One run, as `results.json` holds it.
#[derive(Debug, Serialize)]
pub(crate) struct Outcome {
    /// Of the harness or the mutant.
    name: String,
    /// The harness that ran: the name itself, but for a mutant.
    harness: String,
    theorems: Vec<String>,
    /// What the harness says; for a mutant, what is wrong with core.
    property: String,
    /// Over what; for a mutant, the check that must fail.
    domain: String,
    /// What is substituted, and taken for granted.
    assumes: Vec<String>,
    tier: Tier,
    expected: Expected,
    as_expected: bool,
    /// Why not.
    objection: Option<String>,
    /// The solver's time; none if there was no result.
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
        let harness = job.harness;
        Self {
            name: job.name().to_owned(),
            harness: harness.name.clone(),
            theorems: harness.theorems.clone(),
            property: job
                .mutant
                .map_or(&harness.property, |mutant| &mutant.change)
                .clone(),
            domain: job
                .mutant
                .map_or(&harness.domain, |mutant| &mutant.fails)
                .clone(),
            assumes: harness.assumes.clone(),
            tier: job.tier(),
            expected: job.mutant.map_or(harness.verdict, |mutant| mutant.verdict),
            as_expected: objection.is_none(),
            objection,
            seconds,
            limit_seconds: limit,
            log: log.display().to_string(),
        }
    }

    /// For whoever watches; `whole` is the time with building.
    pub(crate) fn line(&self, whole: Duration) -> String {
        let whole = whole.as_secs_f64();
        match &self.objection {
            None => format!(
                "{} in {} ({whole:.1} s with building)",
                self.verdict(),
                seconds(self.seconds)
            ),
            Some(why) => format!("NOT AS EXPECTED: {why}\n    see {}", self.log),
        }
    }

    fn verdict(&self) -> &'static str {
        match (&self.objection, self.expected) {
            (None, Expected::Verified) => "verified",
            (None, Expected::Fails) => "fails as it must",
            (Some(_), _) => "NOT AS EXPECTED",
        }
    }
}

/// All runs, as `results.json` holds them.
#[derive(Debug, Serialize)]
pub(crate) struct Report<'a> {
    /// Of this file's format; a field that goes or changes its meaning makes it a new one.
    format: u32,
    /// The Kani that ran, and the one that `proofs/kani-version` names.
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
            format: 1,
            kani,
            kani_pinned,
            tier,
            as_expected: results.iter().filter(|outcome| outcome.as_expected).count(),
            total: results.len(),
            results,
            manifest,
        }
    }

    /// An empty run proves nothing.
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

    /// `results.json` and `results.md`.
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
            "# Proofs of gantry-tau-core\n\n{}, tier {}.\n",
            self.summary(),
            self.tier
        );
        text.push_str(
            "A mutant is core with one line wrong on purpose; it must fail in the named check.\n\n",
        );
        text.push_str("| name | theorems | what | over what; the failing check | verdict | time |\n|---|---|---|---|---|---|\n");
        for outcome in &self.results {
            let cells = [
                &format!("`{}`", outcome.name),
                &outcome.theorems.join(" "),
                &outcome.property,
                &outcome.domain,
                &outcome
                    .objection
                    .clone()
                    .unwrap_or_else(|| outcome.verdict().to_owned()),
                &seconds(outcome.seconds),
            ];
            row(&mut text, &cells);
        }
        text.push_str("\nNot proved, and not claimed:\n\n| theorem | what |\n|---|---|\n");
        for wall in &self.manifest.walls {
            row(&mut text, &[&wall.theorem, &wall.what]);
        }
        text
    }
}

fn row(text: &mut String, cells: &[&String]) {
    let cells: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
    // Writing to a String cannot fail.
    let _ = writeln!(text, "| {} |", cells.join(" | "));
}

fn seconds(time: Option<f64>) -> String {
    time.map_or("-".to_owned(), |time| format!("{time:.1} s"))
}

/// Removes what an earlier run has left: a run that comes to no result must not look like it.
pub(crate) fn forget(folder: &Path) {
    for name in ["results.json", "results.md"] {
        // Most often there is none.
        let _ = std::fs::remove_file(folder.join(name));
    }
}

/// The measured time, or that there is none.
fn measured(seconds: Option<f64>) -> String {
    seconds.map_or("not run yet".to_owned(), |seconds| format!("{seconds} s"))
}

/// What the manifest holds.
pub(crate) fn list(manifest: &Manifest) {
    for harness in &manifest.harnesses {
        let theorems = harness.theorems.join(" ");
        println!(
            "{}  ({theorems}, {}, {})\n    {}\n    for {}",
            harness.name,
            harness.tier,
            measured(harness.measured_s),
            harness.property,
            harness.domain
        );
        for assumption in &harness.assumes {
            println!("    assumes {assumption}");
        }
    }
    for mutant in &manifest.mutants {
        println!(
            "{}  (mutant, {}, {})\n    {}\n    {} must fail: {}",
            mutant.name,
            mutant.tier,
            measured(mutant.measured_s),
            mutant.change,
            mutant.harness,
            mutant.fails
        );
    }
    for wall in &manifest.walls {
        println!("not proved, {}: {}", wall.theorem, wall.what);
    }
}
