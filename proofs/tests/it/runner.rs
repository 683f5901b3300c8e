//! The runner, with a `cargo kani` that prints what the real one (0.57) printed.

use std::process::{Command, Output};

fn out(output: &Output) -> String {
    let both = [output.stdout.as_slice(), &output.stderr].concat();
    String::from_utf8_lossy(&both).into_owned()
}

/// Manifest, mutants, sources and README agree, and core compiles with the mutants.
#[test]
fn files_agree() {
    let mut runner = Command::new(env!("CARGO_BIN_EXE_gantry-tau-proofs"));
    let output = runner.args(["check", "--compile"]).output().unwrap();
    assert!(output.status.success(), "{}", out(&output));
}

#[cfg(unix)]
mod on_a_copy {
    use std::os::unix::fs::PermissionsExt;
    use std::path::{Path, PathBuf};
    use std::time::{Duration, Instant};

    use super::*;

    /// Copy of this repository's core and proofs.
    struct Toy {
        root: PathBuf,
    }

    /// Harness and mutant that the tests run.
    const NAMES: [&str; 3] = ["prove", "channel_ramp_is_exact", "ramp_past_zero"];

    impl Toy {
        fn new(name: &str) -> Self {
            let root = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
            let _ = std::fs::remove_dir_all(&root);
            std::fs::create_dir_all(&root).unwrap();
            let source = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
            let parts = ["Cargo.toml", "Cargo.lock", "core", "proofs"].map(|part| source.join(part));
            let mut copy = Command::new("/bin/cp");
            assert!(copy.arg("-R").args(parts).arg(&root).status().unwrap().success());
            let toy = Self { root };
            toy.write("proofs/kani-version", "0.68.0\n");
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

        /// Runner that finds no program but those in `bin`.
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

    /// File, text in it, replacement, and what `check` says then.
    const CASES: &str = r#"proofs/manifest.toml ~ name = "channel_ramp_is_exact" ~ name = "ramp" ~ channel_ramp_is_exact: in the source, not in the manifest
proofs/manifest.toml ~ name = "channel_ramp_is_exact" ~ name = "ramp" ~ ramp: in the manifest, not in the source
proofs/manifest.toml ~ name = "channel_ramp_is_exact" ~ name = "channel_ramp_is_bounded" ~ channel_ramp_is_bounded: stands twice
proofs/manifest.toml ~ measured_s = ~ measured_s = 9e9 # ~ channel_hold_is_bounded: slower than its tier
proofs/manifest.toml ~ theorems = ["T10"] ~ theorems = [] ~ motors_paired_are_equal: proves no theorem
proofs/manifest.toml ~ theorems = ["T10"] ~ theorems = ["T1"] ~ T10: no harness proves a part of it
proofs/manifest.toml ~ theorems = ["T10"] ~ theorems = ["T16"] ~ T16 is not a theorem
proofs/mutants.toml ~ harness = "motors_paired_are_equal" ~ harness = "motors" ~ its harness motors is not in the manifest
proofs/mutants.toml ~ harness = "motors_paired_are_equal" ~ harness = "total_start" ~ family motors: no mutant tries any
proofs/mutants.toml ~ fails = "T5: exactly min(rho, |value|)" ~ fails = "" ~ names no check that must fail
proofs/mutants.toml ~ new = "let rest = u32::MAX;" ~ new = "let rest = self.value.unsigned_abs();" ~ changes nothing
core/src/control/channel.rs ~ let rest = self.value.unsigned_abs(); ~ let rest = 0; ~ occurs 0 times in core/src/control/channel.rs, expected once
core/src/control/channel.rs ~ //! ~ //! let rest = self.value.unsigned_abs(); ~ occurs 2 times
core/src/control/channel.rs ~ let rest = ~ kani::assume(true); let rest = ~ no kani::cover! after this kani::assume
proofs/src/harness/wire.rs ~ //! T8 ~ fn any() { kani::assume(true); } // ~ wire.rs:1: no kani::cover!
proofs/README.md ~ `channel_hold_is_bounded` 0 ~ `channel_hold_is_bounded` 7 ~ table of harnesses is stale"#;

    #[test]
    fn every_disagreement_is_named() {
        let toy = Toy::new("disagreement");
        assert_eq!(toy.run(&["check"]).status.code(), Some(0));
        for case in CASES.lines() {
            let cells: Vec<&str> = case.split(" ~ ").collect();
            let [file, from, to, said] = cells[..] else { panic!("{case}") };
            let text = toy.read(file);
            assert!(text.contains(from), "{file}: {from}");
            toy.write(file, &text.replacen(from, to, 1));
            let output = toy.run(&["check"]);
            assert_eq!(output.status.code(), Some(4), "{said}");
            assert!(out(&output).contains(said), "{said}: {}", out(&output));
            toy.write(file, &text);
        }
        toy.write("proofs/src/harness/forgotten.rs", "");
        assert!(out(&toy.run(&["check"])).contains("family forgotten: no mutant tries any"));
        std::fs::remove_file(toy.root.join("proofs/src/harness/forgotten.rs")).unwrap();
        let readme = "proofs/README.md";
        toy.write(readme, &toy.read(readme).replacen("| T10 |", "| T1 |", 1));
        assert!(toy.run(&["table"]).status.success() && toy.run(&["check"]).status.success());
    }

    #[test]
    fn without_kani_nothing_succeeds() {
        let toy = Toy::new("missing");
        toy.write("target/kani/results.json", "of another time");
        let output = toy.run(&["prove"]);
        assert!(!toy.root.join("target/kani/results.json").exists());
        assert_eq!(output.status.code(), Some(3));
        let said = out(&output);
        assert!(said.contains("SKIPPED, NOTHING WAS PROVED: `cargo kani` cannot be run here"));
        let install = "cargo install --locked kani-verifier --version 0.68.0 && cargo kani setup";
        assert!(said.contains(install), "{said}");
        assert!(!said.to_lowercase().contains("success"), "{said}");
    }

    #[test]
    fn an_unknown_name_is_a_usage_error() {
        let output = Toy::new("unknown").run(&["prove", "nix"]);
        assert_eq!(output.status.code(), Some(2));
    }

    /// Installs a `cargo kani` that answers with these shell lines.
    fn install(toy: &Toy, proof: &str, mutant: &str) {
        let script = format!(
            "#!/bin/sh\nPATH=/usr/bin:/bin\nrecorded={}/tests/kani\n\
             case \"$*\" in *--version*) echo 'cargo-kani 0.57.0'; exit 0;; esac\n\
             echo \"$*\" >>${{0%/*}}/arguments\n\
             case \"$*\" in\n*target/kani/copy/proofs*) {mutant};;\n*) {proof};;\nesac\n",
            env!("CARGO_MANIFEST_DIR"),
        );
        toy.write("bin/cargo-kani", &script);
        let path = toy.root.join("bin/cargo-kani");
        std::fs::set_permissions(path, PermissionsExt::from_mode(0o755)).unwrap();
    }

    const VERIFIED: &str = "cat $recorded/verified.txt";
    const FAILED: &str = "cat $recorded/failed.txt; exit 1";

    #[test]
    fn what_is_expected_is_reported() {
        let toy = Toy::new("expected");
        install(&toy, VERIFIED, FAILED);
        let output = toy.run(&[&NAMES[..], &["--tier", "full"]].concat());
        assert_eq!(output.status.code(), Some(0), "{}", out(&output));
        let json: serde_json::Value = serde_json::from_str(&toy.read("target/kani/results.json")).unwrap();
        assert_eq!(json["kani"], "0.57.0");
        assert_eq!(json["tier"], "full");
        assert_eq!((&json["as_expected"], &json["total"]), (&2.into(), &2.into()));
        assert_eq!(json["results"][0]["seconds"], 0.054_763_83);
        assert_eq!(json["results"][1]["expected"], "fails");
        assert_eq!(json["results"][0]["solver"], "minisat");
        let markdown = toy.read("target/kani/results.md");
        assert!(markdown.contains("| `channel_ramp_is_exact` | T5 | Ramp moves by exactly"));
        let arguments = toy.read("bin/arguments");
        let harness = "--features only,channel --exact --harness harness::channel::channel_ramp_is_exact";
        assert_eq!(arguments.matches(harness).count(), 2, "{arguments}");
    }

    /// The fault stands in the copy and never in the sources; the next run begins with a clean copy.
    #[test]
    fn a_mutant_is_applied_to_a_copy() {
        let toy = Toy::new("copy");
        let fault = "grep -q 'let rest = u32::MAX;' ${0%/bin/*}/target/kani/copy/core/src/control/channel.rs";
        install(&toy, VERIFIED, &format!("{fault} && {FAILED}"));
        let original = toy.read("core/src/control/channel.rs");
        for _ in 0..2 {
            let output = toy.run(&["prove", "ramp_past_zero"]);
            assert!(out(&output).contains("1 of 1 as expected"), "{}", out(&output));
        }
        install(&toy, VERIFIED, &format!("{fault} || {FAILED}"));
        let output = toy.run(&["prove", "accel_ignored"]);
        assert!(out(&output).contains("the wrong check failed"), "{}", out(&output));
        assert_eq!(toy.read("core/src/control/channel.rs"), original);
        let workspace = toy.read("target/kani/copy/Cargo.toml");
        assert!(workspace.contains("members = [\"core\", \"proofs\"]"), "{workspace}");
        assert!(!workspace.contains("default-members"), "{workspace}");
    }

    /// Rows of Kani's behaviour for a harness, its behaviour for the mutant, and the objection of the runner.
    const OBJECTIONS: &str = "FAILED ~ FAILED ~ failed: T5: exactly min(rho, |value|)
cat $recorded/unwinding.txt; exit 1 ~ FAILED ~ failed: unwinding assertion loop 0
cat $recorded/unreached_cover.txt ~ FAILED ~ 1 of 3 covers reached; not: never; not here
cat $recorded/no_cover.txt ~ FAILED ~ it has no cover
cat $recorded/no_match.txt; exit 1 ~ FAILED ~ no result: error: Failed to match
cat $recorded/out_of_memory.txt; exit 101 ~ FAILED ~ no result: SAT checker ran out of memory
true ~ FAILED ~ no result: its output is not understood
VERIFIED; exit 1 ~ FAILED ~ Kani ended with exit status: 1
sed 's/1 total/0 total/' $recorded/verified.txt ~ FAILED ~ 0 harnesses ran instead of one
sed 's/1 total/2 total/' $recorded/verified.txt ~ FAILED ~ 2 harnesses ran instead of one
sed 's/Time: 0/Time: 31/' $recorded/verified.txt ~ FAILED ~ took 31.1 s, its tier allows 30 s
sed 's/SUCCESS$/UNDETERMINED/' $recorded/verified.txt ~ FAILED ~ could not decide
VERIFIED ~ VERIFIED ~ the mutant verifies
VERIFIED ~ sed 's/T5/T6/' $recorded/failed.txt; exit 1 ~ the wrong check failed: T6
VERIFIED ~ cat $recorded/unwinding.txt; exit 1 ~ failed for another reason";

    #[test]
    fn a_wrong_result_is_an_objection() {
        let toy = Toy::new("objections");
        for case in OBJECTIONS.lines() {
            let case = case.replace("VERIFIED", VERIFIED).replace("FAILED", FAILED);
            let cells: Vec<&str> = case.split(" ~ ").collect();
            let [proof, mutant, objection] = cells[..] else { panic!("{case}") };
            install(&toy, proof, mutant);
            let output = toy.run(&NAMES);
            let said = out(&output);
            assert_eq!(output.status.code(), Some(1), "{said}");
            assert!(said.contains(objection), "{objection}: {said}");
            assert!(said.contains("1 of 2 as expected"), "{said}");
            assert!(said.contains("/target/kani/logs/"), "{said}");
        }
    }

    /// Behaviour of a solver: it goes on alone when Kani is killed.
    const ENDLESS: &str = "echo 'Checking harness x...'; sleep 600 & echo $! > ${0%/*}/pid; wait";

    fn wait_until(what: &str, is_so: impl Fn() -> bool) {
        let began = Instant::now();
        while !is_so() {
            assert!(began.elapsed() < Duration::from_secs(60), "not so in a minute: {what}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// The solver goes. A zombie stays if no parent waits for it.
    fn assert_solver_goes(toy: &Toy) {
        let pid = toy.read("bin/pid");
        wait_until("the solver is gone", || {
            let state = Command::new("/bin/ps").args(["-o", "stat=", "-p", pid.trim()]).output().unwrap();
            state.stdout.trim_ascii().is_empty() || state.stdout.trim_ascii().starts_with(b"Z")
        });
    }

    #[test]
    fn a_proof_that_takes_too_long_is_ended() {
        let toy = Toy::new("timeout");
        install(&toy, ENDLESS, FAILED);
        let output = toy.run(&[&NAMES[..], &["--seconds", "0.5"]].concat());
        assert_eq!(output.status.code(), Some(1));
        assert!(out(&output).contains("timed out after 0.5 s"), "{}", out(&output));
        assert_solver_goes(&toy);
    }

    #[test]
    fn a_build_that_takes_too_long_is_ended() {
        let toy = Toy::new("build");
        install(&toy, "sleep 600", FAILED);
        let output = toy.run(&[&NAMES[..], &["--build-minutes", "0"]].concat());
        assert!(out(&output).contains("timed out while building"), "{}", out(&output));
    }

    #[test]
    fn an_interrupt_ends_the_solver() {
        let toy = Toy::new("interrupt");
        install(&toy, ENDLESS, FAILED);
        let mut child = toy.command(&NAMES).spawn().unwrap();
        let pid = toy.root.join("bin/pid");
        wait_until("the solver runs", || std::fs::read_to_string(&pid).is_ok_and(|pid| pid.ends_with('\n')));
        Command::new("/bin/kill").arg(child.id().to_string()).status().unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(1));
        assert_solver_goes(&toy);
    }
}
