//! All chosen jobs, one after the other, and the report.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crate::job::{self, Job};
use crate::kani::{self, INTERRUPTED, Kani, Phase, Run};
use crate::manifest::Manifest;
use crate::progress::Progress;
use crate::report::{Outcome, Report};
use crate::source;
use crate::verdict::Findings;
use crate::{End, Prove};

pub(crate) fn prove(root: &Path, manifest: &Manifest, options: &Prove) -> Result<End, String> {
    let families = source::families(root)?;
    let jobs = match job::choose(manifest, &families, options.tier, &options.names) {
        Ok(jobs) => jobs,
        Err(error) => {
            eprintln!("gantry-tau-proofs: {error}");
            return Ok(End::Usage);
        }
    };
    let pinned = source::pinned_kani(root)?;
    let version = match kani::version() {
        Ok(version) => version,
        Err(reason) => {
            say_missing(&pinned, &reason);
            return Ok(End::KaniMissing);
        }
    };
    println!("Kani {version} (proofs/kani-version: {pinned})");
    let kani = set_up(root, options, version)?;
    // Fails only where a handler is set already.
    let _ = ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::Relaxed));
    let outcomes = run_all(&kani, &jobs, options.seconds)?;
    let report = Report::new(&kani.version, &pinned, options.tier, outcomes, manifest);
    report.print();
    report.write(&options.out(root))?;
    Ok(if report.all_as_expected() {
        End::AsExpected
    } else {
        End::NotAsExpected
    })
}

fn set_up(root: &Path, options: &Prove, version: String) -> Result<Kani, String> {
    let kani = Kani {
        version,
        proofs: root.join("proofs"),
        target: root.join("target/kani"),
        logs: options.out(root).join("logs"),
        memory_gib: options.memory_gib,
        build_limit: Duration::from_secs(options.build_minutes.saturating_mul(60)),
    };
    let complain = |error| format!("{}: {error}", kani.logs.display());
    kani.prepare().map_err(complain)?;
    Ok(kani)
}

/// Nothing was proved, and nobody may think so.
fn say_missing(pinned: &str, reason: &str) {
    eprintln!("gantry-tau-proofs: NOTHING WAS PROVED: `cargo kani` cannot be run here.");
    eprintln!(
        "  Cargo says: {}",
        reason.lines().next().unwrap_or("nothing")
    );
    eprintln!(
        "  To install it: cargo install --locked kani-verifier --version {pinned} && cargo kani setup"
    );
}

fn run_all(kani: &Kani, jobs: &[Job<'_>], seconds: Option<f64>) -> Result<Vec<Outcome>, String> {
    let mut progress = Progress::new(jobs.len());
    let mut outcomes = Vec::new();
    for (index, job) in (1..).zip(jobs) {
        progress.begin(index, job.name());
        let limit = seconds.unwrap_or(job.tier().seconds());
        let began = Instant::now();
        let run = kani.run(*job, Duration::from_secs_f64(limit), |phase| {
            progress.glance(phase)
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

fn judge(job: Job<'_>, run: &Run, limit: f64) -> Result<Outcome, String> {
    let text = kani::read(&run.log).map_err(|error| format!("{}: {error}", run.log.display()))?;
    let findings = Findings::read(&text);
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
