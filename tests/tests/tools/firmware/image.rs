//! Panics and sizes of the images.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use object::{Object, ObjectSection, ObjectSymbol};

use super::budget;
use super::emulator::{Build, images};

/// Returns the images of a build that are measured and free of panics; the others have a network, or a
/// panic on purpose. LabComm and kinematics are the same with keys.
const fn measured(build: Build) -> &'static [&'static str] {
    match build {
        Build::M7Keyed => &["firmware", "session_only"],
        Build::M7SmallKeyed => &["session_only"],
        _ => &["firmware", "whole", "session_only", "labcomm"],
    }
}

/// Parts of the mangled names of functions that panic.
const PANICS: [&str; 3] = ["panicking", "panic_", "_fail"];

/// Returns the functions of an image that panic. The handler itself is in every image, and is not
/// called.
pub(crate) fn panics(image: &Path) -> Vec<String> {
    let bytes = fs::read(image).unwrap();
    let file = object::File::parse(&*bytes).unwrap();
    let names: Vec<String> = file
        .symbols()
        .map(|symbol| symbol.name().unwrap().to_owned())
        .collect();
    assert!(
        names.iter().any(|name| name == "main"),
        "the image has its symbols"
    );
    let panics = names
        .into_iter()
        .filter(|name| PANICS.iter().any(|panic| name.contains(panic)));
    panics.collect()
}

/// Builds the measured images; returns their folder.
pub(crate) fn all(build: Build) -> PathBuf {
    let bins: Vec<String> = measured(build)
        .iter()
        .map(|image| format!("--bin={image}"))
        .collect();
    let bins: Vec<&str> = bins.iter().map(String::as_str).collect();
    images(build, &bins)
}

pub(crate) fn no_panic() {
    for build in Build::ALL {
        let folder = all(build);
        for image in measured(build) {
            let found = panics(&folder.join(image));
            assert_eq!(found, [""; 0], "{image} of {}: nm -C", build.name());
        }
    }
}

pub(crate) fn control_is_seen() {
    let folder = images(Build::M7, &["--features", "control", "--bin", "control"]);
    assert!(!panics(&folder.join("control")).is_empty());
}

/// Returns the size of a section, without the dot of its name; 0 if there is none.
fn size(image: &object::File<'_>, section: &str) -> i64 {
    let section = image.section_by_name(&format!(".{section}"));
    i64::try_from(section.map_or(0, |section| section.size())).unwrap()
}

/// Returns the size of an image's code.
pub(crate) fn text(image: &Path) -> i64 {
    let bytes = fs::read(image).unwrap();
    size(&object::File::parse(&*bytes).unwrap(), "text")
}

pub(crate) fn sizes() {
    for build in Build::ALL {
        let folder = all(build);
        // LabComm is measured where size is asked for.
        let images = measured(build).iter();
        for image in images.filter(|image| **image != "labcomm" || build == Build::M7Small) {
            let bytes = fs::read(folder.join(image)).unwrap();
            let file = object::File::parse(&*bytes).unwrap();
            let measured =
                ["text", "rodata", "data", "bss"].map(|name| (name.to_owned(), size(&file, name)));
            budget::judge(build, image, &BTreeMap::from(measured));
        }
    }
}
