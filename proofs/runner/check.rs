//! Do manifest, source and README say the same? Every disagreement, as a sentence.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::manifest::{Expected, Manifest};
use crate::source::{self, Family, Row};

/// T1 to T15.
const THEOREMS: std::ops::RangeInclusive<u32> = 1..=15;

/// Everything that disagrees.
pub(crate) fn check(root: &Path, manifest: &Manifest) -> Result<Vec<String>, String> {
    let families = source::families(root)?;
    let mut wrong = Vec::new();
    for family in &families {
        if !source::is_declared(root, &family.name)? {
            let declaration = source::declaration(&family.name).join(" ");
            wrong.push(format!("harness/mod.rs: no `{declaration}`"));
        }
    }
    wrong.extend(names_are_unique(manifest));
    wrong.extend(expectations_make_sense(manifest));
    wrong.extend(harnesses_agree(manifest, &families));
    wrong.extend(mutants_agree(manifest, &families, &source::mutants(root)?));
    wrong.extend(ends_are_reached(&families));
    for place in source::uncovered(root)? {
        wrong.push(format!("{place}: no kani::cover! after this kani::assume"));
    }
    wrong.extend(readme_agrees(manifest, &source::readme(root)?));
    Ok(wrong)
}

/// A name stands for one thing, on the command line too.
fn names_are_unique(manifest: &Manifest) -> Vec<String> {
    let harnesses = manifest.harnesses.iter().map(|harness| &harness.name);
    let names = harnesses.chain(manifest.mutants.iter().map(|mutant| &mutant.name));
    let mut seen = BTreeSet::new();
    names
        .filter(|name| !seen.insert(*name))
        .map(|name| format!("{name} stands twice in the manifest"))
        .collect()
}

fn expectations_make_sense(manifest: &Manifest) -> Vec<String> {
    let mut wrong = Vec::new();
    for harness in &manifest.harnesses {
        if harness.verdict != Expected::Verified {
            wrong.push(format!("{}: a harness must verify", harness.name));
        }
        if harness.measured_s > Some(harness.tier.seconds()) {
            wrong.push(format!("{}: slower than its tier", harness.name));
        }
        if harness.theorems.is_empty() {
            wrong.push(format!("{}: proves no theorem", harness.name));
        }
    }
    for mutant in &manifest.mutants {
        if mutant.verdict != Expected::Fails || mutant.fails.is_empty() {
            wrong.push(format!(
                "{}: a mutant must fail, in a named check",
                mutant.name
            ));
        }
        if mutant.measured_s > Some(mutant.tier.seconds()) {
            wrong.push(format!("{}: slower than its tier", mutant.name));
        }
    }
    wrong
}

/// The same harnesses, with the same solver and bound.
fn harnesses_agree(manifest: &Manifest, families: &[Family]) -> Vec<String> {
    let found = families.iter().flat_map(|family| &family.harnesses);
    let mut found: BTreeMap<&str, _> = found.map(|found| (found.name.as_str(), found)).collect();
    let mut wrong = Vec::new();
    for row in &manifest.harnesses {
        let name = &row.name;
        let Some(source) = found.remove(name.as_str()) else {
            wrong.push(format!("{name}: in the manifest, not in the source"));
            continue;
        };
        if source.solver.as_ref() != Some(&row.solver) {
            wrong.push(format!(
                "{name}: solver {} in the manifest, {:?} in the source",
                row.solver, source.solver
            ));
        }
        if source.unwind != row.unwind {
            wrong.push(format!(
                "{name}: unwind {:?} in the manifest, {:?} in the source",
                row.unwind, source.unwind
            ));
        }
        if source.stubbed && row.assumes.is_empty() {
            wrong.push(format!(
                "{name}: substitutes something, and the manifest does not say what it assumes"
            ));
        }
    }
    wrong.extend(
        found
            .keys()
            .map(|name| format!("{name}: in the source, not in the manifest")),
    );
    wrong
}

/// The same mutants, each with a harness, and one at least for each family.
fn mutants_agree(
    manifest: &Manifest,
    families: &[Family],
    in_core: &BTreeSet<String>,
) -> Vec<String> {
    let listed: BTreeSet<String> = manifest
        .mutants
        .iter()
        .map(|mutant| mutant.name.clone())
        .collect();
    let missing = listed.difference(in_core);
    let mut wrong: Vec<String> = missing
        .map(|name| format!("{name}: a mutant in the manifest, not in core"))
        .collect();
    let unknown = in_core.difference(&listed);
    wrong.extend(unknown.map(|name| format!("{name}: a mutant in core, not in the manifest")));
    for mutant in &manifest.mutants {
        if manifest.harness(&mutant.harness).is_none() {
            wrong.push(format!(
                "{}: its harness {} is not in the manifest",
                mutant.name, mutant.harness
            ));
        }
    }
    for family in families {
        let tried = |name: &String| {
            manifest
                .mutants
                .iter()
                .any(|mutant| mutant.harness == *name)
        };
        if !family.harnesses.iter().any(|harness| tried(&harness.name)) {
            wrong.push(format!(
                "family {}: no mutant tries any of its harnesses",
                family.name
            ));
        }
    }
    wrong
}

/// A cover at the end of every harness.
fn ends_are_reached(families: &[Family]) -> Vec<String> {
    let harnesses = families.iter().flat_map(|family| &family.harnesses);
    let uncovered = harnesses.filter(|harness| !harness.ends_in_cover);
    uncovered
        .map(|harness| format!("{}: its last statement is not a kani::cover!", harness.name))
        .collect()
}

/// Every theorem has one row, which names the harnesses that prove a part of it.
fn readme_agrees(manifest: &Manifest, rows: &[Row]) -> Vec<String> {
    let mut wrong = Vec::new();
    for theorem in THEOREMS.map(|number| format!("T{number}")) {
        let proving = manifest
            .harnesses
            .iter()
            .filter(|harness| harness.theorems.contains(&theorem));
        let expected: BTreeSet<String> = proving.map(|harness| harness.name.clone()).collect();
        let stated: Vec<_> = rows.iter().filter(|row| row.theorem == theorem).collect();
        let [row] = stated.as_slice() else {
            wrong.push(format!("README: {} rows for {theorem}", stated.len()));
            continue;
        };
        let missing = expected.difference(&row.harnesses);
        wrong.extend(missing.map(|name| format!("README, {theorem}: {name} is missing")));
        let extra = row.harnesses.difference(&expected);
        wrong.extend(extra.map(|name| format!("README, {theorem}: no harness {name} proves it")));
    }
    for harness in &manifest.harnesses {
        let unknown = harness
            .theorems
            .iter()
            .filter(|theorem| !is_theorem(theorem));
        wrong.extend(unknown.map(|theorem| format!("{}: {theorem} is no theorem", harness.name)));
    }
    wrong
}

fn is_theorem(name: &str) -> bool {
    THEOREMS
        .into_iter()
        .any(|number| name == format!("T{number}"))
}
