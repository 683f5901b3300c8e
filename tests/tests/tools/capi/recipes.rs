//! The commands of `host/capi/README.md` that link the library: run as they stand there, in a
//! folder with what they name.

use std::os::unix::fs::symlink;
use std::process::Command;

use libtest_mimic::Failed;

use super::tools::{folder, library, run, target};

/// Heading of the section.
const SECTION: &str = "## Static, shared, from Python\n";

pub(crate) fn work() -> Result<(), Failed> {
    let readme = std::fs::read_to_string(folder().join("README.md"))?;
    let section = readme
        .split_once(SECTION)
        .and_then(|(_, after)| after.split("\n## ").next());
    let section = section.unwrap().replace("\\\n", " ");
    // Blocks and the text between them take turns; the first line of a block is its language.
    let blocks = section.split("\n```").skip(1).step_by(2);
    let commands: Vec<&str> = blocks.flat_map(|block| block.lines().skip(1)).collect();
    assert!(commands.len() >= 6, "{commands:?}");
    let place = target().join("recipes");
    let _ = std::fs::remove_dir_all(&place);
    std::fs::create_dir_all(place.join("target/release"))?;
    symlink(library(), place.join("target/release/libgantry_tau.a"))?;
    for name in ["include", "examples"] {
        symlink(folder().join(name), place.join(name))?;
    }
    let mut said = String::new();
    for command in commands {
        said += &run(Command::new("sh").current_dir(&place).args(["-c", command]))?;
    }
    // Two programs, and what Python reads from the shared library.
    assert_eq!(
        said.matches("all bounds held over 700 ticks\n").count(),
        2,
        "{said}"
    );
    assert!(
        said.ends_with(&format!("{}\n", env!("CARGO_PKG_VERSION"))),
        "{said}"
    );
    // Nothing but the interface, and no symbol that dlopen would not find.
    let symbols = run(Command::new("nm")
        .args(["-D", "libgantry_tau.so"])
        .current_dir(&place))?;
    let (own, others): (Vec<_>, Vec<_>) = symbols.lines().partition(|line| line.contains(" T gt_"));
    assert!(own.len() > 40, "{symbols}");
    assert!(
        others
            .iter()
            .all(|line| line.contains("GLIBC") || line.contains(" w ")),
        "{others:?}"
    );
    Ok(())
}
