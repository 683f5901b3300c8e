//! The seeds of `../fuzz`: written here, each named by what it means, compared with the files, and
//! replayed on stable Rust.
//!
//! `GANTRY_TAU_WRITE_SEEDS=1 cargo test -p gantry-tau-tests --test it fuzz_seeds` writes the
//! files again.

mod bytes;
mod forgeries;
mod labcomm;
mod loads;
mod loops;
mod measured;
mod mistakes;
mod problems;
mod samples;
mod scenarios;
pub(crate) mod streams;
mod texts;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gantry_tau_tests::fuzzed::TARGETS;

/// Name and content.
type Seed = (String, Vec<u8>);

fn seeds_of(target: &str) -> Vec<Seed> {
    match target {
        "compensation" => loads::seeds(),
        "config" => texts::robots(),
        "deframer" => streams::streams(),
        "frame" => streams::sealed(),
        "greeting" => forgeries::seeds(),
        "kinematics" => problems::seeds(),
        "labcomm" => labcomm::streams(),
        "labcomm_json" => labcomm::lines(),
        "measurements" => measured::seeds(),
        "position_loop" => loops::seeds(),
        "session" => scenarios::seeds(),
        "solve" => texts::requests(),
        "steering" => samples::seeds(),
        _ => Vec::new(),
    }
}

fn folder(kind: &str, target: &str) -> PathBuf {
    let fuzz = concat!(env!("CARGO_MANIFEST_DIR"), "/../fuzz");
    Path::new(fuzz).join(kind).join(target)
}

/// Returns the files of a folder by name; empty without the folder.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    entries
        .map(|entry| {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            (name, std::fs::read(&path).unwrap())
        })
        .collect()
}

#[test]
fn the_files_are_the_seeds() {
    let write = std::env::var_os("GANTRY_TAU_WRITE_SEEDS").is_some();
    for (target, _) in TARGETS {
        let folder = folder("seeds", target);
        let seeds: BTreeMap<_, _> = seeds_of(target).into_iter().collect();
        assert!(seeds.len() > 4, "{target} has seeds");
        if write {
            let _ = std::fs::remove_dir_all(&folder);
            std::fs::create_dir_all(&folder).unwrap();
            for (name, bytes) in &seeds {
                std::fs::write(folder.join(name), bytes).unwrap();
            }
        }
        let files = files(&folder);
        for (name, bytes) in &seeds {
            let same = files.get(name) == Some(bytes);
            assert!(same, "{target}/{name} is old: GANTRY_TAU_WRITE_SEEDS=1");
        }
        assert!(files.keys().eq(seeds.keys()), "{target}: no other file");
    }
}

/// With GANTRY_TAU_REPLAY_CORPUS also what fuzzing on this machine has found, in `fuzz/corpus`:
/// `fuzz/coverage.sh corpus` asks for it.
#[test]
fn every_seed_holds() {
    let with_corpus = std::env::var_os("GANTRY_TAU_REPLAY_CORPUS").is_some();
    for (target, run) in TARGETS {
        let found = with_corpus.then(|| files(&folder("corpus", target)));
        for (name, bytes) in seeds_of(target)
            .into_iter()
            .chain(found.into_iter().flatten())
        {
            println!("{target}/{name}");
            run(&bytes);
        }
    }
}

/// True for a seed in which mistakes are to be made.
fn is_without_mistakes(target: &str, name: &str) -> bool {
    match target {
        "config" => name.ends_with("_learned"),
        "measurements" => true,
        _ => false,
    }
}

/// Files that people write are wrong in one place, which random bytes seldom are.
#[test]
fn every_mistake_in_a_file_holds() {
    for (target, run) in TARGETS {
        for (name, bytes) in seeds_of(target)
            .into_iter()
            .filter(|(name, _)| is_without_mistakes(target, name))
        {
            let Ok(text) = String::from_utf8(bytes) else {
                continue;
            };
            println!("{target}/{name}");
            mistakes::each(&text, |wrong| run(wrong.as_bytes()));
        }
    }
}
