//! `proofs/composition/results.json`: what Coq has checked. `prove composition` writes it.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{FOLDER, SOURCES, source};
use crate::{at, read, sources};

/// Result of the last check.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Record {
    /// Version of Coq.
    pub(super) coq: String,
    /// Hash of the sources.
    pub(super) sources: String,
    /// Axioms that each theorem rests on.
    pub(super) theorems: BTreeMap<String, Vec<String>>,
    /// Lemma that each mutant makes fail.
    pub(super) mutants: BTreeMap<String, String>,
}

impl Record {
    /// Reads a repository's record; an empty one without the file.
    pub(super) fn load(root: &Path) -> Result<Self, String> {
        let path = root.join(FOLDER).join("results.json");
        if !path.exists() {
            return Ok(Self::default());
        }
        serde_json::from_str(&read(&path)?).map_err(at(&path))
    }

    /// Writes the file.
    pub(super) fn save(&self, root: &Path) -> Result<(), String> {
        let path = root.join(FOLDER).join("results.json");
        let text = serde_json::to_string_pretty(self).map_err(|error| error.to_string())?;
        std::fs::write(&path, text + "\n").map_err(at(&path))
    }
}

/// Hash of the sources, of their mutants and of the version of Coq.
pub(super) fn hash(root: &Path) -> Result<String, String> {
    let mut texts = Vec::new();
    for name in SOURCES {
        texts.push(read(&source(root, name))?);
    }
    texts.push(read(&root.join(FOLDER).join("mutants.toml"))?);
    texts.push(read(&root.join("proofs/coq-version"))?);
    Ok(sources::hash_of(&texts))
}
