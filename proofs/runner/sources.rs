//! Hashes of the sources that a verdict depends on: a result is of this source as long as they agree.
//!
//! A row depends on
//! - core without the wings that its family does not name: `model`, and `position_loop`;
//! - the file of its family, the properties that file names, and those that they name;
//! - the C interface, and LabComm, where these name it;
//! - of the manifests and of Cargo.lock, the parts that concern core and what it is made of;
//! - the row itself: its theorems and named checks; of a mutant, its fault;
//! - the flags of Kani, and the rules of this program.
//!
//! A wing is the finest part of core that can be told from the text alone. Core compiles without the features `model`
//! and `position-loop` (CI does it), so nothing else depends on these wings. Inside a wing, an `impl` in any file may
//! decide what another one does. Of the properties that could be so too, therefore [`strays`] wants every `impl` in the
//! file of its trait or its type.
//!
//! Comments, blank lines, tests, and the lists of modules do not count.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use gantry_tau_proofs::harness::HARNESSES;
use toml::{Table, Value};

use crate::manifest::{Mutant, Row};
use crate::{at, files, kani, read};

/// Raised when this program judges Kani's output by other rules: earlier results are then of another source.
const RULES: u32 = 1;

/// Part of core behind a feature of its own, without which core compiles: a module, and all below it.
struct Wing {
    feature: &'static str,
    /// True if the feature belongs to the part of the manifest that every row depends on. (If a younger one did, it would have
    /// made all results stale.)
    is_common: bool,
    /// True if a text of a family names it.
    is_named: fn(&str) -> bool,
}

const WINGS: [Wing; 2] = [
    // A path; the word alone may stand in a text.
    Wing { feature: "model", is_common: true, is_named: |text| text.contains("model::") || text.contains("::model") },
    Wing {
        feature: "position-loop",
        is_common: false,
        is_named: |text| words(text).any(|word| word == "position_loop"),
    },
];

/// Hashes of every family's sources.
#[derive(PartialEq, Eq)]
pub(crate) struct Sources(BTreeMap<&'static str, Hash>);

impl Sources {
    /// Reads a repository.
    pub(crate) fn read(root: &Path) -> Result<Self, String> {
        let families = HARNESSES.iter().filter_map(|harnesses| Some(harnesses.first()?.family()));
        let mut cargos = BTreeMap::new();
        let hashes = families.map(|name| Ok((name, family(root, name, &mut cargos)?)));
        Ok(Self(hashes.collect::<Result<_, String>>()?))
    }

    /// Hash of everything that the verdict of a row depends on, or of a mutant of its harness.
    pub(crate) fn hash(&self, family: &str, row: &Row, mutant: Option<&Mutant>) -> String {
        let mut hash = self.0.get(family).copied().unwrap_or(Hash::NONE);
        hash.add(&row.name);
        let own = match mutant {
            None => [&row.theorems, &row.requires, &row.leaves_out].into_iter().flatten().collect(),
            Some(mutant) => vec![&mutant.file, &mutant.old, &mutant.new, &mutant.fails],
        };
        own.into_iter().for_each(|text| hash.add(text));
        format!("{:032x}", hash.0)
    }
}

/// FNV-1a: for accidents, not against attackers.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Hash(u128);

impl Hash {
    const NONE: Self = Self(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d);
    const PRIME: u128 = 0x0100_0000_0000_0000_0000_013b;

    /// Adds a text and its end.
    fn add(&mut self, text: &str) {
        for byte in text.bytes().chain([u8::MAX]) {
            self.0 = (self.0 ^ u128::from(byte)).wrapping_mul(Self::PRIME);
        }
    }
}

/// Hash of one family. `cargos`: hashes of the manifests without some features, once they are known.
fn family(root: &Path, name: &str, cargos: &mut BTreeMap<Vec<&str>, Hash>) -> Result<Hash, String> {
    let proofs = root.join("proofs/src");
    let mut texts = BTreeMap::new();
    let mut names = vec!["lib".to_owned(), "harness/mod".to_owned(), format!("harness/{name}")];
    while let Some(name) = names.pop() {
        for path in module(&proofs, &name)? {
            let name = path.strip_prefix(root).unwrap_or(&path).display().to_string();
            if texts.contains_key(&name) {
                continue;
            }
            let text = significant(&read(&path)?).text;
            names.extend(mentioned(&text));
            texts.insert(name, text);
        }
    }
    if texts.values().any(|text| text.contains("gantry_tau_capi::")) {
        interface(root, &mut texts)?;
    }
    if texts.values().any(|text| text.contains("gantry_tau_labcomm::")) {
        library(&root.join("host/labcomm/src/lib.rs"), &[], &mut texts)?;
    }
    let mut left_out = Vec::from_iter(&WINGS);
    left_out.retain(|wing| !texts.values().any(|text| (wing.is_named)(text)));
    let features: Vec<&str> = left_out.iter().map(|wing| wing.feature).collect();
    library(&root.join("core/src/lib.rs"), &features, &mut texts)?;
    let features: Vec<&str> = left_out.iter().filter(|wing| !wing.is_common).map(|wing| wing.feature).collect();
    let mut hash = match cargos.get(&features) {
        Some(hash) => *hash,
        None => cargo(root, &features)?,
    };
    cargos.insert(features, hash);
    for (name, text) in &texts {
        hash.add(name.trim_start_matches(&root.display().to_string()));
        hash.add(text);
    }
    Ok(hash)
}

/// Adds the sources of the C interface, the manifest that compiles them for the proofs, and what that takes from elsewhere.
fn interface(root: &Path, texts: &mut BTreeMap<String, String>) -> Result<(), String> {
    library(&root.join("host/capi/src/lib.rs"), &[], texts)?;
    let path = root.join("proofs/capi/Cargo.toml");
    let manifest = read(&path)?;
    let needed = needed(&toml::from_str(&manifest).map_err(at(&path))?);
    let path = root.join("Cargo.lock");
    let lock = toml::from_str(&read(&path)?).map_err(at(&path))?;
    texts.insert("proofs/capi".to_owned(), manifest);
    texts.insert("Cargo.lock".to_owned(), Vec::from_iter(locked(&lock, needed)).concat());
    Ok(())
}

/// Files of a module of the proofs; none if the name is not one of a module.
fn module(proofs: &Path, name: &str) -> Result<Vec<std::path::PathBuf>, String> {
    let (file, folder) = (proofs.join(format!("{name}.rs")), proofs.join(name));
    if file.is_file() {
        Ok(vec![file])
    } else if folder.join("mod.rs").is_file() && name != "harness" {
        files(&folder)
    } else {
        Ok(Vec::new())
    }
}

/// Names that follow `crate::` or `super::`, alone or in braces.
fn mentioned(text: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for part in text.split("crate::").skip(1).chain(text.split("super::").skip(1)) {
        let group = part.split(';').next().filter(|group| group.starts_with('{'));
        match group {
            Some(group) => names.extend(words(group).map(str::to_owned)),
            None => names.extend(words(part).next().map(str::to_owned)),
        }
    }
    names
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|letter: char| !letter.is_alphanumeric() && letter != '_').filter(|word| !word.is_empty())
}

/// Adds a file of a library and its modules, as the compiler finds them, but for the modules of the features that are
/// left out.
fn library(file: &Path, left_out: &[&str], texts: &mut BTreeMap<String, String>) -> Result<(), String> {
    let Significant { text, modules } = significant(&read(file)?);
    if let Some(feature) = left_out.iter().find(|feature| text.contains(&format!("feature = \"{feature}\""))) {
        return Err(format!("{}: depends on the feature `{feature}`, which results of others do not", file.display()));
    }
    let stem = file.file_stem().unwrap_or_default();
    let folder = if stem == "lib" || stem == "mod" { file.with_file_name("") } else { file.with_extension("") };
    for Module { name, attributes } in modules {
        let is_behind = |feature: &str| attributes.contains(&format!("#[cfg(feature = \"{feature}\")]"));
        let is_test = attributes.iter().any(|line| line == "#[cfg(test)]");
        if is_test || left_out.iter().any(|feature| is_behind(feature)) {
            continue;
        }
        let path = Some(folder.join(format!("{name}.rs"))).filter(|path| path.is_file());
        library(&path.unwrap_or_else(|| folder.join(&name).join("mod.rs")), left_out, texts)?;
    }
    texts.insert(file.display().to_string(), text);
    Ok(())
}

/// Text of a file that can change a verdict, and the modules that it declares in files of their own.
struct Significant {
    text: String,
    modules: Vec<Module>,
}

struct Module {
    name: String,
    attributes: Vec<String>,
}

fn significant(text: &str) -> Significant {
    let mut found = Significant { text: String::new(), modules: Vec::new() };
    let mut attributes: Vec<String> = Vec::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let trimmed = line.trim();
        let declared = declared(line);
        if trimmed.is_empty() || trimmed.starts_with("//") || trimmed.ends_with("::HARNESSES,") {
            continue;
        } else if line.starts_with("#[") {
            attributes.push(line.to_owned());
            continue;
        } else if let Some(name) = declared.and_then(|name| name.strip_suffix(';')).filter(|name| !name.contains(' ')) {
            found.modules.push(Module { name: name.to_owned(), attributes: std::mem::take(&mut attributes) });
            continue;
        } else if declared.is_some() && attributes.iter().any(|line| line == "#[cfg(test)]") {
            // The formatter puts the end of an item below its beginning.
            let _ = lines.find(|line| *line == "}");
            attributes.clear();
            continue;
        }
        for line in attributes.drain(..) {
            found.text.extend([&line, "\n"]);
        }
        found.text.extend([trimmed, "\n"]);
    }
    found
}

/// Rest of a line that declares a module: `name;` or `name {`.
fn declared(line: &str) -> Option<&str> {
    ["mod ", "pub mod ", "pub(crate) mod ", "pub(super) mod "].iter().find_map(|start| line.strip_prefix(start))
}

/// Implementations in files of the proofs that declare neither the trait nor the type.
pub(crate) fn strays(root: &Path) -> Result<Vec<String>, String> {
    let mut wrong = Vec::new();
    for path in files(&root.join("proofs/src"))? {
        let text = significant(&read(&path)?).text;
        let declares =
            |word: &str| ["struct", "enum", "trait"].iter().any(|kind| text.contains(&format!("{kind} {word}")));
        let heads = text.lines().filter(|line| line.starts_with("impl ") || line.starts_with("impl<"));
        let strays = heads.filter(|head| !words(head).any(declares));
        wrong.extend(strays.map(|head| format!("{}: belongs beside its trait or its type: {head}", path.display())));
    }
    Ok(wrong)
}

/// Hash of the rules, of Kani's flags, and of the parts of manifests and lock that concern core without some features.
fn cargo(root: &Path, left_out: &[&str]) -> Result<Hash, String> {
    let table = |path: &str| -> Result<Table, String> {
        let path = root.join(path);
        toml::from_str(&read(&path)?).map_err(at(&path))
    };
    let (workspace, core, proofs, lock) =
        (table("Cargo.toml")?, table("core/Cargo.toml")?, table("proofs/Cargo.toml")?, table("Cargo.lock")?);
    let mut hash = Hash::NONE;
    hash.add(&RULES.to_string());
    kani::FLAGS.iter().for_each(|flag| hash.add(flag));
    let mut names = needed(&core);
    names.extend(needed(&proofs));
    names.extend(["nalgebra".to_owned(), "libm".to_owned()]);
    let shared = get(&workspace, &["workspace", "dependencies"]).and_then(Value::as_table);
    let features = get(&core, &["features"]).map(|features| without(features, left_out));
    let mut parts = vec![
        get(&workspace, &["profile"]),
        get(&workspace, &["patch"]),
        get(&workspace, &["workspace", "package", "edition"]),
        features.as_ref(),
        get(&core, &["dependencies"]),
        get(&core, &["package", "edition"]),
        get(&proofs, &["package", "metadata"]),
    ];
    parts.extend(names.iter().map(|name| shared?.get(name)));
    parts.iter().for_each(|part| hash.add(&part.map_or_else(String::new, Value::to_string)));
    locked(&lock, names).iter().for_each(|package| hash.add(package));
    Ok(hash)
}

/// Table of features without some, and without their names in the others.
fn without(features: &Value, left_out: &[&str]) -> Value {
    let is_left_out = |name: &Value| name.as_str().is_some_and(|name| left_out.contains(&name));
    let features = features.as_table().into_iter().flatten().filter(|(name, _)| !left_out.contains(&name.as_str()));
    let features = features.map(|(name, value)| {
        let mut value = value.clone();
        if let Value::Array(names) = &mut value {
            names.retain(|name| !is_left_out(name));
        }
        (name.clone(), value)
    });
    Value::Table(features.collect())
}

/// Value in tables of tables.
fn get<'a>(table: &'a Table, path: &[&str]) -> Option<&'a Value> {
    let (last, folders) = path.split_last()?;
    let folder = folders.iter().try_fold(table, |table, name| table.get(*name)?.as_table())?;
    folder.get(*last)
}

/// Dependencies that are not optional.
fn needed(manifest: &Table) -> BTreeSet<String> {
    let all = manifest.get("dependencies").and_then(Value::as_table).into_iter().flatten();
    let optional = |value: &Value| value.get("optional").and_then(Value::as_bool) == Some(true);
    all.filter(|(_, value)| !optional(value)).map(|(name, _)| name.clone()).collect()
}

/// Packages of the lock with these names, and all that they depend on; of several versions the one that is named.
fn locked(lock: &Table, names: BTreeSet<String>) -> BTreeSet<String> {
    let packages = lock.get("package").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let (mut found, mut left) = (BTreeSet::new(), Vec::from_iter(names));
    while let Some(dependency) = left.pop() {
        let mut words = dependency.split(' ');
        let (name, version) = (words.next(), words.next());
        let is = |package: &Value, key: &str, word| package.get(key).and_then(Value::as_str) == Some(word);
        let named = packages.iter().filter(|package| {
            name.is_some_and(|name| is(package, "name", name))
                && version.is_none_or(|version| is(package, "version", version))
        });
        // Core's own list has its tests' dependencies too.
        for package in named.filter(|package| package.get("source").is_some()) {
            if found.insert(package.to_string()) {
                let below = package.get("dependencies").and_then(Value::as_array).into_iter().flatten();
                left.extend(below.filter_map(|name| Some(name.as_str()?.to_owned())));
            }
        }
    }
    found
}
