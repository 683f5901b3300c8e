//! Findings in Kani's output, and their comparison with what a job expects.

use crate::prove::Job;

/// Findings in Kani's output. A field that the output lacks stays empty, and then nothing is as expected.
#[derive(Debug, Default)]
pub(crate) struct Findings<'a> {
    /// True for `VERIFICATION:- SUCCESSFUL`.
    verified: Option<bool>,
    /// Number of harnesses that ran.
    harnesses: Option<u32>,
    /// Assertions, and other checks of Kani.
    checks: Vec<Check<'a>>,
    covers: Vec<Check<'a>>,
    /// Reason for the lack of a result.
    trouble: Option<&'a str>,
    /// Solver time, s.
    pub(crate) seconds: Option<f64>,
}

/// Status of one check, such as FAILURE, and its text.
type Check<'a> = (&'a str, &'a str);

/// Failures that say nothing about the property: the loop bound is too small, or Kani cannot read the code.
const NOT_ABOUT_THE_PROPERTY: [&str; 4] = [
    "unwinding assertion",
    "is not currently supported by Kani",
    "undefined function should be unreachable",
    "Kani does not support",
];

/// Parts of the lines with the reason for a lack of a result.
const TROUBLE: [&str; 5] = ["error:", "error[", "CBMC failed", "out of memory", "panicked at"];

impl<'a> Findings<'a> {
    pub(crate) fn read(output: &'a str) -> Self {
        let mut found = Self::default();
        let (mut is_cover, mut status) = (false, "");
        for line in output.lines().map(str::trim) {
            let value = |key| line.strip_prefix(key);
            if line.starts_with("Check ") {
                is_cover = line.contains(".cover.");
            } else if let Some(text) = value("- Status: ") {
                status = text;
            } else if let Some(text) = value("- Description: ") {
                let kind = if is_cover { &mut found.covers } else { &mut found.checks };
                kind.push((status, text.trim_matches('"')));
            } else if let Some(result) = value("VERIFICATION:- ") {
                found.verified = Some(result == "SUCCESSFUL");
            } else if let Some(time) = value("Verification Time: ") {
                found.seconds = time.strip_suffix('s').and_then(|time| time.parse().ok());
            } else if let Some(counts) = value("Complete - ") {
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
        let (Some(harnesses), Some(verified), Some(seconds)) = (self.harnesses, self.verified, self.seconds) else {
            let trouble = self.trouble.unwrap_or("its output is not understood");
            return Some(format!("Kani came to no result: {trouble}"));
        };
        if harnesses != 1 {
            return Some(format!("{harnesses} harnesses ran instead of one"));
        }
        if seconds > limit {
            return Some(format!("took {seconds:.1} s, its tier allows {limit} s"));
        }
        match job.mutant {
            None => self.not_proved(verified),
            Some(mutant) => self.not_caught(verified, &mutant.fails),
        }
    }

    /// Objection to a proof: every check must hold, every cover must be reached, and there must be some of both.
    fn not_proved(&self, verified: bool) -> Option<String> {
        let failed = self.failed();
        let missed = texts(&self.covers, |status| status != "SATISFIED");
        let decided = |(status, _): &Check<'_>| ["SUCCESS", "UNREACHABLE"].contains(status);
        if !verified || !failed.is_empty() {
            Some(format!("failed: {}", failed.join("; ")))
        } else if self.checks.is_empty() {
            Some("it checks nothing".to_owned())
        } else if !self.checks.iter().all(decided) {
            Some("Kani could not decide some checks".to_owned())
        } else if self.covers.is_empty() {
            Some("it has no cover: it may prove nothing".to_owned())
        } else if !missed.is_empty() {
            let all = self.covers.len();
            let reached = all.saturating_sub(missed.len());
            Some(format!("{reached} of {all} covers reached; not: {}", missed.join("; ")))
        } else {
            None
        }
    }

    /// Objection to a mutant: the named check must fail, and nothing that hides it.
    fn not_caught(&self, verified: bool, expected: &str) -> Option<String> {
        let failed = self.failed();
        let hides = |text: &&&str| NOT_ABOUT_THE_PROPERTY.iter().any(|known| text.contains(known));
        if verified {
            Some("the mutant verifies: the harness does not notice the fault".to_owned())
        } else if let Some(text) = failed.iter().find(hides) {
            Some(format!("failed for another reason: {text}"))
        } else if failed.iter().any(|text| text.contains(expected)) {
            None
        } else {
            let failed = failed.join("; ");
            Some(format!("the wrong check failed: {failed} (expected: {expected})"))
        }
    }

    /// Texts of the checks that failed.
    fn failed(&self) -> Vec<&'a str> {
        texts(&self.checks, |status| status == "FAILURE")
    }
}

/// Texts of the checks with such a status.
fn texts<'a>(checks: &[Check<'a>], such: impl Fn(&str) -> bool) -> Vec<&'a str> {
    checks.iter().filter(|(status, _)| such(status)).map(|(_, text)| *text).collect()
}
