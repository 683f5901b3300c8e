//! `proofs/manifest.toml` and `proofs/mutants.toml`: theorems, harnesses, mutants and walls.

use std::fmt;
use std::path::Path;

use clap::ValueEnum;
use serde::Deserialize;
use serde::de::DeserializeOwned;

/// Contents of both files.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Manifest {
    #[serde(rename = "theorem")]
    pub(crate) theorems: Vec<Theorem>,
    #[serde(rename = "harness")]
    pub(crate) harnesses: Vec<Row>,
    #[serde(default, rename = "wall")]
    pub(crate) walls: Vec<Wall>,
    /// From the other file.
    #[serde(skip)]
    pub(crate) mutants: Vec<Mutant>,
}

/// Claim about core.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Theorem {
    pub(crate) name: String,
    pub(crate) statement: String,
    /// "proved", "tested", or both, in words.
    pub(crate) how: String,
}

/// Row of a harness; the source declares the rest.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Row {
    pub(crate) name: String,
    pub(crate) theorems: Vec<String>,
    pub(crate) property: String,
    pub(crate) domain: String,
    pub(crate) tier: Tier,
    /// Texts of checks or covers that must hold, where no check begins with the name of one of the
    /// theorems.
    #[serde(default)]
    pub(crate) requires: Vec<String>,
    /// Texts of checks of its property that the domain does not reach.
    #[serde(default)]
    pub(crate) leaves_out: Vec<String>,
    /// Assumptions behind the functions that the harness replaces, in words.
    #[serde(default)]
    pub(crate) assumes: Vec<String>,
}

/// Core, or the C interface, with one line wrong on purpose; its harness must fail.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Mutant {
    pub(crate) name: String,
    /// The fault, in words.
    pub(crate) change: String,
    /// Source of core or of the C interface, from the repository's root.
    pub(crate) file: String,
    /// Text that stands exactly once in the file, and its replacement.
    pub(crate) old: String,
    pub(crate) new: String,
    /// Harness that must fail.
    pub(crate) harness: String,
    /// Check that must fail, or a part of its text.
    pub(crate) fails: String,
    pub(crate) tier: Tier,
}

/// Statement that no solver could carry, and that is not claimed.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Wall {
    pub(crate) theorem: String,
    pub(crate) what: String,
}

/// Time limit of the solver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize, ValueEnum)]
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

impl Manifest {
    /// Reads both files of a repository.
    pub(crate) fn load(root: &Path) -> Result<Self, String> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Mutants {
            mutant: Vec<Mutant>,
        }
        let mut manifest: Self = parse(&root.join("proofs/manifest.toml"))?;
        manifest.mutants = parse::<Mutants>(&root.join("proofs/mutants.toml"))?.mutant;
        Ok(manifest)
    }

    /// Rows that prove a part of a theorem.
    pub(crate) fn rows_of<'a>(&'a self, theorem: &'a Theorem) -> impl Iterator<Item = &'a Row> {
        self.harnesses
            .iter()
            .filter(|row| row.theorems.contains(&theorem.name))
    }

    /// Row of a harness.
    pub(crate) fn row(&self, name: &str) -> Option<&Row> {
        self.harnesses.iter().find(|row| row.name == name)
    }
}

fn parse<T: DeserializeOwned>(path: &Path) -> Result<T, String> {
    let text = crate::read(path)?;
    toml::from_str(&text).map_err(crate::at(path))
}
