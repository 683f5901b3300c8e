//! Agreement of manifest, mutants, sources and the README's table. Every disagreement is a sentence.

use std::collections::BTreeSet;
use std::path::Path;

use gantry_tau_proofs::harness::{HARNESSES, Harness};

use crate::manifest::Manifest;
use crate::{files, mutate, read, report};

/// Every harness of the source.
fn declared() -> impl Iterator<Item = &'static Harness> {
    HARNESSES.iter().copied().flatten()
}

/// Harness of the source with this name.
pub(crate) fn harness(name: &str) -> Option<&'static Harness> {
    declared().find(|harness| harness.name == name)
}

/// Everything that disagrees.
pub(crate) fn check(root: &Path, manifest: &Manifest) -> Result<Vec<String>, String> {
    let mut wrong = rows_make_sense(manifest);
    wrong.extend(harnesses_agree(manifest));
    wrong.extend(mutants_apply(root, manifest));
    wrong.extend(families_are_tried(root, manifest)?);
    for folder in ["core/src", "proofs/src"] {
        for path in files(&root.join(folder))? {
            wrong.extend(uncovered(&path.display().to_string(), &read(&path)?));
        }
    }
    let readme = read(&root.join("proofs/README.md"))?;
    if report::with_table(&readme, manifest)? != readme {
        wrong.push("proofs/README.md: the table of harnesses is stale; run `table`".to_owned());
    }
    Ok(wrong)
}

/// Names are unique, times fit their tiers, theorems exist and have harnesses.
fn rows_make_sense(manifest: &Manifest) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut seen = BTreeSet::new();
    let rows = manifest.harnesses.iter().map(|row| (&row.name, row.tier, row.measured_s));
    let mutants = manifest.mutants.iter().map(|mutant| (&mutant.name, mutant.tier, mutant.measured_s));
    for (name, tier, measured_s) in rows.chain(mutants) {
        if !seen.insert(name) {
            wrong.push(format!("{name}: stands twice in the manifest"));
        }
        if measured_s > Some(tier.seconds()) {
            wrong.push(format!("{name}: slower than its tier"));
        }
    }
    let mut unproved: BTreeSet<&String> = manifest.theorems.iter().map(|row| &row.name).collect();
    let theorems = unproved.clone();
    for row in &manifest.harnesses {
        if row.theorems.is_empty() {
            wrong.push(format!("{}: proves no theorem", row.name));
        }
        for theorem in &row.theorems {
            unproved.remove(theorem);
            if !theorems.contains(theorem) {
                wrong.push(format!("{}: {theorem} is not a theorem of the manifest", row.name));
            }
        }
    }
    wrong.extend(unproved.iter().map(|name| format!("{name}: no harness proves a part of it")));
    wrong
}

/// Manifest and source name the same harnesses.
fn harnesses_agree(manifest: &Manifest) -> Vec<String> {
    let mut wrong = Vec::new();
    for row in &manifest.harnesses {
        let name = &row.name;
        match harness(name) {
            None => wrong.push(format!("{name}: in the manifest, not in the source")),
            Some(harness) if !harness.stubs.is_empty() && row.assumes.is_empty() => {
                wrong.push(format!("{name}: has stubs, and the manifest does not say what it assumes"));
            }
            Some(_) => {}
        }
    }
    let missing = declared().filter(|harness| manifest.row(harness.name).is_none());
    wrong.extend(missing.map(|harness| format!("{}: in the source, not in the manifest", harness.name)));
    wrong
}

/// Each mutant changes one place of core, and names a harness and a check.
fn mutants_apply(root: &Path, manifest: &Manifest) -> Vec<String> {
    let mut wrong = Vec::new();
    for mutant in &manifest.mutants {
        let name = &mutant.name;
        if manifest.row(&mutant.harness).is_none() {
            wrong.push(format!("{name}: its harness {} is not in the manifest", mutant.harness));
        }
        if mutant.fails.is_empty() {
            wrong.push(format!("{name}: names no check that must fail"));
        }
        if mutant.old == mutant.new || !mutant.file.starts_with("core/src/") {
            wrong.push(format!("{name}: changes nothing in core/src"));
        }
        wrong.extend(mutate::fits(root, mutant).err());
    }
    wrong
}

/// Each file of the harnesses is compiled, and a mutant tries one of its harnesses.
fn families_are_tried(root: &Path, manifest: &Manifest) -> Result<Vec<String>, String> {
    let tried = |name: &str| manifest.mutants.iter().any(|mutant| mutant.harness == name);
    let mut wrong = Vec::new();
    for path in files(&root.join("proofs/src/harness"))? {
        let family = path.file_stem().unwrap_or_default().to_string_lossy();
        let mut harnesses = declared().filter(|harness| harness.family() == family);
        if family != "mod" && !harnesses.any(|harness| tried(harness.name)) {
            wrong.push(format!("family {family}: no mutant tries any of its harnesses"));
        }
    }
    Ok(wrong)
}

/// Assumptions that no cover follows at once. (In a harness `assume!` brings its own.)
fn uncovered(path: &str, text: &str) -> Vec<String> {
    let (mut line, mut wrong) = (1_usize, Vec::new());
    for (index, part) in text.split("kani::assume(").enumerate() {
        let next = part.split_once(';').map_or("", |(_, next)| next.trim_start());
        if index > 0 && !next.starts_with("kani::cover!(") {
            wrong.push(format!("{path}:{line}: no kani::cover! after this kani::assume"));
        }
        line = line.saturating_add(part.matches('\n').count());
    }
    wrong
}
