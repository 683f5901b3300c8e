//! Findings in Kani's output, and their comparison with what a job expects.

use std::collections::{BTreeMap, BTreeSet};

use crate::prove::Job;

/// Findings in Kani's output. A field that the output lacks stays empty, and then nothing is as
/// expected.
#[derive(Debug, Default)]
pub(crate) struct Findings<'a> {
    /// True for `VERIFICATION:- SUCCESSFUL`.
    verified: Option<bool>,
    /// Number of harnesses that ran, and the path of the first.
    harnesses: Option<u32>,
    harness: Option<&'a str>,
    /// Assertions, and other checks of Kani.
    checks: Vec<Check<'a>>,
    covers: Vec<Check<'a>>,
    /// Reason for the lack of a result.
    trouble: Option<&'a str>,
    /// Solver time, s.
    pub(crate) seconds: Option<f64>,
    /// Version of CBMC.
    pub(crate) cbmc: Option<&'a str>,
}

/// One check or cover.
#[derive(Debug)]
struct Check<'a> {
    /// Such as FAILURE.
    status: &'a str,
    /// Description. Kani puts the literal message of an `assert!` between quotes of its own.
    text: &'a str,
    /// File, line, column and function; empty where Kani names none.
    place: &'a str,
}

impl Check<'_> {
    /// True for an `assert!` of the proofs: its message, or its condition.
    ///
    /// A `panic!` is not one. It must not be reached, so UNREACHABLE is as good as SUCCESS; Kani
    /// reports its message without quotes.
    fn is_stated(&self) -> bool {
        // The function may name a closure of the proofs, though the check is the standard
        // library's.
        let site = self.place.split(" in function ").next();
        site.is_some_and(|site| site.contains("proofs/src/"))
            && (self.text.starts_with('"') || self.text.starts_with("assertion failed: "))
    }
}

/// Failures that say nothing about the property: the loop bound is too small, or Kani cannot read
/// the code.
const NOT_ABOUT_THE_PROPERTY: [&str; 4] = [
    "unwinding assertion",
    "is not currently supported by Kani",
    "undefined function should be unreachable",
    "Kani does not support",
];

/// Parts of the lines with the reason for a lack of a result.
const TROUBLE: [&str; 5] = [
    "error:",
    "error[",
    "CBMC failed",
    "out of memory",
    "panicked at",
];

impl<'a> Findings<'a> {
    pub(crate) fn read(output: &'a str) -> Self {
        let mut found = Self::default();
        let mut is_cover = false;
        let mut status = "";
        for line in output.lines().map(str::trim) {
            if line.starts_with("Check ") {
                is_cover = line.contains(".cover.");
            } else if let Some(text) = line.strip_prefix("- Status: ") {
                status = text;
            } else if let Some(text) = line.strip_prefix("- Description: ") {
                let kind = if is_cover {
                    &mut found.covers
                } else {
                    &mut found.checks
                };
                let text = text
                    .strip_prefix('"')
                    .and_then(|text| text.strip_suffix('"'))
                    .unwrap_or(text);
                kind.push(Check {
                    status,
                    text,
                    place: "",
                });
            } else if let Some(place) = line.strip_prefix("- Location: ") {
                let kind = if is_cover {
                    &mut found.covers
                } else {
                    &mut found.checks
                };
                if let Some(check) = kind.last_mut() {
                    check.place = place;
                }
            } else if let Some(path) = line.strip_prefix("Checking harness ") {
                found.harness.get_or_insert(path.trim_end_matches('.'));
            } else if let Some(version) = line.strip_prefix("CBMC version ") {
                found.cbmc = version.split(' ').next();
            } else if let Some(result) = line.strip_prefix("VERIFICATION:- ") {
                found.verified = Some(result == "SUCCESSFUL");
            } else if let Some(time) = line.strip_prefix("Verification Time: ") {
                found.seconds = time.strip_suffix('s').and_then(|time| time.parse().ok());
            } else if let Some(counts) = line.strip_prefix("Complete - ") {
                let total = counts.strip_suffix(" total.");
                found.harnesses = total.and_then(|counts| counts.rsplit(' ').next()?.parse().ok());
            } else if TROUBLE.iter().any(|known| line.contains(known)) {
                found.trouble.get_or_insert(line);
            }
        }
        found
    }

    /// Reason why this is not what the job expects; none if it is.
    pub(crate) fn objection(&self, job: Job<'_>, limit: f64) -> Option<String> {
        let (Some(harnesses), Some(verified), Some(seconds)) =
            (self.harnesses, self.verified, self.seconds)
        else {
            let trouble = self.trouble.unwrap_or("its output is not understood");
            return Some(format!("Kani came to no result: {trouble}"));
        };
        if harnesses != 1 {
            return Some(format!("{harnesses} harnesses ran instead of one"));
        }
        let path = job.harness.path();
        if self.harness != Some(path.as_str()) {
            return Some(format!(
                "{} ran instead of {path}",
                self.harness.unwrap_or("no harness")
            ));
        }
        if seconds > limit {
            return Some(format!("took {seconds:.1} s, its tier allows {limit} s"));
        }
        match job.mutant {
            None => self.not_proved(verified).or_else(|| self.not_stated(job)),
            Some(mutant) => self.not_caught(verified, &mutant.fails),
        }
    }

    /// Objection to a proof: every check must hold, every cover must be reached, and there must be
    /// some of both.
    fn not_proved(&self, verified: bool) -> Option<String> {
        let failed = self.failed();
        let missed = texts(&self.covers, |status| status != "SATISFIED");
        let mut statuses = self.checks.iter().map(|check| check.status);
        let are_decided = statuses.all(|status| ["SUCCESS", "UNREACHABLE"].contains(&status));
        if !verified || !failed.is_empty() {
            Some(format!("failed: {}", failed.join("; ")))
        } else if self.checks.is_empty() {
            Some("it checks nothing".to_owned())
        } else if !are_decided {
            Some("Kani could not decide some checks".to_owned())
        } else if self.covers.is_empty() {
            Some("it has no cover: it may prove nothing".to_owned())
        } else if !missed.is_empty() {
            let all = self.covers.len();
            let reached = all.saturating_sub(missed.len());
            Some(format!(
                "{reached} of {all} covers reached; not: {}",
                missed.join("; ")
            ))
        } else {
            None
        }
    }

    /// Objection to a proof whose checks hold: one that it states is not reached, a cover does not
    /// say what it covers, or nothing is said about a theorem.
    fn not_stated(&self, job: Job<'_>) -> Option<String> {
        let unreached = self.unreached();
        let left_out = &job.row.leaves_out;
        let forgotten: Vec<&str> = unreached
            .iter()
            .copied()
            .filter(|text| !left_out.iter().any(|left_out| left_out == text))
            .collect();
        if !forgotten.is_empty() {
            return Some(format!("never reached: {}", forgotten.join("; ")));
        }
        if let Some(text) = left_out
            .iter()
            .find(|text| !unreached.contains(&text.as_str()))
        {
            return Some(format!(
                "left out by the manifest, and not among the checks that are never reached: {text}"
            ));
        }
        if let Some(cover) = self.covers.iter().find(|cover| !says_what(cover.text)) {
            return Some(format!(
                "a cover does not say what it covers: {}",
                cover.place
            ));
        }
        let stated = self.stated();
        let covers = texts(&self.covers, |_| true);
        let mut required = job.row.requires.iter().map(String::as_str);
        if let Some(missing) =
            required.find(|text| !stated.contains(text) && !covers.contains(text))
        {
            return Some(format!("required, and not among its checks: {missing}"));
        }
        let named: BTreeSet<&str> = stated
            .iter()
            .filter_map(|text| Some(text.split_once(':')?.0))
            .collect();
        let mut silent = job
            .row
            .theorems
            .iter()
            .filter(|theorem| !named.contains(theorem.as_str()));
        let silent = silent.next().filter(|_| job.row.requires.is_empty())?;
        Some(format!(
            "no check says {silent}, and the manifest requires none by its text"
        ))
    }

    /// Stated checks that are reached nowhere. A generic function has one for each of its
    /// instances: one of them is enough.
    fn unreached(&self) -> Vec<&'a str> {
        let mut sites = BTreeMap::new();
        for check in self.checks.iter().filter(|check| check.is_stated()) {
            let site = check
                .place
                .split(" in function ")
                .next()
                .unwrap_or_default();
            let reached: &mut bool = sites.entry((site, check.text)).or_default();
            *reached |= check.status == "SUCCESS";
        }
        sites
            .into_iter()
            .filter(|(_, reached)| !reached)
            .map(|((_, text), _)| text.trim_matches('"'))
            .collect()
    }

    /// Texts of the stated checks that hold.
    pub(crate) fn stated(&self) -> BTreeSet<&'a str> {
        self.stated_as("SUCCESS")
    }

    /// Texts of the stated checks that fail.
    pub(crate) fn fell(&self) -> BTreeSet<&'a str> {
        self.stated_as("FAILURE")
    }

    fn stated_as(&self, status: &str) -> BTreeSet<&'a str> {
        let such = self
            .checks
            .iter()
            .filter(|check| check.is_stated() && check.status == status);
        such.map(|check| check.text.trim_matches('"')).collect()
    }

    /// Number of checks that hold, and of covers that are reached.
    pub(crate) fn counts(&self) -> (usize, usize) {
        (
            count(&self.checks, "SUCCESS"),
            count(&self.covers, "SATISFIED"),
        )
    }

    /// Objection to a mutant: the named check must fail, and nothing that hides it.
    fn not_caught(&self, verified: bool, expected: &str) -> Option<String> {
        let failed = self.failed();
        let hiding = failed.iter().find(|text| {
            NOT_ABOUT_THE_PROPERTY
                .iter()
                .any(|known| text.contains(known))
        });
        if verified {
            Some("the mutant verifies: the harness does not notice the fault".to_owned())
        } else if let Some(text) = hiding {
            Some(format!("failed for another reason: {text}"))
        } else if failed.iter().any(|text| text.contains(expected)) {
            None
        } else {
            let failed = failed.join("; ");
            Some(format!(
                "the wrong check failed: {failed} (expected: {expected})"
            ))
        }
    }

    /// Texts of the checks that failed.
    fn failed(&self) -> Vec<&'a str> {
        texts(&self.checks, |status| status == "FAILURE")
    }
}

/// Number of the checks with a status.
fn count(checks: &[Check<'_>], status: &str) -> usize {
    checks.iter().filter(|check| check.status == status).count()
}

/// Texts of the checks with such a status.
fn texts<'a>(checks: &[Check<'a>], such: impl Fn(&str) -> bool) -> Vec<&'a str> {
    checks
        .iter()
        .filter(|check| such(check.status))
        .map(|check| check.text.trim_matches('"'))
        .collect()
}

/// True unless a cover's text is empty, a bare condition, or one word.
pub(crate) fn says_what(text: &str) -> bool {
    !text.starts_with("cover condition:") && text.split_whitespace().count() > 1
}
