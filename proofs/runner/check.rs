//! Agreement of manifest, mutants, sources and the page of results. Every disagreement is a
//! sentence.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use gantry_tau_proofs::harness::{HARNESSES, Harness};

use crate::manifest::Manifest;
use crate::results::{Results, Standing, Standings};
use crate::sources::{self, Sources};
use crate::{composition, files, flags, mutate, page, read, verdict};

/// Every harness of the source.
fn declared() -> impl Iterator<Item = &'static Harness> {
    HARNESSES.iter().copied().flatten()
}

/// Harness of the source with this name.
pub(crate) fn harness(name: &str) -> Option<&'static Harness> {
    declared().find(|harness| harness.name == name)
}

/// Everything that disagrees.
pub(crate) fn check(
    root: &Path,
    manifest: &Manifest,
    results: &Results,
    sources: &Sources,
    standings: &Standings<'_>,
) -> Result<Vec<String>, String> {
    let mut wrong = rows_make_sense(manifest);
    wrong.extend(sources.left_out());
    wrong.extend(harnesses_agree(manifest));
    wrong.extend(axes_agree(root, manifest)?);
    wrong.extend(mutants_apply(root, manifest));
    wrong.extend(families_are_tried(root, manifest)?);
    for folder in mutate::SOURCES {
        for path in files(&root.join(folder))? {
            let text = read(&path)?;
            let path = path.display().to_string();
            wrong.extend(uncovered(&path, &text));
            wrong.extend(speechless(&path, &text));
        }
    }
    wrong.extend(sources::strays(root)?);
    wrong.extend(flags::in_manifests(root)?);
    wrong.extend(flags::build_scripts(root)?);
    wrong.extend(composition::disagreements(root, manifest)?);
    let unknown = results.unknown(manifest);
    wrong.extend(
        unknown
            .iter()
            .map(|name| format!("proofs/results.json: {name} is not in the manifest; run `table`")),
    );
    let page = page::load(root)?;
    let cells = page::cells(standings);
    if page::text(manifest, &page::shown(&page, manifest, results, cells)) != page {
        wrong.push(format!(
            "{}: differs from manifest, mutants and results; run `table`",
            page::PATH
        ));
    }
    Ok(wrong)
}

/// Everything that has no result on this source: rows by their names, and texts that claim more.
pub(crate) fn unproved(
    root: &Path,
    manifest: &Manifest,
    standings: &Standings<'_>,
) -> Result<Vec<String>, String> {
    let mut said: Vec<String> = standings
        .iter()
        .filter_map(|(job, standing)| standing.complaint(job.name()))
        .collect();
    if page::text(manifest, &page::cells(standings)) != page::load(root)? {
        said.push(format!(
            "{}: shows results of other sources; run `table`",
            page::PATH
        ));
    }
    let open = standings.iter().filter(|(job, standing)| {
        job.mutant.is_none() && !matches!(standing, Standing::Current(_))
    });
    let (sentences, of_runs) = composition::open(root, standings)?;
    said.extend(sentences);
    let open: BTreeSet<&str> = open
        .flat_map(|(job, _)| job.row.theorems.iter())
        .chain(&of_runs)
        .map(String::as_str)
        .collect();
    let mut pages = if root.join("docs").is_dir() {
        files(&root.join("docs"))?
    } else {
        Vec::new()
    };
    pages.extend(
        ["README.md", "proofs/README.md", "proofs/theorems.md"].map(|page| root.join(page)),
    );
    pages.retain(|path| path.is_file() && path.extension().is_some_and(|end| end == "md"));
    for path in pages {
        let name = path
            .strip_prefix(root)
            .unwrap_or(&path)
            .display()
            .to_string();
        said.extend(claims(&name, &read(&path)?, &open));
    }
    Ok(said)
}

/// Checks of verified harnesses that no caught mutant makes fail: a proof of them may be of
/// nothing.
pub(crate) fn untried(standings: &Standings<'_>) -> Vec<String> {
    let mut fell = BTreeSet::new();
    let mut stated = BTreeSet::new();
    for (job, standing) in standings {
        let Standing::Current(entry) = standing else {
            continue;
        };
        match job.mutant {
            Some(_) => fell.extend(entry.fell.iter().cloned()),
            None => stated.extend(
                entry
                    .states
                    .iter()
                    .map(|text| (text.clone(), job.name().to_owned())),
            ),
        }
    }
    // One of several harnesses with this check is enough.
    let mut open = stated
        .into_iter()
        .filter(|(text, _)| !fell.contains(text))
        .collect::<Vec<_>>();
    open.dedup_by(|next, one| next.0 == one.0);
    open.into_iter()
        .map(|(text, name)| format!("UNTRIED: \"{text}\" of {name}: no mutant makes it fail"))
        .collect()
}

/// Shares of the results by versions of Kani other than the pinned one.
pub(crate) fn other_versions(standings: &Standings<'_>, pinned: &str) -> Vec<String> {
    let mut by_version = BTreeMap::<&str, usize>::new();
    for (_, standing) in standings {
        if let Standing::Current(entry) = standing {
            let share = by_version.entry(&entry.kani).or_default();
            *share = share.saturating_add(1);
        }
    }
    let all: usize = by_version.values().sum();
    (by_version.into_iter())
        .filter(|(version, _)| *version != pinned)
        .map(|(version, share)| {
            format!(
                "VERSION: {share} of {all} results on this source are by Kani {version}; proofs/kani-version pins {pinned}"
            )
        })
        .collect()
}

/// Rows of tables, items of lists and paragraphs that say "proved" of a theorem without results.
fn claims(path: &str, page: &str, open: &BTreeSet<&str>) -> Vec<String> {
    let mut said = Vec::new();
    for (number, text) in statements(page) {
        let claims = text
            .to_lowercase()
            .replace("not proved", "")
            .contains("proved");
        let named: Vec<&str> = named(&text)
            .into_iter()
            .filter_map(|name| open.get(name.as_str()).copied())
            .collect();
        if claims && !named.is_empty() {
            let named = named.join(", ");
            said.push(format!(
                "{path}:{number}: says \"proved\" of {named}, which has rows without a result on this source"
            ));
        }
    }
    said
}

/// Rows of tables, items of lists and paragraphs of a page, each with the number of its first line.
fn statements(page: &str) -> Vec<(usize, String)> {
    let mut statements: Vec<(usize, String)> = Vec::new();
    let mut goes_on = false;
    for (number, line) in (1..).zip(page.lines().map(str::trim)) {
        let begins = ["|", "- ", "* ", "#"]
            .iter()
            .any(|start| line.starts_with(start));
        match statements.last_mut() {
            Some((_, text)) if goes_on && !begins => text.extend([" ", line]),
            _ => statements.push((number, line.to_owned())),
        }
        goes_on = !(line.is_empty() || line.starts_with(['|', '#']));
    }
    statements
}

/// Theorems that a text names: `T4, T5`, or `T13 to T15`.
fn named(text: &str) -> BTreeSet<String> {
    let words: Vec<&str> = text
        .split(|letter: char| !letter.is_alphanumeric())
        .filter(|word| !word.is_empty())
        .collect();
    let mut found: BTreeSet<u32> = words
        .iter()
        .filter_map(|word| theorem_number(word))
        .collect();
    for part in words.windows(3) {
        let [first, "to", last] = part else { continue };
        if let (Some(first), Some(last)) = (theorem_number(first), theorem_number(last)) {
            found.extend(first..=last);
        }
    }
    found
        .into_iter()
        .map(|number| format!("T{number}"))
        .collect()
}

fn theorem_number(word: &str) -> Option<u32> {
    word.strip_prefix('T')?.parse().ok()
}

/// Names are unique, theorems exist and have harnesses.
fn rows_make_sense(manifest: &Manifest) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut seen = BTreeSet::new();
    let mutants = manifest.mutants.iter().map(|mutant| &mutant.name);
    for name in manifest
        .harnesses
        .iter()
        .map(|row| &row.name)
        .chain(mutants)
    {
        if !seen.insert(name) {
            wrong.push(format!("{name}: occurs twice in the manifest"));
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
                wrong.push(format!(
                    "{}: {theorem} is not a theorem of the manifest",
                    row.name
                ));
            }
        }
    }
    wrong.extend(
        unproved
            .iter()
            .map(|name| format!("{name}: no harness proves a part of it")),
    );
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
                wrong.push(format!(
                    "{name}: has stubs, and the manifest does not say what it assumes"
                ));
            }
            Some(_) => {}
        }
    }
    let missing = declared().filter(|harness| manifest.row(harness.name).is_none());
    wrong.extend(
        missing.map(|harness| format!("{}: in the source, not in the manifest", harness.name)),
    );
    wrong
}

/// A domain that begins with a number of axes says that of its harness.
fn axes_agree(root: &Path, manifest: &Manifest) -> Result<Vec<String>, String> {
    let mut wrong = Vec::new();
    for row in &manifest.harnesses {
        let Some((said, harness)) = axes_said(&row.domain).zip(harness(&row.name)) else {
            continue;
        };
        let family = harness.family();
        let text = read(&root.join(format!("proofs/src/harness/{family}.rs")))?;
        let found = axes_of(&text, harness);
        if found != BTreeSet::from([said]) {
            let found: Vec<String> = found.iter().map(ToString::to_string).collect();
            wrong.push(format!(
                "{}: its domain begins with \"{}\", its harness has {}",
                row.name,
                row.domain.split(':').next().unwrap_or_default(),
                found.join(" and ")
            ));
        }
    }
    Ok(wrong)
}

/// Number of axes that a domain begins with.
pub(crate) fn axes_said(domain: &str) -> Option<u32> {
    [("one axis", 1), ("three axes", 3), ("six axes", 6)]
        .into_iter()
        .find_map(|(words, number)| domain.starts_with(words).then_some(number))
}

/// Numbers of axes that a harness names (`<3>`); if it names none that of its file (`AXES`), or one.
fn axes_of(text: &str, harness: &Harness) -> BTreeSet<u32> {
    let begin = |name: &str| text.find(&format!("\n    {name} ["));
    let Some(first) = begin(harness.name) else {
        return BTreeSet::new();
    };
    let others = declared().filter_map(|other| begin(other.name));
    let end = others.filter(|other| *other > first).min();
    let own = text
        .get(first..end.unwrap_or(text.len()))
        .unwrap_or_default();
    let named: BTreeSet<u32> = (own.split('<').skip(1))
        .filter_map(|part| part.split_once('>')?.0.parse().ok())
        .collect();
    if !named.is_empty() {
        return named;
    }
    let constant = text.split_once("const AXES: usize = ");
    let number = constant.and_then(|(_, rest)| rest.split_once(';')?.0.parse().ok());
    BTreeSet::from([number.unwrap_or(1)])
}

/// Each mutant changes one place of what is proved, and names a harness and a check.
fn mutants_apply(root: &Path, manifest: &Manifest) -> Vec<String> {
    let mut wrong = Vec::new();
    for mutant in &manifest.mutants {
        let name = &mutant.name;
        if manifest.row(&mutant.harness).is_none() {
            wrong.push(format!(
                "{name}: its harness {} is not in the manifest",
                mutant.harness
            ));
        }
        if mutant.fails.is_empty() {
            wrong.push(format!("{name}: names no check that must fail"));
        }
        if mutant.old == mutant.new
            || !mutate::FOLDERS
                .iter()
                .any(|folder| mutant.file.starts_with(folder))
        {
            wrong.push(format!(
                "{name}: changes nothing in {}",
                mutate::FOLDERS.join(" or ")
            ));
        }
        wrong.extend(mutate::fits(root, mutant).err());
    }
    wrong
}

/// Each file of the harnesses is compiled, and a mutant tries one of its harnesses.
fn families_are_tried(root: &Path, manifest: &Manifest) -> Result<Vec<String>, String> {
    let tried: BTreeSet<&str> = manifest
        .mutants
        .iter()
        .map(|mutant| mutant.harness.as_str())
        .collect();
    let mut wrong = Vec::new();
    for path in files(&root.join("proofs/src/harness"))? {
        let family = path.file_stem().unwrap_or_default().to_string_lossy();
        let mut harnesses = declared().filter(|harness| harness.family() == family);
        if family != "mod" && !harnesses.any(|harness| tried.contains(harness.name)) {
            wrong.push(format!(
                "family {family}: no mutant tries any of its harnesses"
            ));
        }
    }
    Ok(wrong)
}

/// Assumptions that no cover follows at once. (In a harness `assume!` brings its own.)
fn uncovered(path: &str, text: &str) -> Vec<String> {
    let mut line = 1_usize;
    let mut wrong = Vec::new();
    for (index, part) in text.split("kani::assume(").enumerate() {
        let next = part
            .split_once(';')
            .map_or("", |(_, next)| next.trim_start());
        if index > 0 && !next.starts_with("kani::cover!(") {
            wrong.push(format!(
                "{path}:{line}: no kani::cover! after this kani::assume"
            ));
        }
        line = line.saturating_add(part.matches('\n').count());
    }
    wrong
}

/// Covers whose text does not say what they cover. (In a harness `assume!` brings its own.)
fn speechless(path: &str, text: &str) -> Vec<String> {
    let mut wrong = Vec::new();
    for start in ["cover!(", "assume!("] {
        let mut line = 1_usize;
        for (index, part) in text.split(start).enumerate() {
            let call = part.split_once(");").map_or(part, |(call, _)| call);
            let said = call
                .trim_end()
                .strip_suffix('"')
                .and_then(|call| call.rsplit('"').next());
            // The macros' own covers take their text from the caller.
            if index > 0 && !call.contains('$') && !said.is_some_and(verdict::says_what) {
                wrong.push(format!(
                    "{path}:{line}: a cover does not say what it covers"
                ));
            }
            line = line.saturating_add(part.matches('\n').count());
        }
    }
    wrong
}
