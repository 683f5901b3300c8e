//! Packages of PyPI that trials need: `.ci/run` installs them below `target`.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Returns a Python that has packages: that of an environment below `target`, or else `python3`.
pub(crate) fn python_with(environment: &str, packages: &str) -> Option<PathBuf> {
    let target = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target");
    [
        target.join(environment).join("bin/python3"),
        PathBuf::from("python3"),
    ]
    .into_iter()
    .find(|python| {
        let mut import = Command::new(python);
        import
            .args(["-c", &format!("import {packages}")])
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        import.status().is_ok_and(|status| status.success())
    })
}
