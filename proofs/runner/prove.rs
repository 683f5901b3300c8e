//! Chosen jobs, one after the other, and the report.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use gantry_tau_proofs::harness::Harness;

use crate::kani::{self, INTERRUPTED, Kani, Phase, Run};
use crate::manifest::{Manifest, Mutant, Row, Tier};
use crate::mutate::Copy;
use crate::progress::Progress;
use crate::report::{Outcome, Report};
use crate::verdict::Findings;
use crate::{End, Prove, check, read};

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
    let declared = check::declared();
    let job = |row, mutant| {
        let row: &Row = row;
        let harness = declared.get(row.name.as_str())?;
        Some(Job {
            harness,
            row,
            mutant,
        })
    };
    let proofs = manifest.harnesses.iter().filter_map(|row| job(row, None));
    let mutants = manifest.mutants.iter();
    let controls = mutants.filter_map(|mutant| job(manifest.row(&mutant.harness)?, Some(mutant)));
    proofs.chain(controls).collect()
}

/// Jobs of a tier, or the named ones; an unknown name is an error.
fn choose<'a>(
    manifest: &'a Manifest,
    tier: Tier,
    names: &[String],
) -> Result<Vec<Job<'a>>, String> {
    let mut jobs = jobs(manifest);
    let unknown = |name: &&String| jobs.iter().all(|job| job.name() != name.as_str());
    if let Some(name) = names.iter().find(unknown) {
        return Err(format!(
            "no harness or mutant is called {name}; `list` shows them"
        ));
    }
    jobs.retain(|job| match names {
        [] => job.tier() <= tier,
        names => names.iter().any(|name| job.name() == name),
    });
    Ok(jobs)
}

/// Gives every chosen job to Kani.
pub(crate) fn prove(root: &Path, manifest: &Manifest, options: &Prove) -> Result<End, String> {
    let jobs = match choose(manifest, options.tier, &options.names) {
        Ok(jobs) => jobs,
        Err(error) => {
            eprintln!("gantry-tau-proofs: {error}");
            return Ok(End::Usage);
        }
    };
    let pinned = read(&root.join("proofs/kani-version"))?.trim().to_owned();
    let version = match kani::version() {
        Ok(version) => version,
        Err(reason) => {
            say_missing(&pinned, &reason);
            return Ok(End::KaniMissing);
        }
    };
    println!("Kani {version} (proofs/kani-version: {pinned})");
    let kani = Kani {
        version,
        target: root.join("target/kani"),
        logs: options.out(root).join("logs"),
        memory_gib: options.memory_gib,
        build_limit: Duration::from_secs(options.build_minutes.saturating_mul(60)),
    };
    std::fs::create_dir_all(&kani.logs)
        .map_err(|error| format!("{}: {error}", kani.logs.display()))?;
    // Fails only where a handler is set already.
    let _ = ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::Relaxed));
    let outcomes = run_all(root, &kani, &jobs, options.seconds)?;
    let report = Report::new(&kani.version, &pinned, options.tier, outcomes, manifest);
    report.print();
    report.write(&options.out(root))?;
    Ok(if report.all_as_expected() {
        End::AsExpected
    } else {
        End::NotAsExpected
    })
}

/// Says that nothing was proved, in words that cannot be overlooked.
fn say_missing(pinned: &str, reason: &str) {
    let reason = reason.lines().next().unwrap_or("nothing");
    eprintln!(
        "gantry-tau-proofs: SKIPPED, NOTHING WAS PROVED: `cargo kani` cannot be run here.\n  \
         Cargo says: {reason}\n  \
         To install it: cargo install --locked kani-verifier --version {pinned} && cargo kani setup"
    );
}

fn run_all(
    root: &Path,
    kani: &Kani,
    jobs: &[Job<'_>],
    seconds: Option<f64>,
) -> Result<Vec<Outcome>, String> {
    let mut progress = Progress::new(jobs.len());
    let mut outcomes = Vec::new();
    for (index, job) in (1..).zip(jobs) {
        progress.begin(index, job.name());
        let limit = seconds.unwrap_or(job.tier().seconds());
        let began = Instant::now();
        let proofs = sources(root, kani, job.mutant)?;
        let run = kani.run(*job, &proofs, Duration::from_secs_f64(limit), |phase| {
            progress.show(phase);
        });
        let run = run.map_err(|error| format!("{}: {error}", job.name()))?;
        if matches!(run.end, kani::End::Interrupted) {
            return Err("interrupted; Kani and its solvers were ended".to_owned());
        }
        let outcome = judge(*job, &run, limit)?;
        progress.end(&outcome.line(began.elapsed()));
        outcomes.push(outcome);
    }
    Ok(outcomes)
}

/// Folder of the proofs to run: the sources, or for a mutant a copy with its fault.
fn sources(root: &Path, kani: &Kani, mutant: Option<&Mutant>) -> Result<PathBuf, String> {
    let Some(mutant) = mutant else {
        return Ok(root.join("proofs"));
    };
    let copy = Copy::new(root, kani.target.join("copy"))?;
    copy.apply(mutant)?;
    Ok(copy.proofs())
}

fn judge(job: Job<'_>, run: &Run, limit: f64) -> Result<Outcome, String> {
    let bytes =
        std::fs::read(&run.log).map_err(|error| format!("{}: {error}", run.log.display()))?;
    let findings = Findings::read(&String::from_utf8_lossy(&bytes));
    let objection = match run.end {
        kani::End::TimedOut(Phase::Solving) => Some(format!("timed out after {limit} s")),
        kani::End::TimedOut(Phase::Building) => Some("timed out while building".to_owned()),
        kani::End::Exited(status) => findings.objection(job, limit).or_else(|| {
            (status.success() == job.mutant.is_some()).then(|| format!("Kani ended with {status}"))
        }),
        kani::End::Interrupted => Some("interrupted".to_owned()),
    };
    Ok(Outcome::new(
        job,
        limit,
        findings.seconds,
        objection,
        &run.log,
    ))
}
