//! Chosen jobs, one after the other, and the report.

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use gantry_tau_proofs::harness::Harness;

use crate::kani::{self, INTERRUPTED, Kani, Phase};
use crate::manifest::{Manifest, Mutant, Row, Tier};
use crate::report::{Outcome, Report};
use crate::verdict::Findings;
use crate::{Failure, Prove, at, check, exit, mutate, read};

/// One run of Kani: a harness, with or without a mutant.
#[derive(Clone, Copy)]
pub(crate) struct Job<'a> {
    pub(crate) harness: &'a Harness,
    pub(crate) row: &'a Row,
    pub(crate) mutant: Option<&'a Mutant>,
}

impl Job<'_> {
    pub(crate) fn name(&self) -> &str {
        self.mutant.map_or(&self.row.name, |mutant| &mutant.name)
    }

    pub(crate) fn tier(&self) -> Tier {
        self.mutant.map_or(self.row.tier, |mutant| mutant.tier)
    }
}

/// Every job. Harnesses first: a proof that fails explains why its mutants do.
fn jobs(manifest: &Manifest) -> Vec<Job<'_>> {
    let proofs = manifest.harnesses.iter().map(|row| (Some(row), None));
    let mutants = manifest.mutants.iter().map(|mutant| (manifest.row(&mutant.harness), Some(mutant)));
    let jobs = proofs.chain(mutants).filter_map(|(row, mutant)| {
        let row = row?;
        Some(Job { harness: check::harness(&row.name)?, row, mutant })
    });
    jobs.collect()
}

/// Jobs of a tier, or the named ones; an unknown name is an error.
fn choose<'a>(manifest: &'a Manifest, tier: Tier, names: &[String]) -> Result<Vec<Job<'a>>, String> {
    let mut jobs = jobs(manifest);
    let unknown = |name: &&String| jobs.iter().all(|job| job.name() != name.as_str());
    if let Some(name) = names.iter().find(unknown) {
        return Err(format!("no harness or mutant is called {name}; `list` shows them"));
    }
    jobs.retain(|job| match names {
        [] => job.tier() <= tier,
        names => names.iter().any(|name| job.name() == name),
    });
    Ok(jobs)
}

/// Gives every chosen job to Kani.
pub(crate) fn prove(root: &Path, manifest: &Manifest, options: &Prove) -> Result<(), Failure> {
    let jobs = choose(manifest, options.tier, &options.names).map_err(|message| Failure(exit::USAGE, message))?;
    let pinned = read(&root.join("proofs/kani-version"))?;
    let pinned = pinned.trim();
    let version = kani::version().map_err(|reason| missing(pinned, &reason))?;
    println!("Kani {version} (proofs/kani-version: {pinned})");
    let kani = Kani {
        target: root.join("target/kani"),
        logs: options.out(root).join("logs"),
        memory_gib: options.memory_gib,
        build_limit: Duration::from_secs(options.build_minutes.saturating_mul(60)),
    };
    std::fs::create_dir_all(&kani.logs).map_err(at(&kani.logs))?;
    // Fails only where a handler is set already.
    let _ = ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::Relaxed));
    let report = Report {
        kani: &version,
        pinned,
        tier: options.tier,
        outcomes: run_all(root, &kani, &jobs, options.seconds)?,
        walls: &manifest.walls,
    };
    report.write(&options.out(root))?;
    let summary = report.summary();
    // An empty run proves nothing.
    if jobs.is_empty() || report.as_expected() < jobs.len() {
        return Err(summary.into());
    }
    println!("{summary}");
    Ok(())
}

/// Message for a machine without Kani: nothing was proved, in words that cannot be overlooked.
fn missing(pinned: &str, reason: &str) -> Failure {
    let reason = reason.lines().next().unwrap_or("nothing");
    let message = format!(
        "SKIPPED, NOTHING WAS PROVED: `cargo kani` cannot be run here.\n  Cargo says: {reason}\n  \
         To install it: cargo install --locked kani-verifier --version {pinned} && cargo kani setup"
    );
    Failure(exit::KANI_MISSING, message)
}

fn run_all<'a>(root: &Path, kani: &Kani, jobs: &[Job<'a>], seconds: Option<f64>) -> Result<Vec<Outcome<'a>>, String> {
    let mut outcomes = Vec::new();
    let moves = std::io::stdout().is_terminal();
    for (index, &job) in (1..).zip(jobs) {
        let title = format!("[{index}/{}] {} ... ", jobs.len(), job.name());
        show(&title);
        let limit = seconds.unwrap_or(job.tier().seconds());
        let began = Instant::now();
        let proofs = sources(root, kani, job.mutant)?;
        let time = Duration::from_secs_f64(limit);
        let (end, log) = kani
            .run(job, &proofs, time, |phase| {
                if moves {
                    show(&format!("\r\x1b[K{title}{phase:?}, {} s", began.elapsed().as_secs()));
                }
            })
            .map_err(|error| format!("{}: {error}", job.name()))?;
        let bytes = std::fs::read(&log).map_err(at(&log))?;
        let output = String::from_utf8_lossy(&bytes);
        let findings = Findings::read(&output);
        let outcome =
            Outcome { job, limit, seconds: findings.seconds, objection: objection(job, end, &findings, limit), log };
        if moves {
            show(&format!("\r\x1b[K{title}"));
        }
        println!("{}", outcome.line(began.elapsed()));
        outcomes.push(outcome);
    }
    Ok(outcomes)
}

/// Prints a part of a line at once.
fn show(text: &str) {
    print!("{text}");
    // A closed pipe does not stop the run.
    let _ = std::io::stdout().flush();
}

/// Folder of the proofs to run: the sources, or for a mutant a copy with its fault.
fn sources(root: &Path, kani: &Kani, mutant: Option<&Mutant>) -> Result<PathBuf, String> {
    let Some(mutant) = mutant else { return Ok(root.join("proofs")) };
    let copy = kani.target.join("copy");
    mutate::copy(root, &copy)?;
    mutate::apply(&copy, mutant)?;
    Ok(copy.join("proofs"))
}

/// Reason why a run is not as expected; none if it is.
fn objection(job: Job<'_>, end: kani::End, findings: &Findings, limit: f64) -> Option<String> {
    match end {
        Err(Phase::Solving) => Some(format!("timed out after {limit} s")),
        Err(Phase::Building) => Some("timed out while building".to_owned()),
        Ok(status) => findings
            .objection(job, limit)
            .or_else(|| (status.success() == job.mutant.is_some()).then(|| format!("Kani ended with {status}"))),
    }
}
