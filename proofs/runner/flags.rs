//! Flags of Kani from elsewhere: they would change what is proved, and no result would say so.

use std::path::Path;

use toml::{Table, Value};

use crate::{at, read};

/// Tables of a Cargo.toml in which Kani looks for flags.
const TABLES: [&[&str]; 3] = [
    &["workspace", "metadata", "kani"],
    &["package", "metadata", "kani"],
    &["kani"],
];

/// Its one table, in proofs/Cargo.toml, which says why.
const OWN: &str = "flags = { no-overflow-checks = true }";

/// Flags in the Cargo.toml of the workspace and of its folders, but for the proofs' own one.
pub(crate) fn in_manifests(root: &Path) -> Result<Vec<String>, String> {
    let mut wrong = Vec::new();
    let mut folders = vec![root.to_owned()];
    for entry in std::fs::read_dir(root).map_err(at(root))? {
        folders.push(entry.map_err(at(root))?.path());
    }
    for path in folders
        .iter()
        .map(|folder| folder.join("Cargo.toml"))
        .filter(|path| path.is_file())
    {
        let manifest: Value = toml::from_str(&read(&path)?).map_err(at(&path))?;
        for keys in TABLES {
            let found = keys.iter().try_fold(&manifest, |table, key| table.get(key));
            let is_proofs_own = path.ends_with("proofs/Cargo.toml") && keys == TABLES[1];
            if found.is_some_and(|found| !(is_proofs_own && is_own(found))) {
                wrong.push(format!(
                    "{}: [{}] changes what Kani proves",
                    path.display(),
                    keys.join(".")
                ));
            }
        }
    }
    Ok(wrong)
}

/// Build scripts of what is proved: they may write sources and set flags, which no hash has.
pub(crate) fn build_scripts(root: &Path) -> Result<Vec<String>, String> {
    let mut wrong = Vec::new();
    for part in ["core", "proofs", "proofs/capi", "host/labcomm"] {
        let path = root.join(part).join("Cargo.toml");
        if !path.is_file() {
            continue;
        }
        let manifest: Table = toml::from_str(&read(&path)?).map_err(at(&path))?;
        let is_named = manifest
            .get("package")
            .is_some_and(|package| package.get("build").is_some());
        if is_named || path.with_file_name("build.rs").exists() {
            wrong.push(format!(
                "{part}: a build script changes what Kani proves, and no result would say so"
            ));
        }
    }
    Ok(wrong)
}

/// True for the flags that the proofs have.
fn is_own(flags: &Value) -> bool {
    toml::from_str::<Table>(OWN).is_ok_and(|own| *flags == Value::Table(own))
}

/// Variables that change what Kani, Cargo or CBMC do. Those that a run removes (see
/// [`crate::kani`]) are none.
pub(crate) fn in_environment() -> Vec<String> {
    let names = std::env::vars_os().map(|(name, _)| name.to_string_lossy().into_owned());
    let names = names.filter(|name| changes_proofs(name));
    names
        .map(|name| format!("{name} is set, and changes what Kani proves"))
        .collect()
}

fn changes_proofs(variable: &str) -> bool {
    let is_kani = variable.starts_with("KANI") && variable != "KANI_HOME";
    let is_flags = [
        "CARGO_BUILD_RUSTFLAGS",
        "CARGO_BUILD_TARGET",
        "CARGO_ENCODED_RUSTFLAGS",
    ]
    .contains(&variable);
    let is_target = variable.starts_with("CARGO_TARGET_") && variable.ends_with("_RUSTFLAGS");
    is_kani
        || is_flags
        || is_target
        || variable.starts_with("CARGO_PROFILE_")
        || variable.starts_with("CBMC")
}
