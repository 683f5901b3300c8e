//! Flags of Kani from elsewhere: they would change what is proved, and no result would say so.

use std::path::Path;

use toml::{Table, Value};

use crate::{at, read};

/// Tables of a Cargo.toml in which Kani looks for flags.
const TABLES: [&[&str]; 3] = [&["workspace", "metadata", "kani"], &["package", "metadata", "kani"], &["kani"]];

/// Its one table, in proofs/Cargo.toml, which says why.
const OWN: &str = "flags = { no-overflow-checks = true }";

/// Flags in the Cargo.toml of the workspace and of its folders, but for the proofs' own one.
pub(crate) fn in_manifests(root: &Path) -> Result<Vec<String>, String> {
    let mut wrong = Vec::new();
    let mut folders = vec![root.to_owned()];
    for entry in std::fs::read_dir(root).map_err(at(root))? {
        folders.push(entry.map_err(at(root))?.path());
    }
    for path in folders.iter().map(|folder| folder.join("Cargo.toml")).filter(|path| path.is_file()) {
        let manifest: Value = toml::from_str(&read(&path)?).map_err(at(&path))?;
        for keys in TABLES {
            let found = keys.iter().try_fold(&manifest, |table, key| table.get(key));
            let own = || toml::from_str::<Table>(OWN).is_ok_and(|own| found == Some(&Value::Table(own)));
            if found.is_some() && !(path.ends_with("proofs/Cargo.toml") && keys == TABLES[1] && own()) {
                wrong.push(format!("{}: [{}] changes what Kani proves", path.display(), keys.join(".")));
            }
        }
    }
    Ok(wrong)
}

/// Variables that change what Kani, Cargo or CBMC do. Those that a run removes (see [`crate::kani`]) are none.
pub(crate) fn in_environment() -> Vec<String> {
    let changes = |name: &str| {
        let kani = name.starts_with("KANI") && name != "KANI_HOME";
        let cargo =
            name.starts_with("CARGO_PROFILE_") || name == "CARGO_BUILD_RUSTFLAGS" || name == "CARGO_BUILD_TARGET";
        let target = name.starts_with("CARGO_TARGET_") && name.ends_with("_RUSTFLAGS");
        kani || cargo || target || name.starts_with("CBMC") || name == "CARGO_ENCODED_RUSTFLAGS"
    };
    let names = std::env::vars_os().map(|(name, _)| name.to_string_lossy().into_owned());
    names.filter(|name| changes(name)).map(|name| format!("{name} is set, and changes what Kani proves")).collect()
}
