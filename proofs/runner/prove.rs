//! Chosen jobs, one after the other, and the report.

use std::fs::File;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use gantry_tau_proofs::harness::Harness;

use crate::kani::{self, INTERRUPTED, Kani, Phase};
use crate::manifest::{Manifest, Mutant, Row, Tier};
use crate::report::{Outcome, Report};
use crate::results::{self, Entry, Results, Standing, Verdict};
use crate::sources::Sources;
use crate::verdict::Findings;
use crate::{Failure, Prove, at, check, exit, flags, mutate, page, read};

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

    /// Hash of the sources that its verdict depends on.
    pub(crate) fn sources(&self, sources: &Sources) -> String {
        sources.hash(self.harness.family(), self.row, self.mutant)
    }
}

/// Every job. Harnesses first: a proof that fails explains why its mutants do.
pub(crate) fn jobs(manifest: &Manifest) -> Vec<Job<'_>> {
    let proofs = manifest.harnesses.iter().map(|row| (Some(row), None));
    let mutants = manifest
        .mutants
        .iter()
        .map(|mutant| (manifest.row(&mutant.harness), Some(mutant)));
    let jobs = proofs.chain(mutants).filter_map(|(row, mutant)| {
        let row = row?;
        Some(Job {
            harness: check::harness(&row.name)?,
            row,
            mutant,
        })
    });
    jobs.collect()
}

/// Jobs of a tier, or the named ones, or of these the ones without a current result; an unknown
/// name is an error.
fn choose<'a>(
    manifest: &'a Manifest,
    options: &Prove,
    current: impl Fn(Job<'_>) -> bool,
) -> Result<Vec<Job<'a>>, String> {
    let names = options.names.as_slice();
    let mut jobs = jobs(manifest);
    let mut unknown = names
        .iter()
        .filter(|name| jobs.iter().all(|job| job.name() != name.as_str()));
    if let Some(name) = unknown.next() {
        return Err(format!(
            "no harness or mutant is called {name}; `list` shows them"
        ));
    }
    jobs.retain(|job| !options.stale || !current(*job));
    jobs.retain(|job| match names {
        [] => job.tier() <= options.tier,
        names => names.iter().any(|name| job.name() == name),
    });
    Ok(jobs)
}

/// Locks the folder of the builds: of two runs each would overwrite the results of the other.
fn lock(target: &Path) -> Result<File, String> {
    let path = target.join("lock");
    let file = File::create(&path).map_err(at(&path))?;
    #[cfg(unix)]
    rustix::fs::flock(&file, rustix::fs::FlockOperation::NonBlockingLockExclusive)
        .map_err(|error| format!("{}: another `prove` runs here ({error})", path.display()))?;
    Ok(file)
}

/// Gives every chosen job to Kani. `results` and `sources` are those of the repository.
pub(crate) fn prove(
    root: &Path,
    manifest: &Manifest,
    options: &Prove,
    mut results: Results,
    mut sources: Sources,
) -> Result<(), Failure> {
    let foreign = flags::in_environment();
    if !foreign.is_empty() {
        return Err(Failure(exit::USAGE, foreign.join("\n  ")));
    }
    results.prune(manifest);
    let jobs = choose(manifest, options, |job| {
        matches!(results.standing(&sources, job), Standing::Current(_))
    });
    let jobs = jobs.map_err(|message| Failure(exit::USAGE, message))?;
    let pinned = read(&root.join("proofs/kani-version"))?;
    let pinned = pinned.trim();
    let version = kani::version().map_err(|reason| missing(pinned, &reason))?;
    println!("Kani {version}");
    if version != pinned {
        println!(
            "Kani {version} is not the one that proofs/kani-version names, {pinned}: the results will say {version}"
        );
    }
    let kani = Kani {
        target: root.join("target/kani"),
        logs: options.out(root).join("logs"),
        memory_gib: options.memory_gib,
        build_limit: Duration::from_secs(options.build_minutes.saturating_mul(60)),
    };
    std::fs::create_dir_all(&kani.logs).map_err(at(&kani.logs))?;
    let _lock = lock(&kani.target)?;
    kani.forget_builds().map_err(at(&kani.target))?;
    // Fails only where a handler is set already.
    let _ = ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::Relaxed));
    let mut outcomes = Vec::new();
    for (index, &job) in (1..).zip(&jobs) {
        let title = format!("[{index}/{}] {} ... ", jobs.len(), job.name());
        sources.refresh(root)?;
        let (outcome, entry) = run(
            root,
            &sources,
            &kani,
            job,
            &title,
            options.seconds,
            &version,
        )?;
        // At once: an interrupt loses no result.
        results.merge(entry);
        results.save(root, pinned)?;
        outcomes.push(outcome);
    }
    sources.refresh(root)?;
    page::write(root, manifest, &results, &sources)?;
    println!("results: {} and {}", results::PATH, page::PATH);
    let report = Report {
        kani: &version,
        tier: options.tier,
        outcomes,
        walls: &manifest.walls,
    };
    report.write(&options.out(root))?;
    let summary = report.summary();
    // An empty run proves nothing, unless there is nothing left to prove.
    if (jobs.is_empty() && !options.stale) || report.as_expected() < jobs.len() {
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

/// Runs one job on these sources. Its result is of them, unless they changed meanwhile.
fn run<'a>(
    root: &Path,
    before: &Sources,
    kani: &Kani,
    job: Job<'a>,
    title: &str,
    seconds: Option<f64>,
    version: &str,
) -> Result<(Outcome<'a>, Entry), String> {
    let moves = std::io::stdout().is_terminal();
    show(title);
    let limit = seconds.unwrap_or(job.tier().seconds());
    let began = Instant::now();
    let proofs = sources(root, kani, job.mutant)?;
    let (end, log) = kani
        .run(job, &proofs, Duration::from_secs_f64(limit), |phase| {
            if moves {
                show(&format!(
                    "\r\x1b[K{title}{phase:?}, {} s",
                    began.elapsed().as_secs()
                ));
            }
        })
        .map_err(|error| format!("{}: {error}", job.name()))?;
    let bytes = std::fs::read(&log).map_err(at(&log))?;
    let output = String::from_utf8_lossy(&bytes);
    let findings = Findings::read(&output);
    let changed = (!before.agree(root)?).then(|| "the sources changed while it ran".to_owned());
    let objection = changed.or_else(|| objection(job, end, &findings, limit));
    let entry = entry(job, &findings, objection.clone(), job.sources(before));
    let rustc = kani.rustc().unwrap_or(entry.rustc);
    let entry = Entry {
        kani: version.to_owned(),
        rustc,
        ..entry
    };
    let outcome = Outcome {
        job,
        seconds: findings.seconds,
        objection,
        log,
    };
    if moves {
        show(&format!("\r\x1b[K{title}"));
    }
    println!("{}", outcome.line(began.elapsed()));
    Ok((outcome, entry))
}

/// Version that the output does not say.
const UNKNOWN: &str = "unknown";

/// Row of results.json for a run.
fn entry(job: Job<'_>, findings: &Findings, objection: Option<String>, sources: String) -> Entry {
    let (checks, covers) = findings.counts();
    Entry {
        name: job.name().to_owned(),
        verdict: match (&objection, job.mutant) {
            (Some(_), _) => Verdict::Failed,
            (None, None) => Verdict::Verified,
            (None, Some(_)) => Verdict::Caught,
        },
        objection,
        seconds: findings
            .seconds
            .map(|seconds| (seconds * 100.0).round() / 100.0),
        checks,
        covers,
        states: findings.stated().into_iter().map(str::to_owned).collect(),
        fell: findings
            .fell()
            .into_iter()
            .filter(|_| job.mutant.is_some())
            .map(str::to_owned)
            .collect(),
        kani: UNKNOWN.to_owned(),
        cbmc: findings.cbmc.unwrap_or(UNKNOWN).to_owned(),
        rustc: UNKNOWN.to_owned(),
        sources,
    }
}

/// Prints a part of a line at once.
fn show(text: &str) {
    print!("{text}");
    // A closed pipe does not stop the run.
    let _ = std::io::stdout().flush();
}

/// Folder of the proofs to run: the sources, or for a mutant a copy with its fault.
fn sources(root: &Path, kani: &Kani, mutant: Option<&Mutant>) -> Result<PathBuf, String> {
    let Some(mutant) = mutant else {
        return Ok(root.join("proofs"));
    };
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
        Ok(status) => findings.objection(job, limit).or_else(|| {
            (status.success() == job.mutant.is_some()).then(|| format!("Kani ended with {status}"))
        }),
    }
}
