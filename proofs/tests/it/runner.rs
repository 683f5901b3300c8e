//! The runner, with a `cargo kani` that prints what the real one (0.57) printed.
#![allow(
    clippy::unwrap_used,
    reason = "a test that cannot write its files must panic"
)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// `check` on this repository: manifest, source and README name the same harnesses and mutants.
#[test]
fn names_agree() {
    let output = Command::new(env!("CARGO_BIN_EXE_gantry-tau-proofs"))
        .arg("check")
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// A repository with one harness and one mutant.
struct Toy {
    root: PathBuf,
}

const MANIFEST: &str = r#"
[[harness]]
name = "toy_is_small"
theorems = ["T1"]
property = "small"
domain = "anything"
solver = "minisat"
tier = "fast"
verdict = "verified"
measured_s = 0.1

[[mutant]]
name = "toy_mutant"
harness = "toy_is_small"
change = "not small"
fails = "T5: exactly min"
tier = "fast"
verdict = "fails"
measured_s = 0.1
"#;

const HARNESS: &str = r#"
#[kani::proof]
#[kani::solver(minisat)]
fn toy_is_small() {
    let small = kani::any();
    kani::assume(small);
    kani::cover!(true, "something is small");
    assert!(small);
    kani::cover!(true, "the end");
}
"#;

impl Toy {
    fn new(name: &str) -> Self {
        let toy = Self {
            root: Path::new(env!("CARGO_TARGET_TMPDIR")).join(name),
        };
        let _ = std::fs::remove_dir_all(&toy.root);
        toy.write("proofs/manifest.toml", MANIFEST);
        toy.write("proofs/kani-version", "0.68.0\n");
        toy.write(
            "proofs/src/harness/mod.rs",
            "#[cfg(any(not(only), only = \"toy\"))]\nmod toy;\n",
        );
        toy.write("proofs/src/harness/toy.rs", HARNESS);
        toy.write("core/src/lib.rs", "#[cfg(mutant = \"toy_mutant\")]\n");
        let rows = (1..=15).map(|n| match n {
            1 => "| T1 | small | proved | `toy_is_small` |\n".to_owned(),
            n => format!("| T{n} | not yet | | — |\n"),
        });
        toy.write("README.md", &rows.collect::<String>());
        toy
    }

    fn write(&self, path: &str, text: &str) {
        let path = self.root.join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    fn read(&self, path: &str) -> String {
        std::fs::read_to_string(self.root.join(path)).unwrap()
    }

    /// The runner, which finds no program but those in `bin`.
    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gantry-tau-proofs"));
        command
            .arg("--root")
            .arg(&self.root)
            .args(arguments)
            .env("PATH", self.root.join("bin"))
            .env("CARGO_HOME", self.root.join("home"));
        command
    }

    fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }
}

fn out(output: &Output) -> String {
    let both = [output.stdout.as_slice(), &output.stderr].concat();
    String::from_utf8_lossy(&both).into_owned()
}

#[test]
fn every_disagreement_is_named() {
    let cases = [
        (
            "proofs/manifest.toml",
            "name = \"toy_is_small\"",
            "name = \"toy_is_big\"",
            "in the source, not in the manifest",
        ),
        (
            "proofs/src/harness/toy.rs",
            "fn toy_is_small",
            "fn toy_is_big",
            "in the manifest, not in the source",
        ),
        (
            "proofs/src/harness/toy.rs",
            "minisat",
            "kissat",
            "solver minisat in the manifest",
        ),
        (
            "proofs/src/harness/toy.rs",
            "#[kani::solver",
            "#[kani::unwind(3)]\n#[kani::solver",
            "unwind None in the manifest",
        ),
        (
            "proofs/src/harness/toy.rs",
            "#[kani::solver",
            "#[kani::stub(a, b)]\n#[kani::solver",
            "does not say what it assumes",
        ),
        (
            "proofs/src/harness/toy.rs",
            "kani::cover!(true, \"the end\");",
            "",
            "its last statement is not a kani::cover!",
        ),
        (
            "proofs/src/harness/toy.rs",
            "kani::cover!(true, \"the end\");",
            "kani::assume(small);",
            "no kani::cover! after this kani::assume",
        ),
        (
            "proofs/src/harness/mod.rs",
            "mod toy",
            "mod tay",
            "harness/mod.rs: no `#[cfg(any(not(only), only",
        ),
        (
            "core/src/lib.rs",
            "toy_mutant",
            "toy_mutation",
            "a mutant in core, not in the manifest",
        ),
        (
            "core/src/lib.rs",
            "#[cfg",
            "// #[cfg",
            "a mutant in the manifest, not in core",
        ),
        (
            "proofs/manifest.toml",
            "harness = \"toy_is_small\"",
            "harness = \"toy\"",
            "no mutant tries any of its harnesses",
        ),
        (
            "core/src/lib.rs",
            "#[cfg",
            "fn any() {\n    kani::assume(true);\n}\n#[cfg",
            "lib.rs:2: no kani::cover! after this kani::assume",
        ),
        (
            "README.md",
            "`toy_is_small`",
            "—",
            "README, T1: toy_is_small is missing",
        ),
        (
            "README.md",
            "| — |",
            "| `toy_is_small` |",
            "README, T2: no harness toy_is_small proves it",
        ),
        ("README.md", "| T7 |", "| T6 |", "README: 0 rows for T7"),
    ];
    let toy = Toy::new("disagreement");
    assert_eq!(toy.run(&["check"]).status.code(), Some(0));
    for (file, from, to, said) in cases {
        let text = toy.read(file);
        toy.write(file, &text.replacen(from, to, 1));
        let output = toy.run(&["check"]);
        assert_eq!(output.status.code(), Some(4), "{said}");
        assert!(out(&output).contains(said), "{said}: {}", out(&output));
        toy.write(file, &text);
    }
}

#[test]
fn without_kani_nothing_succeeds() {
    let toy = Toy::new("missing");
    toy.write("target/kani/results.json", "of another time");
    let output = toy.run(&["prove"]);
    assert!(!toy.root.join("target/kani/results.json").exists());
    assert_eq!(output.status.code(), Some(3));
    let said = out(&output);
    assert!(said.contains("NOTHING WAS PROVED: `cargo kani` cannot be run here"));
    assert!(
        said.contains("cargo install --locked kani-verifier --version 0.68.0 && cargo kani setup")
    );
    assert!(!said.to_lowercase().contains("success"), "{said}");
}

#[test]
fn an_unknown_name_is_a_usage_error() {
    assert_eq!(
        Toy::new("unknown").run(&["prove", "nix"]).status.code(),
        Some(2)
    );
}

#[cfg(unix)]
mod with_a_recorded_kani {
    use std::os::unix::fs::PermissionsExt;
    use std::time::{Duration, Instant};

    use super::*;

    /// Installs a `cargo kani` that answers with these shell lines.
    fn install(toy: &Toy, proof: &str, mutant: &str) {
        let script = format!(
            "#!/bin/sh\nPATH=/usr/bin:/bin\nrecorded={}/tests/kani\ncase \"$*\" in *--version*) echo 'cargo-kani 0.57.0'; exit 0;; esac\n\
             case \"$RUSTC_WORKSPACE_WRAPPER\" in\n*toy_mutant) {mutant};;\n*) {proof};;\nesac\n",
            env!("CARGO_MANIFEST_DIR"),
        );
        toy.write("bin/cargo-kani", &script);
        let path = toy.root.join("bin/cargo-kani");
        std::fs::set_permissions(path, PermissionsExt::from_mode(0o755)).unwrap();
    }

    const VERIFIED: &str = "cat $recorded/verified.txt";
    const FAILED: &str = "cat $recorded/failed.txt; exit 1";

    /// The runner finds this objection.
    fn objects(name: &str, proof: &str, mutant: &str, objection: &str) {
        let toy = Toy::new(name);
        install(&toy, proof, mutant);
        let output = toy.run(&["prove"]);
        assert_eq!(output.status.code(), Some(1), "{}", out(&output));
        let said = out(&output);
        assert!(said.contains(objection), "{said}");
        assert!(said.contains("1 of 2 as expected"), "{said}");
        assert!(said.contains("/target/kani/logs/toy_"), "{said}");
    }

    #[test]
    fn what_is_expected_is_reported() {
        let toy = Toy::new("expected");
        install(&toy, VERIFIED, FAILED);
        let output = toy.run(&["prove", "--tier", "full"]);
        assert_eq!(output.status.code(), Some(0), "{}", out(&output));
        let json: serde_json::Value =
            serde_json::from_str(&toy.read("target/kani/results.json")).unwrap();
        assert_eq!(json["kani"], "0.57.0");
        assert_eq!(json["tier"], "full");
        assert_eq!(
            (&json["as_expected"], &json["total"]),
            (&2.into(), &2.into())
        );
        assert_eq!(json["results"][0]["seconds"], 0.054_763_83);
        assert_eq!(json["results"][1]["expected"], "fails");
        let markdown = toy.read("target/kani/results.md");
        assert!(markdown.contains("| `toy_is_small` | T1 | small | anything | verified | 0.1 s |"));
        let wrapper = toy.read("target/kani/rustc/toy-toy_mutant");
        assert!(wrapper.contains("'--cfg=only=\"toy\"' '--cfg=mutant=\"toy_mutant\"'"));
    }

    #[test]
    fn a_name_chooses() {
        let toy = Toy::new("chosen");
        install(&toy, VERIFIED, FAILED);
        assert!(out(&toy.run(&["prove", "toy_mutant"])).contains("1 of 1 as expected"));
    }

    #[test]
    fn a_proof_that_fails() {
        objects(
            "failure",
            FAILED,
            FAILED,
            "failed: T5: exactly min(rho, |value|)",
        );
        objects(
            "unwinding",
            "cat $recorded/unwinding.txt; exit 1",
            FAILED,
            "failed: unwinding assertion loop 0",
        );
    }

    #[test]
    fn a_cover_that_is_not_reached() {
        objects(
            "cover",
            "cat $recorded/unreached_cover.txt",
            FAILED,
            "1 of 3 covers reached; not: \"never\"; \"not here\"",
        );
        objects(
            "no_cover",
            "cat $recorded/no_cover.txt",
            FAILED,
            "it has no cover",
        );
    }

    #[test]
    fn a_proof_that_is_none() {
        objects(
            "no_match",
            "cat $recorded/no_match.txt; exit 1",
            FAILED,
            "no result: error: Failed to match",
        );
        objects(
            "memory",
            "cat $recorded/out_of_memory.txt; exit 101",
            FAILED,
            "no result: SAT checker ran out of memory",
        );
        objects(
            "silent",
            "true",
            FAILED,
            "no result: its output is not understood",
        );
        objects(
            "status",
            "cat $recorded/verified.txt; exit 1",
            FAILED,
            "Kani ended with exit status: 1",
        );
        objects(
            "zero",
            "sed 's/1 total/0 total/' $recorded/verified.txt",
            FAILED,
            "0 harnesses ran instead of one",
        );
        objects(
            "two",
            "sed 's/1 total/2 total/' $recorded/verified.txt",
            FAILED,
            "2 harnesses ran instead of one",
        );
        objects(
            "slow",
            "sed 's/Time: 0/Time: 31/' $recorded/verified.txt",
            FAILED,
            "took 31.1 s, its tier allows 30 s",
        );
        objects(
            "undecided",
            "sed 's/of 1 failed/& (1 undetermined)/' $recorded/verified.txt",
            FAILED,
            "could not decide",
        );
    }

    #[test]
    fn a_mutant_that_is_not_caught() {
        objects("verifies", VERIFIED, VERIFIED, "the mutant verifies");
        objects(
            "wrong_check",
            VERIFIED,
            "sed 's/T5/T6/' $recorded/failed.txt; exit 1",
            "the wrong check failed: T6",
        );
        objects(
            "hidden",
            VERIFIED,
            "cat $recorded/unwinding.txt; exit 1",
            "failed for another reason",
        );
    }

    /// What a solver does: it goes on alone when Kani is killed.
    const ENDLESS: &str = "echo 'Checking harness x...'; sleep 600 & echo $! > ${0%/*}/pid; wait";

    /// The solver goes. Where nobody collects the dead, a zombie stays.
    fn assert_solver_goes(toy: &Toy) {
        let pid = toy.read("bin/pid");
        let began = Instant::now();
        loop {
            let mut ps = Command::new("/bin/ps");
            let state = ps.args(["-o", "stat=", "-p", pid.trim()]).output().unwrap();
            if state.stdout.trim_ascii().is_empty() || state.stdout.trim_ascii().starts_with(b"Z") {
                return;
            }
            assert!(began.elapsed() < Duration::from_secs(60), "it lives on");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    #[test]
    fn a_proof_that_takes_too_long_is_ended() {
        let toy = Toy::new("timeout");
        install(&toy, ENDLESS, FAILED);
        let output = toy.run(&["prove", "--seconds", "0.5"]);
        assert_eq!(output.status.code(), Some(1));
        assert!(
            out(&output).contains("timed out after 0.5 s"),
            "{}",
            out(&output)
        );
        assert_solver_goes(&toy);
    }

    #[test]
    fn a_build_that_takes_too_long_is_ended() {
        let toy = Toy::new("build");
        install(&toy, "sleep 600", FAILED);
        let output = toy.run(&["prove", "--build-minutes", "0"]);
        assert!(
            out(&output).contains("timed out while building"),
            "{}",
            out(&output)
        );
    }

    #[test]
    fn an_interrupt_ends_the_solver() {
        let toy = Toy::new("interrupt");
        install(&toy, ENDLESS, FAILED);
        let mut child = toy.command(&["prove"]).spawn().unwrap();
        let began = Instant::now();
        while !std::fs::read_to_string(toy.root.join("bin/pid"))
            .is_ok_and(|pid| pid.ends_with('\n'))
        {
            assert!(
                began.elapsed() < Duration::from_secs(60),
                "the solver did not start"
            );
            std::thread::sleep(Duration::from_millis(20));
        }
        Command::new("/bin/kill")
            .arg(child.id().to_string())
            .status()
            .unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(1));
        assert_solver_goes(&toy);
    }
}
