//! Runs Coq: compiles the sources, asks what every theorem rests on, lets the second checker read
//! everything again, and weakens axioms one at a time.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Instant;

use serde::Deserialize;

use super::axioms::{self, Axiom};
use super::record::{self, Record};
use super::{FOLDER, SOURCES, source};
use crate::manifest::Tier;
use crate::{Failure, at, exit, read};

/// An axiom, weakened.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Mutant {
    pub(super) name: String,
    /// Text that stands exactly once in `Rows.v`, and its replacement.
    pub(super) old: String,
    new: String,
    /// Lemma or theorem whose proof must fail.
    falls: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Mutants {
    mutant: Vec<Mutant>,
}

/// Lets Coq check the composition, and compares what it rests on with the record.
pub(crate) fn check(root: &Path) -> Result<(), Failure> {
    let theorems = theorems(root, &root.join("target/composition"))?;
    if Record::load(root)?.theorems != theorems {
        let message = format!(
            "{FOLDER}/results.json: the theorems rest on other axioms; run `prove composition`"
        );
        return Err(Failure(exit::FILES_DISAGREE, message));
    }
    Ok(())
}

/// Lets Coq check the composition; in the full tier the second checker as well, and the mutants.
pub(crate) fn prove(root: &Path, tier: Tier) -> Result<(), Failure> {
    let build = root.join("target/composition");
    let mut record = Record {
        coq: version()?,
        sources: record::hash(root)?,
        theorems: theorems(root, &build)?,
        mutants: BTreeMap::new(),
    };
    let before = Record::load(root)?;
    if before.sources == record.sources {
        record.mutants = before.mutants;
    }
    if tier == Tier::Full {
        second_checker(&build)?;
        record.mutants = mutants(root, &build)?;
    }
    record.save(root)?;
    Ok(())
}

/// Compiles the sources. Returns the axioms that each theorem rests on.
fn theorems(root: &Path, build: &Path) -> Result<BTreeMap<String, Vec<String>>, Failure> {
    let (version, pinned) = (version()?, read(&root.join("proofs/coq-version"))?);
    println!("Coq {version}; proofs/coq-version pins {}", pinned.trim());
    std::fs::create_dir_all(build).map_err(at(build))?;
    let mut printed = String::new();
    for name in SOURCES {
        copy(root, build, name)?;
        let begun = Instant::now();
        printed = compiled(build, name)?;
        println!("{name}.v: {:.1} s", begun.elapsed().as_secs_f64());
    }
    let axioms = axioms::axioms(&read(&source(root, "Rows"))?);
    let asked = read(&source(root, "Assumptions"))?;
    let theorems = assumptions(&asked, &printed, &axioms)?;
    println!(
        "{} theorems rest on {} axioms",
        theorems.len(),
        axioms.len()
    );
    Ok(theorems)
}

/// Version of Coq.
fn version() -> Result<String, Failure> {
    let missing = |_| {
        let message = "coqc not found; nothing was proved. Debian has it as coq: apt-get install --no-install-recommends coq";
        Failure(exit::KANI_MISSING, message.to_owned())
    };
    let output = Command::new("coqc")
        .arg("--print-version")
        .output()
        .map_err(missing)?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    Ok(text
        .split_whitespace()
        .next()
        .unwrap_or_default()
        .to_owned())
}

fn copy(root: &Path, build: &Path, name: &str) -> Result<(), String> {
    let to = build.join(format!("{name}.v"));
    std::fs::copy(source(root, name), &to).map_err(at(&to))?;
    Ok(())
}

fn coqc(build: &Path, name: &str) -> Result<Output, String> {
    Command::new("coqc")
        .args(["-q", "-w", "+all-deprecated", "-R", ".", "Composition"])
        .arg(format!("{name}.v"))
        .current_dir(build)
        .output()
        .map_err(|error| format!("coqc: {error}"))
}

/// Compiles a source. Returns what it prints.
fn compiled(build: &Path, name: &str) -> Result<String, String> {
    let output = coqc(build, name)?;
    if !output.status.success() {
        let error = String::from_utf8_lossy(&output.stderr);
        return Err(format!("{FOLDER}/{name}.v: {}", error.trim()));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Axioms that each theorem rests on, of what `Print Assumptions` prints. Anything but a row, an
/// invariant of a type and a statement read from the source is an error.
fn assumptions(
    asked: &str,
    printed: &str,
    axioms: &[Axiom],
) -> Result<BTreeMap<String, Vec<String>>, String> {
    let names: Vec<&str> = asked
        .lines()
        .filter_map(|line| line.strip_prefix("Print Assumptions ")?.strip_suffix('.'))
        .collect();
    let answers: Vec<&str> = printed.split("Axioms:").skip(1).collect();
    if names.len() != answers.len() {
        return Err(format!(
            "{FOLDER}/Assumptions.v asks for {} theorems, and {} rest on axioms",
            names.len(),
            answers.len()
        ));
    }
    let mut theorems = BTreeMap::new();
    for (theorem, answer) in names.into_iter().zip(answers) {
        let mut rests_on = Vec::new();
        let lines = answer
            .lines()
            .filter(|line| !line.trim().is_empty() && !line.starts_with(' '));
        for line in lines {
            let word = line.split([' ', ':']).next().unwrap_or_default();
            let Some(name) = word.strip_prefix("R.") else {
                return Err(format!("{theorem} rests on {word}, which is no row"));
            };
            // Others are the functions and types that rows are about.
            if axioms.iter().any(|axiom| axiom.name == name) {
                rests_on.push(name.to_owned());
            }
        }
        rests_on.sort();
        theorems.insert(theorem.to_owned(), rests_on);
    }
    Ok(theorems)
}

/// The second checker reads everything again, the standard library too.
fn second_checker(build: &Path) -> Result<(), String> {
    let begun = Instant::now();
    let output = Command::new("coqchk")
        .args([
            "-silent",
            "-R",
            ".",
            "Composition",
            "Composition.Runs",
            "Composition.Covers",
        ])
        .current_dir(build)
        .output()
        .map_err(|error| format!("coqchk: {error}"))?;
    if !output.status.success() {
        return Err(format!(
            "coqchk: {}",
            String::from_utf8_lossy(&output.stderr).trim()
        ));
    }
    println!("coqchk: {:.1} s", begun.elapsed().as_secs_f64());
    Ok(())
}

/// Mutants of a repository.
pub(super) fn mutants_of(root: &Path) -> Result<Vec<Mutant>, String> {
    let path = root.join(FOLDER).join("mutants.toml");
    let Mutants { mutant } = toml::from_str(&read(&path)?).map_err(at(&path))?;
    Ok(mutant)
}

/// Weakens axioms, one at a time. Returns the lemma that each makes fail.
fn mutants(root: &Path, build: &Path) -> Result<BTreeMap<String, String>, String> {
    let (rows, runs) = (read(&source(root, "Rows"))?, read(&source(root, "Runs"))?);
    let folder: PathBuf = build.join("mutant");
    std::fs::create_dir_all(&folder).map_err(at(&folder))?;
    copy(root, &folder, "Runs")?;
    let mut fell = BTreeMap::new();
    let mut wrong = Vec::new();
    let mutants = mutants_of(root)?;
    let of = mutants.len();
    for (number, mutant) in (1..).zip(mutants) {
        let Mutant {
            name,
            old,
            new,
            falls,
        } = mutant;
        let to = folder.join("Rows.v");
        std::fs::write(&to, rows.replacen(&old, &new, 1)).map_err(at(&to))?;
        compiled(&folder, "Rows").map_err(|error| format!("{name}: {error}"))?;
        let output = coqc(&folder, "Runs")?;
        let lemma = if output.status.success() {
            None
        } else {
            failed_lemma(&runs, &String::from_utf8_lossy(&output.stderr))
        };
        println!(
            "[{number}/{of}] {name} ... {}",
            lemma.as_deref().unwrap_or("nothing falls")
        );
        match lemma {
            Some(lemma) if lemma == falls => {
                fell.insert(name, lemma);
            }
            found => wrong.push(format!(
                "{name}: {} falls, not {falls}",
                found.as_deref().unwrap_or("nothing")
            )),
        }
    }
    if wrong.is_empty() {
        Ok(fell)
    } else {
        Err(wrong.join("\n  "))
    }
}

/// Lemma in which an error of Coq is: the last that begins before its line.
fn failed_lemma(text: &str, error: &str) -> Option<String> {
    let (_, rest) = error.split_once("line ")?;
    let line: usize = rest.split(',').next()?.parse().ok()?;
    let before = text.lines().take(line);
    let names = before.filter_map(|line| {
        let rest = line
            .strip_prefix("Lemma ")
            .or_else(|| line.strip_prefix("Theorem "))?;
        rest.split([' ', ':']).next()
    });
    names.last().map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_of_the_lemma_it_is_in() {
        let text = "Lemma one : a.\nProof.\nQed.\nTheorem two : b.\nProof.\nQed.\n";
        let error =
            |line: u32| format!("File \"./Runs.v\", line {line}, characters 0-1:\nError: no.");
        assert_eq!(failed_lemma(text, &error(2)).as_deref(), Some("one"));
        assert_eq!(failed_lemma(text, &error(5)).as_deref(), Some("two"));
        assert_eq!(failed_lemma(text, "no line").as_deref(), None);
    }

    #[test]
    fn only_rows_may_be_assumed() {
        let axioms = axioms::axioms("Axiom row : True.\n");
        let asked = "Print Assumptions one.\n";
        let printed = "Axioms:\nR.f : nat ->\n  nat\nR.row : True\n";
        let found = assumptions(asked, printed, &axioms).unwrap();
        assert_eq!(found["one"], ["row"]);
        let other = "Axioms:\nclassic : forall P, P\n";
        assert!(assumptions(asked, other, &axioms).is_err());
        assert!(assumptions(asked, "Closed under the global context\n", &axioms).is_err());
    }
}
