//! Copy of core, C interface, LabComm and proofs in which mutants are applied: the sources
//! themselves are never changed.

use std::fs;
use std::ops::Range;
use std::path::Path;
use std::process::Command;

use crate::manifest::Mutant;
use crate::{at, files, read};

/// Folders of the sources that mutants change: what is proved, and the definitions that it is compared
/// with.
pub(crate) const FOLDERS: [&str; 4] = [
    "core/src/",
    "host/capi/src/",
    "host/labcomm/src/",
    "proofs/src/properties/",
];
/// Folders of all sources that a proof rests on.
pub(crate) const SOURCES: [&str; 4] = [
    "core/src/",
    "host/capi/src/",
    "host/labcomm/src/",
    "proofs/src/",
];

/// Brings a workspace of core, C interface, LabComm and proofs alone up to date, without mutants.
/// Files that are equal are left alone, so that Cargo builds only what a mutant changes.
pub(crate) fn copy(root: &Path, folder: &Path) -> Result<(), String> {
    for part in ["core", "proofs", "host/capi/src", "host/labcomm"] {
        mirror(&root.join(part), &folder.join(part))?;
    }
    write(&folder.join("Cargo.toml"), workspace(root)?.as_bytes())?;
    // Cargo leaves out of the copy's lock what the other members need.
    write(
        &folder.join("Cargo.lock"),
        read(&root.join("Cargo.lock"))?.as_bytes(),
    )
}

/// Applies a mutant to a copy, beside those applied before, which may have put in its old text once
/// more.
pub(crate) fn apply(copy: &Path, mutant: &Mutant) -> Result<(), String> {
    let path = copy.join(&mutant.file);
    write(&path, with_fault(&read(&path)?, mutant)?.as_bytes())
}

/// Checks that the mutant's old text stands exactly once in its file.
pub(crate) fn fits(root: &Path, mutant: &Mutant) -> Result<(), String> {
    with_fault(&read(&root.join(&mutant.file))?, mutant).map(drop)
}

/// Text of the mutant's file with its fault. The old text must stand in it exactly once; line
/// breaks do not count.
pub(crate) fn with_fault(text: &str, mutant: &Mutant) -> Result<String, String> {
    let Mutant {
        name,
        file,
        old,
        new,
        ..
    } = mutant;
    let places = places(text, old);
    match places.as_slice() {
        [place] => {
            let (before, after) = (text.get(..place.start), text.get(place.end..));
            Ok([before.unwrap_or_default(), new, after.unwrap_or_default()].concat())
        }
        _ => Err(format!(
            "{name}: `{old}` occurs {} times in {file}, expected once",
            places.len()
        )),
    }
}

/// Places of a part in a text, in bytes. Where it is not found as it is, a formatter may have moved
/// its line breaks: white space then counts only around the part and between two words, and a comma
/// before a closing bracket not at all.
fn places(text: &str, part: &str) -> Vec<Range<usize>> {
    let found: Vec<_> = text
        .match_indices(part)
        .map(|(start, found)| start..start.saturating_add(found.len()))
        .collect();
    if !found.is_empty() {
        return found;
    }
    let (letters, sought) = (without_breaks(text), without_breaks(part));
    let found = letters.windows(sought.len().max(1)).filter(|window| {
        window
            .iter()
            .map(|(_, letter)| letter)
            .eq(sought.iter().map(|(_, letter)| letter))
    });
    let found = found.filter_map(|window| {
        let (start, (last, letter)) = (window.first()?.0, *window.last()?);
        Some(start..last.saturating_add(letter.len_utf8()))
    });
    // White space at the ends of the part is there, or a line break.
    let found = found.filter(|place| {
        let (before, after) = (text.get(..place.start), text.get(place.end..));
        (!part.starts_with(char::is_whitespace)
            || before.is_some_and(|text| text.ends_with(char::is_whitespace)))
            && (!part.ends_with(char::is_whitespace)
                || after.is_some_and(|text| text.starts_with(char::is_whitespace)))
    });
    found.collect()
}

/// Characters that do not depend on line breaks, with their places.
fn without_breaks(text: &str) -> Vec<(usize, char)> {
    let mut kept: Vec<(usize, char)> = Vec::new();
    let mut space = None;
    for (place, character) in text.char_indices() {
        if character.is_whitespace() {
            space = space.or(Some(place));
            continue;
        }
        match (kept.last(), space.take()) {
            (Some((_, ',')), _) if ")]}".contains(character) => drop(kept.pop()),
            (Some((_, last)), Some(space)) if is_of_a_word(*last) && is_of_a_word(character) => {
                kept.push((space, ' '))
            }
            _ => {}
        }
        kept.push((place, character));
    }
    kept
}

fn is_of_a_word(character: char) -> bool {
    character.is_alphanumeric() || character == '_'
}

/// Compiles core with every mutant: all at once in one copy, in several rounds where two change the
/// same text.
pub(crate) fn compile(root: &Path, mutants: &[Mutant]) -> Result<(), String> {
    let folder = root.join("target/mutants/copy");
    let mut left: Vec<&Mutant> = mutants.iter().collect();
    while let Some(first) = left.first() {
        copy(root, &folder)?;
        apply(&folder, first)?;
        left.remove(0);
        left.retain(|mutant| apply(&folder, mutant).is_err());
        let mut cargo = Command::new(crate::kani::cargo());
        cargo
            .args([
                "check",
                "--quiet",
                "-p",
                "gantry-tau-core",
                "-p",
                "gantry-tau-proofs-capi",
                "-p",
                "gantry-tau-labcomm",
                "--target-dir",
            ])
            .arg(root.join("target/mutants"))
            .current_dir(&folder)
            // The fault may leave something unused.
            .env("RUSTFLAGS", "--cap-lints=warn");
        let output = cargo.output().map_err(|error| format!("cargo: {error}"))?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            return Err(format!("mutants do not compile:\n{said}"));
        }
    }
    Ok(())
}

/// Manifest of the workspace with core and proofs, and what they name, as its only members.
fn workspace(root: &Path) -> Result<String, String> {
    let path = root.join("Cargo.toml");
    let mut manifest: toml::Table = toml::from_str(&read(&path)?).map_err(at(&path))?;
    let workspace = manifest
        .get_mut("workspace")
        .and_then(toml::Value::as_table_mut)
        .ok_or("Cargo.toml: no [workspace]")?;
    workspace.remove("default-members");
    workspace.remove("exclude");
    let members = ["core", "proofs"].map(toml::Value::from);
    workspace.insert("members".to_owned(), members.to_vec().into());
    toml::to_string(&manifest).map_err(at(&path))
}

/// Makes a folder's files those of another.
fn mirror(from: &Path, to: &Path) -> Result<(), String> {
    fs::create_dir_all(to).map_err(at(to))?;
    for held in files(to)? {
        let gone = held
            .strip_prefix(to)
            .is_ok_and(|part| !from.join(part).exists());
        if gone {
            fs::remove_file(&held).map_err(at(&held))?;
        }
    }
    for path in files(from)? {
        let part = path.strip_prefix(from).map_err(|error| error.to_string())?;
        write(&to.join(part), &fs::read(&path).map_err(at(&path))?)?;
    }
    Ok(())
}

/// Writes a file unless it holds these bytes already.
fn write(path: &Path, bytes: &[u8]) -> Result<(), String> {
    if fs::read(path).is_ok_and(|held| held == bytes) {
        return Ok(());
    }
    let folder = path.parent().map_or(Ok(()), fs::create_dir_all);
    folder
        .and_then(|()| fs::write(path, bytes))
        .map_err(at(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_breaks_do_not_count() {
        for (text, part, count) in [
            ("let x = f(a, b);", "f(a, b)", 1),
            ("let x = f(\n    a,\n    b,\n);", "f(a, b)", 1),
            ("let x = f(a, b);", "f(\n    a,\n    b,\n)", 1),
            ("x\n    .f()\n    .g() + x.f().g()", "x.f().g()", 1),
            ("x\n    .f() + x\n    .f()", "x.f()", 2),
            ("let mut a = 1;", "letmut a", 0),
            ("(x: now.epoch,\n    accepted)", " epoch,\naccepted", 0),
            ("(x: now,\n    epoch,\n    accepted)", " epoch, accepted", 1),
        ] {
            let found = places(text, part);
            assert_eq!(found.len(), count, "{part} in {text}: {found:?}");
        }
        assert_eq!(
            places("f(\n    a,\n) + 1", "f(a) +").first(),
            Some(&(0..13))
        );
    }
}
