//! `proofs/manifest.toml`: every harness, every mutant, every wall.

use std::fmt;
use std::path::Path;

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

/// All of it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Manifest {
    #[serde(default, rename = "harness")]
    pub(crate) harnesses: Vec<Harness>,
    #[serde(default, rename = "mutant")]
    pub(crate) mutants: Vec<Mutant>,
    #[serde(default, rename = "wall")]
    pub(crate) walls: Vec<Wall>,
}

/// A proof, and what it says.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Harness {
    /// The function's name, which is unique over all families.
    pub(crate) name: String,
    pub(crate) theorems: Vec<String>,
    pub(crate) property: String,
    pub(crate) domain: String,
    /// The solver, as in the source's attribute.
    pub(crate) solver: String,
    /// The bound of its loops, as in the source's attribute.
    pub(crate) unwind: Option<u32>,
    pub(crate) tier: Tier,
    pub(crate) verdict: Expected,
    /// Seconds of the solver, where this row was written; `None`: it has not run there, and is not claimed.
    pub(crate) measured_s: Option<f64>,
    /// What is taken for granted because it is substituted (`#[kani::stub]`), in words.
    #[serde(default)]
    pub(crate) assumes: Vec<String>,
}

/// Core with one line wrong on purpose; its harness must fail.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Mutant {
    /// The value of `cfg(mutant = "...")`.
    pub(crate) name: String,
    /// The harness that must notice.
    pub(crate) harness: String,
    /// What is wrong, in words.
    pub(crate) change: String,
    /// The check that must fail, or a part of its text.
    pub(crate) fails: String,
    pub(crate) tier: Tier,
    pub(crate) verdict: Expected,
    /// As a harness' own.
    pub(crate) measured_s: Option<f64>,
}

/// What no solver could carry, and is not claimed.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Wall {
    pub(crate) theorem: String,
    pub(crate) what: String,
}

/// How long the solver may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Tier {
    /// 30 s: on every push
    Fast,
    /// 10 minutes: weekly
    Full,
}

impl Tier {
    pub(crate) const fn seconds(self) -> f64 {
        match self {
            Self::Fast => 30.0,
            Self::Full => 600.0,
        }
    }
}

impl fmt::Display for Tier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Fast => "fast",
            Self::Full => "full",
        })
    }
}

/// What Kani must find.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Expected {
    /// Every check holds, every cover is reached.
    Verified,
    /// The named check fails.
    Fails,
}

impl Manifest {
    pub(crate) fn load(path: &Path) -> Result<Self, String> {
        let text = std::fs::read_to_string(path)
            .map_err(|error| format!("{}: {error}", path.display()))?;
        toml::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))
    }

    pub(crate) fn harness(&self, name: &str) -> Option<&Harness> {
        self.harnesses.iter().find(|harness| harness.name == name)
    }
}
