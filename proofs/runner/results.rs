//! `proofs/results.json`: the latest result of every harness and mutant, and the sources it is of.
//! `prove` writes it, and nothing else.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::manifest::Manifest;
use crate::prove::{self, Job};
use crate::sources::Sources;
use crate::{at, kani, read};

/// File from the repository's root.
pub(crate) const PATH: &str = "proofs/results.json";

/// Raised when a field goes or changes its meaning.
const FORMAT: u32 = 3;

/// Result of one run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Entry {
    /// Harness or mutant.
    pub(crate) name: String,
    pub(crate) verdict: Verdict,
    /// Reason for a failure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) objection: Option<String>,
    /// Solver time, s; none if there was no result.
    pub(crate) seconds: Option<f64>,
    /// Number of checks that hold, and of covers that are reached.
    pub(crate) checks: usize,
    pub(crate) covers: usize,
    /// Texts of the proofs' own assertions that are reached and hold.
    pub(crate) states: Vec<String>,
    /// Of a mutant: texts of those that fail.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) fell: Vec<String>,
    /// Versions that ran.
    pub(crate) kani: String,
    pub(crate) cbmc: String,
    pub(crate) rustc: String,
    /// Hash of the sources.
    pub(crate) sources: String,
}

/// Verdict of one run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Verdict {
    /// A harness: every check holds.
    Verified,
    /// A mutant: the named check fails, as it must.
    Caught,
    /// Anything else.
    Failed,
}

/// Results of all rows that have run.
#[derive(Debug, Default)]
pub(crate) struct Results(BTreeMap<String, Entry>);

/// Standing of a row on this source.
pub(crate) enum Standing<'a> {
    Current(&'a Entry),
    Failed(&'a Entry),
    /// Result of other sources.
    Stale,
    NotRun,
}

/// Standings of all jobs.
pub(crate) type Standings<'a> = Vec<(Job<'a>, Standing<'a>)>;

impl Standing<'_> {
    /// Sentence about a row without a current result.
    pub(crate) fn complaint(&self, name: &str) -> Option<String> {
        match self {
            Self::Current(_) => None,
            Self::Failed(entry) => Some(format!(
                "STALE: {name} (failed: {})",
                entry.objection.as_deref().unwrap_or_default()
            )),
            Self::Stale => Some(format!("STALE: {name} (ran on other sources)")),
            Self::NotRun => Some(format!("STALE: {name} (has not run)")),
        }
    }
}

/// File as it stands.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    format: u32,
    /// For readers: every entry's hash contains them.
    #[serde(rename = "flags")]
    _flags: String,
    #[serde(rename = "kani_pinned")]
    _pinned: String,
    rows: Vec<Entry>,
}

impl Results {
    /// Reads a repository's results; there are none without the file.
    pub(crate) fn load(root: &Path) -> Result<Self, String> {
        let path = root.join(PATH);
        if !path.exists() {
            return Ok(Self::default());
        }
        let written: Written = serde_json::from_str(&read(&path)?).map_err(at(&path))?;
        if written.format != FORMAT {
            return Err(format!(
                "{PATH}: format {}, this program writes {FORMAT}",
                written.format
            ));
        }
        Ok(Self(
            written
                .rows
                .into_iter()
                .map(|entry| (entry.name.clone(), entry))
                .collect(),
        ))
    }

    /// Replaces the result of one row. A result that says the same of the same sources leaves the
    /// file, and the seconds, as they are.
    pub(crate) fn merge(&mut self, entry: Entry) {
        let is_same = self.0.get(&entry.name).is_some_and(|old| {
            Entry {
                seconds: old.seconds,
                ..entry.clone()
            } == *old
        });
        if !is_same {
            self.0.insert(entry.name.clone(), entry);
        }
    }

    /// Forgets rows that the manifest has no more.
    pub(crate) fn prune(&mut self, manifest: &Manifest) {
        let jobs = prove::jobs(manifest);
        self.0
            .retain(|name, _| jobs.iter().any(|job| job.name() == name));
    }

    /// Writes the file: sorted by name, one row per line.
    pub(crate) fn save(&self, root: &Path, pinned: &str) -> Result<(), String> {
        let flags = serde_json::Value::from(kani::FLAGS.join(" "));
        let pinned = serde_json::Value::from(pinned);
        let mut text = format!(
            "{{\n\"format\": {FORMAT},\n\"flags\": {flags},\n\"kani_pinned\": {pinned},\n\"rows\": ["
        );
        for (index, entry) in self.0.values().enumerate() {
            let row = serde_json::to_string(entry).map_err(|error| error.to_string())?;
            // Writing to a String cannot fail.
            let _ = write!(text, "{}\n{row}", if index > 0 { "," } else { "" });
        }
        text.push_str("\n]\n}\n");
        let path = root.join(PATH);
        std::fs::write(&path, text).map_err(at(&path))
    }

    pub(crate) fn get(&self, name: &str) -> Option<&Entry> {
        self.0.get(name)
    }

    /// Results of rows that the manifest does not have.
    pub(crate) fn unknown(&self, manifest: &Manifest) -> Vec<&String> {
        let jobs = prove::jobs(manifest);
        self.0
            .keys()
            .filter(|name| jobs.iter().all(|job| job.name() != name.as_str()))
            .collect()
    }

    /// Standings of all jobs on these sources.
    pub(crate) fn standings<'a>(
        &'a self,
        manifest: &'a Manifest,
        sources: &Sources,
    ) -> Standings<'a> {
        let jobs = prove::jobs(manifest).into_iter();
        jobs.map(|job| (job, self.standing(sources, job))).collect()
    }

    /// Standing of a job on these sources.
    pub(crate) fn standing(&self, sources: &Sources, job: Job<'_>) -> Standing<'_> {
        let expected = if job.mutant.is_some() {
            Verdict::Caught
        } else {
            Verdict::Verified
        };
        match self.get(job.name()) {
            None => Standing::NotRun,
            Some(entry) if entry.sources != job.sources(sources) => Standing::Stale,
            Some(entry) if entry.verdict != expected => Standing::Failed(entry),
            Some(entry) => Standing::Current(entry),
        }
    }
}
