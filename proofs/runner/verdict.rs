//! Findings in Kani's output, and their comparison with what a job expects.

use crate::prove::Job;

/// Findings in Kani's output. A field that the output lacks stays empty, and then nothing is as expected.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Findings {
    /// `VERIFICATION:- SUCCESSFUL` or `FAILED`.
    verified: Option<bool>,
    /// Harnesses that ran.
    harnesses: Option<u32>,
    /// Checks that failed, and all checks.
    checks: Option<(u32, u32)>,
    /// Checks that Kani could not decide.
    undetermined: bool,
    /// Covers that were reached, and all covers.
    covers: Option<(u32, u32)>,
    /// Texts of the covers that were not reached.
    unreached: Vec<String>,
    /// Texts of the checks that failed.
    failed: Vec<String>,
    /// Reason for the lack of a result.
    trouble: Option<String>,
    /// Solver time, s.
    pub(crate) seconds: Option<f64>,
}

/// Failures that say nothing about the property: the loop bound is too small, or Kani cannot read the code.
const NOT_ABOUT_THE_PROPERTY: [&str; 4] = [
    "unwinding assertion",
    "is not currently supported by Kani",
    "undefined function should be unreachable",
    "Kani does not support",
];

/// Lines with the reason for a lack of a result.
const TROUBLE: [&str; 5] = [
    "error:",
    "error[",
    "CBMC failed",
    "out of memory",
    "panicked at",
];

impl Findings {
    pub(crate) fn read(output: &str) -> Self {
        let mut found = Self::default();
        let (mut cover, mut reached) = (false, false);
        for line in output.lines().map(str::trim) {
            if line.starts_with("Check ") {
                cover = line.contains(".cover.");
            } else if let Some(status) = line.strip_prefix("- Status: ") {
                reached = status == "SATISFIED";
            } else if let Some(text) = line.strip_prefix("- Description: ") {
                if cover && !reached {
                    found.unreached.push(text.to_owned());
                }
            } else {
                found.read_summary(line);
            }
        }
        found
    }

    fn read_summary(&mut self, line: &str) {
        if let Some(result) = line.strip_prefix("VERIFICATION:- ") {
            self.verified = match result {
                "SUCCESSFUL" => Some(true),
                "FAILED" => Some(false),
                _ => None,
            };
        } else if let Some(counts) = line.strip_prefix("** ") {
            self.read_counts(counts);
        } else if let Some(text) = line.strip_prefix("Failed Checks: ") {
            self.failed.push(text.trim_matches('"').to_owned());
        } else if let Some(time) = line.strip_prefix("Verification Time: ") {
            self.seconds = time.strip_suffix('s').and_then(|time| time.parse().ok());
        } else if let Some(counts) = line.strip_prefix("Complete - ") {
            let total = counts.strip_suffix(" total.");
            self.harnesses = total.and_then(|counts| counts.rsplit(' ').next()?.parse().ok());
        } else if TROUBLE.iter().any(|known| line.contains(known)) {
            self.trouble.get_or_insert_with(|| line.to_owned());
        }
    }

    /// `0 of 145 failed (3 unreachable)`, `2 of 2 cover properties satisfied`.
    fn read_counts(&mut self, line: &str) {
        let words: Vec<&str> = line.split(' ').collect();
        let [some, "of", all, what, ..] = words.as_slice() else {
            return;
        };
        let (Ok(some), Ok(all)) = (some.parse(), all.parse()) else {
            return;
        };
        match *what {
            "failed" => {
                self.checks = Some((some, all));
                self.undetermined = line.contains("undetermined");
            }
            "cover" => self.covers = Some((some, all)),
            _ => {}
        }
    }

    /// Reason why this is not what the job expects; none if it is.
    pub(crate) fn objection(&self, job: Job<'_>, limit: f64) -> Option<String> {
        let (Some(harnesses), Some(verified), Some(checks), Some(seconds)) =
            (self.harnesses, self.verified, self.checks, self.seconds)
        else {
            let trouble = self
                .trouble
                .as_deref()
                .unwrap_or("its output is not understood");
            return Some(format!("Kani came to no result: {trouble}"));
        };
        if harnesses != 1 {
            return Some(format!("{harnesses} harnesses ran instead of one"));
        }
        if seconds > limit {
            return Some(format!("took {seconds:.1} s, its tier allows {limit} s"));
        }
        match job.mutant {
            None => self.not_proved(verified, checks),
            Some(mutant) => self.not_caught(verified, &mutant.fails),
        }
    }

    /// Objection to a proof: every check must hold, every cover must be reached, and there must be some of both.
    fn not_proved(&self, verified: bool, (failed, checks): (u32, u32)) -> Option<String> {
        if !verified || failed > 0 {
            return Some(format!("failed: {}", self.failed.join("; ")));
        }
        if checks == 0 {
            return Some("it checks nothing".to_owned());
        }
        if self.undetermined {
            return Some("Kani could not decide some checks".to_owned());
        }
        match self.covers {
            None | Some((_, 0)) => Some("it has no cover: it may prove nothing".to_owned()),
            Some((reached, all)) if reached != all || !self.unreached.is_empty() => Some(format!(
                "{reached} of {all} covers reached; not: {}",
                self.unreached.join("; ")
            )),
            Some(_) => None,
        }
    }

    /// Objection to a mutant: the named check must fail, and nothing that hides it.
    fn not_caught(&self, verified: bool, expected: &str) -> Option<String> {
        if verified {
            return Some("the mutant verifies: the harness does not notice the fault".to_owned());
        }
        let hides = |text: &&String| {
            NOT_ABOUT_THE_PROPERTY
                .iter()
                .any(|known| text.contains(known))
        };
        if let Some(text) = self.failed.iter().find(hides) {
            return Some(format!("failed for another reason: {text}"));
        }
        if self.failed.iter().any(|text| text.contains(expected)) {
            return None;
        }
        Some(format!(
            "the wrong check failed: {} (expected: {expected})",
            self.failed.join("; ")
        ))
    }
}
