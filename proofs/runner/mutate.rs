//! Copy of core, C interface, LabComm and proofs in which mutants are applied: the sources themselves are never changed.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::manifest::Mutant;
use crate::{at, files, read};

/// Brings a workspace of core, C interface, LabComm and proofs alone up to date, without mutants.
/// Files that are equal are left alone, so that Cargo builds only what a mutant changes.
pub(crate) fn copy(root: &Path, folder: &Path) -> Result<(), String> {
    for part in ["core", "proofs", "host/capi/src", "host/labcomm"] {
        mirror(&root.join(part), &folder.join(part))?;
    }
    write(&folder.join("Cargo.toml"), workspace(root)?.as_bytes())?;
    // Cargo leaves out of the copy's lock what the other members need.
    write(&folder.join("Cargo.lock"), read(&root.join("Cargo.lock"))?.as_bytes())
}

/// Applies a mutant to a copy, beside those applied before, which may have put in its old text once more.
pub(crate) fn apply(copy: &Path, mutant: &Mutant) -> Result<(), String> {
    fits(copy, mutant)?;
    let path = copy.join(&mutant.file);
    let text = read(&path)?.replacen(&mutant.old, &mutant.new, 1);
    write(&path, text.as_bytes())
}

/// Checks that the mutant's old text stands exactly once in its file.
pub(crate) fn fits(root: &Path, mutant: &Mutant) -> Result<(), String> {
    let Mutant { name, file, old, .. } = mutant;
    match read(&root.join(file))?.matches(old.as_str()).count() {
        1 => Ok(()),
        count => Err(format!("{name}: `{old}` occurs {count} times in {file}, expected once")),
    }
}

/// Compiles core with every mutant: all at once in one copy, in several rounds where two change the same text.
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
    let workspace =
        manifest.get_mut("workspace").and_then(toml::Value::as_table_mut).ok_or("Cargo.toml: no [workspace]")?;
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
        let gone = held.strip_prefix(to).is_ok_and(|part| !from.join(part).exists());
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
    folder.and_then(|()| fs::write(path, bytes)).map_err(at(path))
}
