//! Runs the proofs: `cargo run -p gantry-tau-proofs -- prove`.
//!
//! Every harness of `src/harness/` has a row in `manifest.toml`, every mutant of core one in
//! `mutants.toml`. The runner first compares them with the sources, then gives Kani one row at a
//! time, and fails whenever Kani finds anything but what the row expects.
#![forbid(unsafe_code)]

mod check;
mod composition;
mod flags;
mod kani;
mod manifest;
mod mutate;
mod page;
mod prove;
mod report;
mod results;
mod sources;
mod tokens;
mod verdict;

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use crate::manifest::{Manifest, Tier};
use crate::results::{Results, Standings};
use crate::sources::Sources;

/// The proofs of gantry-tau-core.
///
/// Exit codes: 0 all as expected; 1 something not; 2 usage; 3 Kani is missing, nothing was proved;
/// 4 the files disagree; 5 the files agree, and `check --strict` misses results on this source, or
/// a mutant for one of their checks.
#[derive(Debug, Parser)]
#[command(name = "gantry-tau-proofs", version, max_term_width = 100)]
struct Arguments {
    /// Another repository than the one this program was built in
    #[arg(long, hide = true)]
    root: Option<PathBuf>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Give every harness and every mutant to Kani, one at a time; begins with `check`
    Prove(Prove),
    /// Compare manifest, harnesses, mutants, results and the page proofs/RESULTS.md; name the rows
    /// without a result on this source (STALE), checks that no mutant makes fail (UNTRIED) and the
    /// share of results by other versions of Kani than the pinned one (VERSION); needs no Kani
    Check {
        /// Also fail when a row has no result on this source, a table says "proved" of its
        /// theorem, or no mutant makes one of its checks fail: for a release
        #[arg(long)]
        strict: bool,
        /// Also compile core with the mutants
        #[arg(long)]
        compile: bool,
        /// Also let Coq check the composition
        #[arg(long)]
        coq: bool,
    },
    /// Show theorems, harnesses, mutants and walls
    List,
    /// Write the page proofs/RESULTS.md, and drop results of rows that the manifest does not have
    Table,
}

#[derive(Debug, Args)]
struct Prove {
    /// `fast`: what ends within 30 s; `full`: that, and what takes up to 10 minutes
    #[arg(long, value_enum, default_value_t = Tier::Fast)]
    tier: Tier,
    /// Folder for results.md and logs/ [default: target/kani]. Verdicts go to proofs/results.json,
    /// row by row
    #[arg(long)]
    out: Option<PathBuf>,
    /// Memory one process of Kani may take (macOS does not enforce it)
    #[arg(long, default_value_t = 8)]
    memory_gib: u32,
    /// Time one build may take, dependencies included; building does not count as proving
    #[arg(long, default_value_t = 20)]
    build_minutes: u64,
    /// Time limit instead of the tier's, for tests of this program
    #[arg(long, hide = true)]
    seconds: Option<f64>,
    /// Only rows without a result on this source
    #[arg(long)]
    stale: bool,
    /// Only these harnesses and mutants, of any tier; `composition`: what Coq checks, in the full
    /// tier with its second checker and the mutants of the axioms
    names: Vec<String>,
}

impl Prove {
    /// Folder of the results.
    fn out(&self, root: &Path) -> PathBuf {
        self.out.clone().unwrap_or_else(|| root.join("target/kani"))
    }
}

/// Exit codes, as `--help` explains them.
mod exit {
    pub(crate) const NOT_AS_EXPECTED: u8 = 1;
    pub(crate) const USAGE: u8 = 2;
    pub(crate) const KANI_MISSING: u8 = 3;
    pub(crate) const FILES_DISAGREE: u8 = 4;
    pub(crate) const STALE: u8 = 5;
}

/// Exit code and message of a run that did not end as expected.
struct Failure(u8, String);

impl From<String> for Failure {
    fn from(message: String) -> Self {
        Self(exit::NOT_AS_EXPECTED, message)
    }
}

fn main() -> ExitCode {
    match run(Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure(code, message)) => {
            eprintln!("gantry-tau-proofs: {message}");
            code.into()
        }
    }
}

fn run(arguments: Arguments) -> Result<(), Failure> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).parent();
    let root = arguments.root.or(here.map(Path::to_owned));
    let root = std::path::absolute(root.unwrap_or_default()).map_err(|error| error.to_string())?;
    let manifest = Manifest::load(&root)?;
    match arguments.command {
        Command::List => {
            let (results, sources) = (Results::load(&root)?, Sources::read(&root)?);
            let cells = page::cells(&results.standings(&manifest, &sources));
            report::list(&manifest, &cells);
        }
        Command::Check {
            strict,
            compile,
            coq,
        } => {
            let (results, sources) = (Results::load(&root)?, Sources::read(&root)?);
            let standings = results.standings(&manifest, &sources);
            files_agree(&root, &manifest, &results, &sources, &standings)?;
            results_exist(&root, &manifest, &standings, strict)?;
            if compile {
                mutate::compile(&root, &manifest.mutants)?;
                println!("check: core and C interface compile with every mutant");
            }
            if coq {
                composition::check(&root)?;
            }
        }
        Command::Table => {
            let mut results = Results::load(&root)?;
            results.prune(&manifest);
            results.save(&root, read(&root.join("proofs/kani-version"))?.trim())?;
            page::write(&root, &manifest, &results, &Sources::read(&root)?)?;
            composition::write(&root, &manifest)?;
        }
        Command::Prove(options) => {
            // A run that comes to no result must not look like an earlier one; most often there is
            // none.
            let _ = std::fs::remove_file(options.out(&root).join("results.md"));
            let (results, sources) = (Results::load(&root)?, Sources::read(&root)?);
            let standings = results.standings(&manifest, &sources);
            files_agree(&root, &manifest, &results, &sources, &standings)?;
            if options.names == ["composition"] {
                composition::prove(&root, options.tier)?;
                return Ok(composition::write(&root, &manifest)?);
            }
            prove::prove(&root, &manifest, &options, results, sources)?;
        }
    }
    Ok(())
}

/// Fails with every disagreement.
fn files_agree(
    root: &Path,
    manifest: &Manifest,
    results: &Results,
    sources: &Sources,
    standings: &Standings<'_>,
) -> Result<(), Failure> {
    let disagreements = check::check(root, manifest, results, sources, standings)?;
    if !disagreements.is_empty() {
        let message = format!("check:\n  {}", disagreements.join("\n  "));
        return Err(Failure(exit::FILES_DISAGREE, message));
    }
    println!(
        "check: {} harnesses, {} mutants; manifest, sources and proofs/RESULTS.md agree",
        manifest.harnesses.len(),
        manifest.mutants.len()
    );
    Ok(())
}

/// Names everything without a result on this source; fails for it if that is strict.
fn results_exist(
    root: &Path,
    manifest: &Manifest,
    standings: &Standings<'_>,
    strict: bool,
) -> Result<(), Failure> {
    let unproved = check::unproved(root, manifest, standings)?;
    let untried = check::untried(standings);
    let pinned = read(&root.join("proofs/kani-version"))?;
    let versions = check::other_versions(standings, pinned.trim());
    for line in unproved.iter().chain(&untried).chain(&versions) {
        println!("{line}");
    }
    let message = if !unproved.is_empty() {
        "not every row has a result on this source; `prove --stale --tier full`"
    } else if !untried.is_empty() {
        "a check that no mutant makes fail may be one of nothing; write a mutant"
    } else {
        return Ok(());
    };
    if strict {
        return Err(Failure(exit::STALE, format!("check --strict: {message}")));
    }
    Ok(())
}

/// Names the file of an error.
fn at<E: Display>(path: &Path) -> impl Fn(E) -> String {
    move |error| format!("{}: {error}", path.display())
}

/// Text of a file.
fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(at(path))
}

/// Every file below a folder, but for those of Cargo's `target`. A link that leads nowhere (a
/// licence, in a copy) is left out.
fn files(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(at(folder))? {
        let path = entry.map_err(at(folder))?.path();
        if path.is_file() {
            found.push(path);
        } else if path.is_dir() && !path.ends_with("target") {
            found.extend(files(&path)?);
        }
    }
    Ok(found)
}
