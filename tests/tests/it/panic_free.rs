//! T12, second leg: the linked core contains no panic path. A release staticlib whose panic handler
//! calls a missing function is built with cargo; the missing symbol must not be in it. The control
//! build links one panic and must be caught.

use std::path::Path;
use std::process::Command;
use std::sync::{Mutex, PoisonError};

const SYMBOL: &str = "gantry_tau_panic";

/// Builds the probe and returns the bytes of its archive.
fn build(features: &[&str]) -> Vec<u8> {
    // Both builds share their dependencies, and put the archive in the same place.
    static ONE: Mutex<()> = Mutex::new(());
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let probe = Path::new(env!("CARGO_MANIFEST_DIR")).join("panic-probe");
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("linked");
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
    std::fs::read(target.join("release").join(name)).unwrap()
}

/// True if the archive mentions the symbol: a name in a symbol table is plain text.
fn mentions(archive: &[u8], symbol: &str) -> bool {
    archive
        .windows(symbol.len())
        .any(|window| window == symbol.as_bytes())
}

#[test]
fn the_linked_core_has_no_panic_path() {
    let archive = build(&[]);
    assert!(
        [
            "server",
            "client",
            "client_of_six",
            "keyed_server",
            "keyed_client"
        ]
        .map(|entry| mentions(&archive, entry))
            == [true; 5],
        "the probe is not linked"
    );
    assert!(
        !mentions(&archive, SYMBOL),
        "some path of core can panic: build tests/panic-probe, and look for {SYMBOL} with nm -C"
    );
}

#[test]
fn the_control_is_caught() {
    assert!(mentions(&build(&["control"]), SYMBOL));
}
