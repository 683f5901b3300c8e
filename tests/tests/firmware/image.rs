//! What is in the images.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use object::{Object, ObjectSection, ObjectSymbol};

use crate::budget;
use crate::emulator::{Board, build, build_what};

/// The images that everything is said of; the others have a network, or a panic on purpose.
const IMAGES: [&str; 3] = ["firmware", "whole", "session_only"];

/// Symbols of everything that panics, before they are demangled.
const PANICS: [&str; 3] = ["panicking", "panic_", "_fail"];

/// Names of functions that a panic goes through. The handler itself is in every image, and calls nothing.
fn panics(image: &Path) -> Vec<String> {
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

/// The session by itself has none either when it is made small. (With kinematics, nalgebra's bounds are not optimised away then.)
pub(crate) fn no_panic() {
    let fast = ["m7", "m4f"].into_iter();
    let fast = fast.flat_map(|what| IMAGES.map(|image| (what, image)));
    for (what, image) in fast.chain([("m7-small", "session_only")]) {
        let path = build_what(what, &[]).join(image);
        assert_eq!(panics(&path), [""; 0], "{image} of {what}: nm -C");
    }
}

pub(crate) fn control_is_seen() {
    let image = build(Board::M7, &["--features", "control", "--bin", "control"]).join("control");
    assert!(!panics(&image).is_empty());
}

pub(crate) fn sizes() {
    for what in ["m7", "m7-small", "m4f"] {
        let folder = build_what(what, &[]);
        for image in IMAGES {
            let bytes = fs::read(folder.join(image)).unwrap();
            let file = object::File::parse(&*bytes).unwrap();
            let size = |name: &str| {
                let section = file.section_by_name(name);
                i64::try_from(section.map_or(0, |section| section.size())).unwrap()
            };
            let measured = ["text", "rodata", "data", "bss"]
                .map(|name| (name.to_owned(), size(&format!(".{name}"))));
            let subject = format!("{}_{image}", what.replace('-', "_"));
            budget::judge(&subject, &BTreeMap::from(measured));
        }
    }
}
