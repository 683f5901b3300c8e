//! Hashes of the sources that a verdict depends on: a result is of this source as long as they
//! agree.
//!
//! A row depends on
//! - core without the wings that its family does not name: `model`, `pacer` and `position_loop`;
//! - the file of its family, the properties that file names, and those that they name;
//! - the C interface, and LabComm, where these name it;
//! - of the manifests, of Cargo.lock and of Cargo's configuration, the parts that concern core and
//!   what it is made of;
//! - the row itself: its theorems and named checks, and what it says of property, domain and
//!   assumptions; of a mutant, the file with its fault, and the check that must fail;
//! - the flags of Kani, and the rules of this program.
//!
//! A wing is the finest part of core that can be recognised from the text alone. Core compiles
//! without the features `model`, `pacer` and `position-loop` (CI does it), so nothing else depends
//! on these wings. (The feature `keyed` is no wing: it gates parts of many files, which count for every row.)
//! Inside a wing, an `impl` in any file may decide what another one does. Of the properties
//! that could be so too, therefore [`strays`] wants every `impl` in the file of its trait or its
//! type.
//!
//! Of a source file its tokens count, in the normal form of [`crate::tokens`]: comments, tests, the
//! lists of modules, and all that rustfmt's settings change do not count. So a result outlives a
//! change of the format.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use gantry_tau_proofs::harness::HARNESSES;
use toml::{Table, Value};

use crate::manifest::{Mutant, Row};
use crate::tokens::{self, Program};
use crate::{at, files, kani, mutate, read};

/// Raised when this program judges Kani's output by other rules: earlier results are then of
/// another source.
const RULES: u32 = 2;

/// Part of core behind a feature of its own, without which core compiles: a module, and all below
/// it.
struct Wing {
    feature: &'static str,
    /// True if the feature belongs to the part of the manifest that every row depends on. (If a
    /// younger one did, it would have made all results stale.)
    is_common: bool,
    /// True if a text of a family names it.
    is_named: fn(&str) -> bool,
}

const WINGS: [Wing; 3] = [
    // A path; the word alone may stand in a text.
    Wing {
        feature: "model",
        is_common: true,
        is_named: |text| text.contains("model ::") || text.contains(":: model"),
    },
    Wing {
        feature: "position-loop",
        is_common: false,
        is_named: |text| words(text).any(|word| word == "position_loop"),
    },
    Wing {
        feature: "pacer",
        is_common: false,
        is_named: |text| words(text).any(|word| word == "pacer"),
    },
];

/// Hashes of every family's sources.
pub(crate) struct Sources {
    families: BTreeMap<&'static str, Hash>,
    /// Texts of the files that the hashes are made of, by their paths from the root.
    texts: BTreeMap<String, String>,
    /// Sources that no hash has, by their paths from the root.
    left_out: Vec<String>,
}

impl Sources {
    /// Reads a repository.
    pub(crate) fn read(root: &Path) -> Result<Self, String> {
        Self::of(root, texts(root)?)
    }

    /// Reads the repository again. Without a change of a file the hashes stay.
    pub(crate) fn refresh(&mut self, root: &Path) -> Result<(), String> {
        let texts = texts(root)?;
        if texts != self.texts {
            *self = Self::of(root, texts)?;
        }
        Ok(())
    }

    /// True if no verdict on these sources is different on those that the repository has now.
    pub(crate) fn agree(&self, root: &Path) -> Result<bool, String> {
        let texts = texts(root)?;
        Ok(texts == self.texts || Self::of(root, texts)?.families == self.families)
    }

    /// Sources of a repository with these texts.
    fn of(root: &Path, texts: BTreeMap<String, String>) -> Result<Self, String> {
        let names = HARNESSES
            .iter()
            .filter_map(|harnesses| Some(harnesses.first()?.family()));
        let mut known = Known::default();
        let families = names.map(|name| Ok((name, family(root, name, &mut known)?)));
        let families = families.collect::<Result<_, String>>()?;
        let proofs = root.join("proofs/src");
        known
            .tests
            .extend(OF_TESTS.map(|module| proofs.join(module)));
        let mut left_out: Vec<_> = texts.keys().cloned().collect();
        left_out.retain(|path| {
            let file = root.join(path);
            path.ends_with(".rs") && !known.counted.contains(&file) && !known.is_of_tests(&file)
        });
        Ok(Self {
            families,
            texts,
            left_out,
        })
    }

    /// Sources that no hash has: a change of one would leave every result current.
    pub(crate) fn left_out(&self) -> Vec<String> {
        let all = self.left_out.iter();
        all.map(|path| format!("{path}: is a part of no row; its changes would be overlooked"))
            .collect()
    }

    /// Hash of everything that the verdict of a row depends on, or of a mutant of its harness.
    pub(crate) fn hash(&self, family: &str, row: &Row, mutant: Option<&Mutant>) -> String {
        let mut hash = self.families.get(family).copied().unwrap_or(Hash::NONE);
        hash.add(&row.name);
        match mutant {
            None => [&row.theorems, &row.requires, &row.leaves_out, &row.assumes]
                .into_iter()
                .flatten()
                .chain([&row.property, &row.domain])
                .for_each(|text| hash.add(text)),
            Some(mutant) => [&mutant.file, &self.fault(mutant), &mutant.fails]
                .into_iter()
                .for_each(|text| hash.add(text)),
        }
        format!("{:032x}", hash.0)
    }

    /// File with the fault of a mutant. (A fault that does not apply, which `check` reports, or
    /// does not parse, which the compiler will, stands for itself.)
    fn fault(&self, mutant: &Mutant) -> String {
        let text = self
            .texts
            .get(&mutant.file)
            .and_then(|text| mutate::with_fault(text, mutant).ok());
        let program = text.and_then(|text| tokens::program(&text).ok());
        program.map_or_else(
            || [mutant.old.as_str(), &mutant.new].join("\n"),
            |program| program.text,
        )
    }
}

/// Manifests and lock that the hashes depend on.
const MANIFESTS: [&str; 5] = [
    "Cargo.toml",
    "Cargo.lock",
    "core/Cargo.toml",
    "proofs/Cargo.toml",
    "proofs/capi/Cargo.toml",
];

/// Modules of the proofs that property tests and fuzz targets alone use, and no harness.
const OF_TESTS: [&str; 4] = ["known_solution", "reference_model", "robots", "scenario"];

/// Configuration of Cargo, which a repository need not have.
const CONFIGURATION: &str = ".cargo/config.toml";

/// Texts of all files that the hashes are made of, by their paths from the root.
fn texts(root: &Path) -> Result<BTreeMap<String, String>, String> {
    let mut paths = Vec::from(MANIFESTS.map(|path| root.join(path)));
    paths.extend(Some(root.join(CONFIGURATION)).filter(|path| path.is_file()));
    for folder in mutate::SOURCES {
        paths.extend(files(&root.join(folder))?);
    }
    let texts = paths.into_iter().map(|path| {
        let name = path.strip_prefix(root).unwrap_or(&path);
        Ok((name.display().to_string(), read(&path)?))
    });
    texts.collect()
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

/// Hash of these texts.
pub(crate) fn hash_of(texts: &[String]) -> String {
    let mut hash = Hash::NONE;
    texts.iter().for_each(|text| hash.add(text));
    format!("{:032x}", hash.0)
}

/// Contents that several families depend on, read once.
#[derive(Default)]
struct Known {
    /// Hashes of the manifests without some features.
    cargos: BTreeMap<Vec<&'static str>, Hash>,
    programs: BTreeMap<PathBuf, Program>,
    /// Files that a hash has.
    counted: BTreeSet<PathBuf>,
    /// Modules that only tests have: their files and folders without the end `.rs`.
    tests: BTreeSet<PathBuf>,
}

impl Known {
    /// True for a file of a module that only tests have.
    fn is_of_tests(&self, file: &Path) -> bool {
        let module = file.with_extension("");
        (module.ancestors()).any(|folder| self.tests.contains(folder))
    }

    /// Program of a file.
    fn program(&mut self, path: &Path) -> Result<Program, String> {
        if let Some(program) = self.programs.get(path) {
            return Ok(program.clone());
        }
        let program = program(path)?;
        self.programs.insert(path.to_owned(), program.clone());
        Ok(program)
    }
}

/// Hash of one family.
fn family(root: &Path, name: &str, known: &mut Known) -> Result<Hash, String> {
    let proofs = root.join("proofs/src");
    let mut texts = BTreeMap::new();
    let mut names = vec![
        "lib".to_owned(),
        "harness".to_owned(),
        format!("harness/{name}"),
    ];
    while let Some(name) = names.pop() {
        for path in module(&proofs, &name)? {
            let name = path
                .strip_prefix(root)
                .unwrap_or(&path)
                .display()
                .to_string();
            if texts.contains_key(&name) {
                continue;
            }
            let text = known.program(&path)?.text;
            known.counted.insert(path);
            names.extend(mentioned(&text));
            texts.insert(name, text);
        }
    }
    if texts
        .values()
        .any(|text| text.contains("gantry_tau_capi ::"))
    {
        interface(root, known, &mut texts)?;
    }
    if texts
        .values()
        .any(|text| text.contains("gantry_tau_labcomm ::"))
    {
        library(
            &root.join("host/labcomm/src/lib.rs"),
            &[],
            known,
            &mut texts,
        )?;
    }
    let mut left_out = Vec::from_iter(&WINGS);
    left_out.retain(|wing| !texts.values().any(|text| (wing.is_named)(text)));
    let features: Vec<&str> = left_out.iter().map(|wing| wing.feature).collect();
    library(&root.join("core/src/lib.rs"), &features, known, &mut texts)?;
    let features: Vec<&'static str> = left_out
        .iter()
        .filter(|wing| !wing.is_common)
        .map(|wing| wing.feature)
        .collect();
    let mut hash = match known.cargos.get(&features) {
        Some(hash) => *hash,
        None => cargo(root, &features)?,
    };
    known.cargos.insert(features, hash);
    for (name, text) in &texts {
        hash.add(name.trim_start_matches(&root.display().to_string()));
        hash.add(text);
    }
    Ok(hash)
}

/// Adds the sources of the C interface, the manifest that compiles them for the proofs, and what
/// that takes from elsewhere.
fn interface(
    root: &Path,
    known: &mut Known,
    texts: &mut BTreeMap<String, String>,
) -> Result<(), String> {
    library(&root.join("host/capi/src/lib.rs"), &[], known, texts)?;
    let path = root.join("proofs/capi/Cargo.toml");
    let manifest = read(&path)?;
    let needed = needed(&toml::from_str(&manifest).map_err(at(&path))?);
    let path = root.join("Cargo.lock");
    let lock = toml::from_str(&read(&path)?).map_err(at(&path))?;
    texts.insert("proofs/capi".to_owned(), manifest);
    texts.insert(
        "Cargo.lock".to_owned(),
        Vec::from_iter(locked(&lock, needed)).concat(),
    );
    Ok(())
}

/// Files of the modules of the proofs with this name, at the root and among the properties; none if
/// the name is not one of a module.
fn module(proofs: &Path, name: &str) -> Result<Vec<PathBuf>, String> {
    let mut found = Vec::new();
    for parent in [proofs, &proofs.join("properties")] {
        let file = parent.join(format!("{name}.rs"));
        if !file.is_file() {
            continue;
        }
        found.push(file);
        let folder = parent.join(name);
        // A family has a harness file of its own, and names the properties that it uses.
        if folder.is_dir() && !["harness", "properties"].contains(&name) {
            found.extend(files(&folder)?);
        }
    }
    Ok(found)
}

/// Names that follow `crate::`, `super::` or `properties::`, alone or in braces.
fn mentioned(text: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let parts = ["crate :: ", "super :: ", "properties :: "]
        .into_iter()
        .flat_map(|parent| text.split(parent).skip(1));
    for part in parts {
        let group = part
            .split(';')
            .next()
            .filter(|group| group.starts_with('{'));
        match group {
            Some(group) => names.extend(words(group).map(str::to_owned)),
            None => names.extend(words(part).next().map(str::to_owned)),
        }
    }
    names
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|letter: char| !letter.is_alphanumeric() && letter != '_')
        .filter(|word| !word.is_empty())
}

/// Adds a file of a library and its modules, as the compiler finds them, but for the modules of the
/// features that are left out.
fn library(
    file: &Path,
    left_out: &[&str],
    known: &mut Known,
    texts: &mut BTreeMap<String, String>,
) -> Result<(), String> {
    let Program { text, modules } = known.program(file)?;
    if let Some(feature) = left_out
        .iter()
        .find(|feature| text.contains(&format!("feature = \"{feature}\"")))
    {
        return Err(format!(
            "{}: depends on the feature `{feature}`, which results of others do not",
            file.display()
        ));
    }
    let stem = file.file_stem().unwrap_or_default();
    let folder = if stem == "lib" || stem == "mod" {
        file.with_file_name("")
    } else {
        file.with_extension("")
    };
    known.counted.insert(file.to_owned());
    for module in modules {
        if module.is_test() {
            known.tests.insert(folder.join(&module.name));
        }
        if module.is_test() || left_out.iter().any(|feature| module.is_behind(feature)) {
            continue;
        }
        let path = Some(folder.join(format!("{}.rs", module.name))).filter(|path| path.is_file());
        library(
            &path.unwrap_or_else(|| folder.join(&module.name).join("mod.rs")),
            left_out,
            known,
            texts,
        )?;
    }
    texts.insert(file.display().to_string(), text);
    Ok(())
}

/// Program of a file.
fn program(path: &Path) -> Result<Program, String> {
    tokens::program(&read(path)?).map_err(at(path))
}

/// Implementations in files of the proofs that declare neither the trait nor the type.
pub(crate) fn strays(root: &Path) -> Result<Vec<String>, String> {
    let mut wrong = Vec::new();
    for path in files(&root.join("proofs/src"))? {
        let text = program(&path)?.text;
        let strays = implementations(&text)
            .into_iter()
            .filter(|head| !words(head).any(|word| declares(&text, word)));
        wrong.extend(strays.map(|head| {
            format!(
                "{}: belongs beside its trait or its type: {head}",
                path.display()
            )
        }));
    }
    Ok(wrong)
}

/// True if the text of a program declares this type or trait.
fn declares(text: &str, name: &str) -> bool {
    ["struct", "enum", "trait"]
        .iter()
        .any(|kind| text.contains(&format!("{kind} {name}")))
}

/// Heads of the implementations in the text of a program, those in macros too.
fn implementations(text: &str) -> Vec<String> {
    let mut heads = Vec::new();
    let mut before = ";";
    let mut rest = text;
    while let Some((token, after)) = rest.split_once(' ') {
        // Elsewhere `impl` is a type.
        if token == "impl" && ["{", "}", ";", "]", "unsafe"].contains(&before) {
            heads.extend(rest.split(" {").next().map(str::to_owned));
        }
        (before, rest) = (token, after);
    }
    heads
}

/// Profiles without what the linker does in that of development: Kani reads what is there before it.
fn unlinked(profiles: &Value) -> Value {
    let mut profiles = profiles.clone();
    if let Some(dev) = profiles.get_mut("dev").and_then(Value::as_table_mut) {
        dev.remove("lto");
    }
    profiles
}

/// Hash of the rules, of Kani's flags, and of the parts of manifests and lock that concern core
/// without some features.
fn cargo(root: &Path, left_out: &[&str]) -> Result<Hash, String> {
    let workspace = table(&root.join("Cargo.toml"))?;
    let core = table(&root.join("core/Cargo.toml"))?;
    let proofs = table(&root.join("proofs/Cargo.toml"))?;
    let lock = table(&root.join("Cargo.lock"))?;
    let mut hash = Hash::NONE;
    hash.add(&RULES.to_string());
    kani::FLAGS.iter().for_each(|flag| hash.add(flag));
    let mut names = needed(&core);
    names.extend(needed(&proofs));
    names.extend(["nalgebra", "libm", "sha2"].map(str::to_owned));
    let shared = get(&workspace, &["workspace", "dependencies"]).and_then(Value::as_table);
    let features = get(&core, &["features"]).map(|features| without(features, left_out));
    let profiles = get(&workspace, &["profile"]).map(unlinked);
    let mut parts = vec![
        profiles.as_ref(),
        get(&workspace, &["patch"]),
        get(&workspace, &["workspace", "package", "edition"]),
        features.as_ref(),
        get(&core, &["dependencies"]),
        get(&core, &["lib"]),
        get(&core, &["package", "edition"]),
        get(&proofs, &["dependencies", "gantry-tau-core"]),
        get(&proofs, &["lib"]),
        get(&proofs, &["package", "metadata"]),
    ];
    // Flags of the compiler.
    let configuration = if root.join(CONFIGURATION).is_file() {
        table(&root.join(CONFIGURATION))?
    } else {
        Table::new()
    };
    parts.extend(["build", "profile", "target", "unstable"].map(|key| configuration.get(key)));
    parts.extend(names.iter().map(|name| shared?.get(name)));
    parts
        .iter()
        .for_each(|part| hash.add(&part.map_or_else(String::new, Value::to_string)));
    locked(&lock, names)
        .iter()
        .for_each(|package| hash.add(package));
    Ok(hash)
}

/// Contents of a manifest or lock.
fn table(path: &Path) -> Result<Table, String> {
    toml::from_str(&read(path)?).map_err(at(path))
}

/// Table of features without some, and without their names in the others.
fn without(features: &Value, left_out: &[&str]) -> Value {
    let features = features
        .as_table()
        .into_iter()
        .flatten()
        .filter(|(name, _)| !left_out.contains(&name.as_str()));
    let features = features.map(|(name, value)| {
        let mut value = value.clone();
        if let Value::Array(names) = &mut value {
            names.retain(|name| !name.as_str().is_some_and(|name| left_out.contains(&name)));
        }
        (name.clone(), value)
    });
    Value::Table(features.collect())
}

/// Value in tables of tables.
fn get<'a>(table: &'a Table, path: &[&str]) -> Option<&'a Value> {
    let (last, folders) = path.split_last()?;
    let folder = folders
        .iter()
        .try_fold(table, |table, name| table.get(*name)?.as_table())?;
    folder.get(*last)
}

/// Dependencies that are not optional.
fn needed(manifest: &Table) -> BTreeSet<String> {
    let all = manifest
        .get("dependencies")
        .and_then(Value::as_table)
        .into_iter()
        .flatten();
    all.filter(|(_, value)| !is_optional(value))
        .map(|(name, _)| name.clone())
        .collect()
}

fn is_optional(dependency: &Value) -> bool {
    dependency.get("optional").and_then(Value::as_bool) == Some(true)
}

/// Packages of the lock with these names, and all that they depend on; of several versions the one
/// that is named.
fn locked(lock: &Table, names: BTreeSet<String>) -> BTreeSet<String> {
    let packages = lock
        .get("package")
        .and_then(Value::as_array)
        .map_or(&[][..], Vec::as_slice);
    let mut found = BTreeSet::new();
    let mut left = Vec::from_iter(names);
    while let Some(dependency) = left.pop() {
        let mut words = dependency.split(' ');
        let (name, version) = (words.next(), words.next());
        let named = packages.iter().filter(|package| {
            text_of(package, "name") == name
                && (version.is_none() || text_of(package, "version") == version)
        });
        // Core's own list has its tests' dependencies too.
        for package in named.filter(|package| package.get("source").is_some()) {
            if found.insert(package.to_string()) {
                let below = package
                    .get("dependencies")
                    .and_then(Value::as_array)
                    .into_iter()
                    .flatten();
                left.extend(below.filter_map(|name| Some(name.as_str()?.to_owned())));
            }
        }
    }
    found
}

fn text_of<'a>(package: &'a Value, key: &str) -> Option<&'a str> {
    package.get(key).and_then(Value::as_str)
}
