//! T12, second leg: the linked core contains no panic path. A release staticlib whose panic handler calls a missing function
//! is built with cargo; the missing symbol must not be in it. The control build links one panic and must be caught.
#![allow(
    clippy::unwrap_used,
    reason = "a build that cannot run must fail the test"
)]

use std::path::{Path, PathBuf};
use std::process::Command;

const SYMBOL: &str = "gantry_tau_panic";

/// Builds the probe and returns its archive.
fn build(features: &[&str]) -> PathBuf {
    let probe = Path::new(env!("CARGO_MANIFEST_DIR")).join("panic-probe");
    let target =
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("panic-probe{}", features.concat()));
    let status = Command::new(env!("CARGO"))
        .current_dir(&probe)
        .args(["build", "--release", "--quiet", "--features"])
        .arg(features.join(","))
        .arg("--target-dir")
        .arg(&target)
        .status()
        .unwrap();
    assert!(status.success());
    let name = if cfg!(windows) {
        "panic_probe.lib"
    } else {
        "libpanic_probe.a"
    };
    target.join("release").join(name)
}

/// Whether the archive mentions the symbol: a name in a symbol table is plain text.
fn mentions(archive: &Path, symbol: &str) -> bool {
    let bytes = std::fs::read(archive).unwrap();
    bytes
        .windows(symbol.len())
        .any(|window| window == symbol.as_bytes())
}

#[test]
fn the_linked_core_has_no_panic_path() {
    let archive = build(&[]);
    assert!(
        ["server", "client", "client_of_six"].map(|entry| mentions(&archive, entry)) == [true; 3],
        "the probe is linked"
    );
    assert!(
        !mentions(&archive, SYMBOL),
        "some path of core can panic: nm -C {}",
        archive.display()
    );
}

#[test]
fn the_control_is_caught() {
    assert!(mentions(&build(&["control"]), SYMBOL));
}
