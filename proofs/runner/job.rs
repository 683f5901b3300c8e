//! What to give to Kani: a harness, with or without a mutant, and what must come of it.

use std::collections::BTreeMap;

use crate::manifest::{Harness, Manifest, Mutant, Tier};
use crate::source::Family;

/// One run of Kani.
#[derive(Clone, Copy)]
pub(crate) struct Job<'a> {
    pub(crate) harness: &'a Harness,
    /// The module the harness stands in.
    pub(crate) family: &'a str,
    /// The fault in core, if this is a control.
    pub(crate) mutant: Option<&'a Mutant>,
}

impl Job<'_> {
    pub(crate) fn name(&self) -> &str {
        self.mutant
            .map_or(&self.harness.name, |mutant| &mutant.name)
    }

    pub(crate) fn tier(&self) -> Tier {
        self.mutant.map_or(self.harness.tier, |mutant| mutant.tier)
    }

    /// The harness's full name, as Kani knows it.
    pub(crate) fn path(&self) -> String {
        format!("harness::{}::{}", self.family, self.harness.name)
    }
}

/// The jobs of a tier, or the named ones; an unknown name is an error.
pub(crate) fn choose<'a>(
    manifest: &'a Manifest,
    families: &'a [Family],
    tier: Tier,
    names: &[String],
) -> Result<Vec<Job<'a>>, String> {
    let all = all(manifest, families);
    if names.is_empty() {
        return Ok(all.into_iter().filter(|job| job.tier() <= tier).collect());
    }
    let unknown = names
        .iter()
        .find(|name| all.iter().all(|job| job.name() != name.as_str()));
    match unknown {
        Some(name) => Err(format!(
            "no harness and no mutant is called {name}; `list` shows them"
        )),
        None => Ok(all
            .into_iter()
            .filter(|job| names.iter().any(|name| job.name() == name))
            .collect()),
    }
}

/// Harnesses first: a proof that fails explains why its mutants do.
fn all<'a>(manifest: &'a Manifest, families: &'a [Family]) -> Vec<Job<'a>> {
    let homes: BTreeMap<&str, &str> = families
        .iter()
        .flat_map(|family| {
            family
                .harnesses
                .iter()
                .map(|harness| (harness.name.as_str(), family.name.as_str()))
        })
        .collect();
    let job = |harness: &'a Harness, mutant| {
        let family = homes.get(harness.name.as_str())?;
        Some(Job {
            harness,
            family,
            mutant,
        })
    };
    let harnesses = manifest
        .harnesses
        .iter()
        .filter_map(|harness| job(harness, None));
    let controls = manifest
        .mutants
        .iter()
        .filter_map(|mutant| job(manifest.harness(&mutant.harness)?, Some(mutant)));
    harnesses.chain(controls).collect()
}
