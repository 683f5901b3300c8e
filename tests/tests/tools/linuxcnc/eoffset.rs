//! The comparison with LinuxCNC's own external offsets: README.md has the table that the script prints.

use libtest_mimic::Failed;

use super::run::{Machine, copy, folder};

pub(super) fn does_what_the_readme_says() -> Result<(), Failed> {
    let machine = Machine::new("l2", "eoffset", |header| header)?;
    // Without the sampler of the other tests: the script has its own.
    let place = machine.file("eoffset");
    copy(&folder().join("config"), &place.join("config"))?;
    std::fs::copy(folder().join("eoffset.py"), place.join("eoffset.py"))?;
    let out = place.join("out");
    std::fs::create_dir(&out)?;
    let said = machine.unprivileged(&format!("{} {}", place.join("eoffset.py").display(), out.display()))?;
    assert!(said.starts_with("| event |"), "{said}");
    let readme = std::fs::read_to_string(folder().join("README.md"))?;
    assert!(readme.contains(said.trim_end()), "README.md has another table than this one:\n{said}");
    Ok(())
}
