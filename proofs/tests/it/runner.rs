//! The runner, with a `cargo kani` that prints what the real one (0.57) printed.

use std::io::Write;
use std::process::{Command, Output};

fn out(output: &Output) -> String {
    let both = [output.stdout.as_slice(), &output.stderr].concat();
    String::from_utf8_lossy(&both).into_owned()
}

/// Manifest, mutants, sources and the page of results agree. (That the sources compile with the
/// mutants, `.ci/run` tests.)
///
/// Says which rows have no result on this source. That is no failure: a change is written first,
/// and proved then.
#[test]
fn files_agree() {
    let mut runner = Command::new(env!("CARGO_BIN_EXE_gantry-tau-proofs"));
    let output = runner.args(["check"]).output().unwrap();
    let said = out(&output);
    assert!(output.status.success(), "{said}");
    let stale: String = said
        .lines()
        .filter(|line| line.starts_with("STALE: "))
        .map(|line| format!("{line}\n"))
        .collect();
    // Not `eprint!`, which a test that passes does not show.
    std::io::stderr()
        .lock()
        .write_all(stale.as_bytes())
        .unwrap();
}

/// "Proved" has a version: that of the checker that ran, not the pinned one.
#[test]
fn the_readme_names_the_versions_that_proved() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let results = std::fs::read_to_string(root.join("results.json")).unwrap();
    let results: serde_json::Value = serde_json::from_str(&results).unwrap();
    let rows = results["rows"].as_array().unwrap();
    let versions: std::collections::BTreeSet<&str> = (rows.iter())
        .map(|row| row["kani"].as_str().unwrap())
        .collect();
    let versions = Vec::from_iter(versions).join(", ");
    let readme = std::fs::read_to_string(root.join("../README.md")).unwrap();
    let named = format!("model checker ({versions})");
    assert!(readme.contains(&named), "{named}");
}

/// A line of the pages can be read without scrolling sideways.
#[test]
fn pages_have_short_lines() {
    for page in std::fs::read_dir(env!("CARGO_MANIFEST_DIR")).unwrap() {
        let path = page.unwrap().path();
        if path.extension().is_some_and(|end| end == "md") {
            let text = std::fs::read_to_string(&path).unwrap();
            let long = text.lines().position(|line| line.chars().count() > 200);
            assert_eq!(long, None, "{}", path.display());
        }
    }
}

#[cfg(unix)]
mod on_a_copy {
    use std::collections::BTreeSet;
    use std::os::unix::fs::PermissionsExt;
    use std::path::{Path, PathBuf};
    use std::sync::LazyLock;
    use std::time::{Duration, Instant};

    use gantry_tau_proofs::harness::HARNESSES;

    use super::*;

    /// Copy of this repository's core and proofs, with one mutant of each family, and those that
    /// the tests name.
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
            copy(&TEMPLATE, ".", &root);
            Self { root }
        }

        /// The copy that all others are copied from.
        fn template() -> PathBuf {
            let root = Path::new(env!("CARGO_TARGET_TMPDIR")).join("template");
            let _ = std::fs::remove_dir_all(&root);
            let source = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
            for part in [
                "Cargo.toml",
                "Cargo.lock",
                "core",
                "proofs",
                "host/capi/src",
                "host/labcomm",
            ] {
                let folder = root.join(part);
                let folder = folder.parent().unwrap();
                std::fs::create_dir_all(folder).unwrap();
                copy(source, part, folder);
            }
            let toy = Self { root };
            toy.write("proofs/kani-version", "0.68.0\n");
            toy.write(".cargo/config.toml", "[build]\n");
            toy.cut_mutants();
            assert!(toy.run(&["table"]).status.success());
            toy.root
        }

        /// Leaves one mutant of each family, and those that the tests name, with their results.
        fn cut_mutants(&self) {
            let text = self.read("proofs/mutants.toml");
            let mut blocks = text.split("[[mutant]]\n");
            let mut kept = blocks.next().unwrap().to_owned();
            let mut cut = BTreeSet::new();
            let mut tried = BTreeSet::new();
            for block in blocks {
                let name = value(block, "name");
                let harness = value(block, "harness");
                let family = HARNESSES
                    .iter()
                    .copied()
                    .flatten()
                    .find(|known| known.name == harness)
                    .unwrap()
                    .family();
                if tried.insert(family) || NAMED_MUTANTS.contains(&name) {
                    kept += &format!("[[mutant]]\n{block}");
                } else {
                    cut.insert(name);
                }
            }
            self.write("proofs/mutants.toml", &kept);
            let results = self.read("proofs/results.json");
            let (head, rows) = results.split_once("[\n").unwrap();
            let (rows, end) = rows.split_once("\n]").unwrap();
            let rows = rows.split(",\n");
            let rows: Vec<&str> = rows
                .filter(|row| !cut.contains(row.split('"').nth(3).unwrap()))
                .collect();
            self.write(
                "proofs/results.json",
                &format!("{head}[\n{}\n]{end}", rows.join(",\n")),
            );
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

    static TEMPLATE: LazyLock<PathBuf> = LazyLock::new(Toy::template);

    /// Mutants that the tests name.
    const NAMED_MUTANTS: [&str; 2] = ["ramp_past_zero", "accel_ignored"];

    fn copy(root: &Path, part: &str, into: &Path) {
        let mut copy = Command::new("/bin/cp");
        let status = copy.arg("-R").arg(root.join(part)).arg(into).status();
        assert!(status.unwrap().success());
    }

    /// Value of a key of a mutant.
    fn value<'a>(block: &'a str, key: &str) -> &'a str {
        let start = format!("{key} = \"");
        let line = block.lines().find_map(|line| line.strip_prefix(&start));
        line.unwrap().trim_end_matches('"')
    }

    /// File, text in it, replacement, and what `check` says then.
    const CASES: &str = r#"proofs/composition.md ~ | three axes | `total_start` ~ | six axes | `total_start` ~ total_start is of three axes
proofs/composition.md ~ `total_write_of_six` ~ `total_write_of_seven` ~ total_write_of_seven is not a row
proofs/composition.md ~ `read_classify_is_one_by_one`: the events ~ the events ~ does not say that read_classify_is_one_by_one is taken for granted
proofs/composition.md ~ - `total_start`: three axes ~ - `total_start`: four axes ~ proofs/composition.md: differs from its sources; run `table`
proofs/composition/Rows.v ~ says: "T21: and waits for the path" ~ says: "T21: and waits" ~ total_start quotes "T21: and waits", which no property says
proofs/composition/Rows.v ~ (* says: "T9: what stands has not stepped" *) ~ (* *) ~ nominal_that_stands_is_within quotes no assertion
proofs/composition/Rows.v ~ Axiom total_write : N = 3%nat -> ~ Axiom total_write : N = 6%nat -> ~ total_write is of N = 6, its row of three axes
proofs/composition/Rows.v ~ Axiom decide_no_session_ramps : ~ Axiom decide_no_session_rests : ~ Rows.v: decide_no_session_rests is not a row
proofs/composition/mutants.toml ~ old = 'else is_running ~ old = 'else it runs ~ mutants.toml: one_miss_may_end: its text does not stand once
proofs/composition/Rows.v ~ Axiom type_limits : ~ Axiom type_bounds : ~ Witness.v: does not prove type_bounds
proofs/composition/Runs.v ~ Proof. ~ Proof. admit. ~ proofs/composition/Runs.v: admit
proofs/composition/Runs.v ~ Module Runs ~ Axiom of_nothing : False. Module Runs ~ Runs.v: Axiom outside the rows
proofs/manifest.toml ~ domain = "six axes: any configuration, any valid session, any fate ~ domain = "three axes: any configuration, any valid session, any fate ~ total_write_of_six is of N = 6, its row of three axes
proofs/manifest.toml ~ name = "channel_ramp_is_exact" ~ name = "ramp" ~ channel_ramp_is_exact: in the source, not in the manifest
proofs/manifest.toml ~ name = "channel_ramp_is_exact" ~ name = "ramp" ~ ramp: in the manifest, not in the source
proofs/manifest.toml ~ name = "channel_ramp_is_exact" ~ name = "channel_ramp_is_bounded" ~ channel_ramp_is_bounded: occurs twice
proofs/manifest.toml ~ theorems = ["T10"] ~ theorems = [] ~ motors_paired_are_equal: proves no theorem
proofs/manifest.toml ~ theorems = ["T10"] ~ theorems = ["T1"] ~ T10: no harness proves a part of it
proofs/manifest.toml ~ theorems = ["T10"] ~ theorems = ["T99"] ~ T99 is not a theorem
proofs/manifest.toml ~ domain = "six axes: any parameters ~ domain = "three axes: any parameters ~ total_start_of_six: its domain begins with "three axes", its harness has 6
proofs/manifest.toml ~ domain = "three axes: any session, any epochs ~ domain = "six axes: any session, any epochs ~ its domain begins with "six axes", its harness has 3
proofs/mutants.toml ~ harness = "endpoint_events_are_counted" ~ harness = "endpoint" ~ its harness endpoint is not in the manifest
proofs/mutants.toml ~ fails = "T5: never past zero" ~ fails = "" ~ names no check that must fail
proofs/mutants.toml ~ new = "let rest = u32::MAX;" ~ new = "let rest = self.value.unsigned_abs();" ~ changes nothing
core/src/control/channel.rs ~ let rest = self.value.unsigned_abs(); ~ let rest = 0; ~ occurs 0 times in core/src/control/channel.rs, expected once
core/src/control/channel.rs ~ //! ~ //! let rest = self.value.unsigned_abs(); ~ occurs 2 times
core/src/control/channel.rs ~ let rest = ~ kani::assume(true); let rest = ~ no kani::cover! after this kani::assume
proofs/src/harness/axis.rs ~ //! Any axis ~ fn any() { kani::assume(true); } // ~ axis.rs:1: no kani::cover!
proofs/src/harness/wire.rs ~ kani::cover!(decoded, "some bytes are one") ~ kani::cover!(decoded, "true") ~ : a cover does not say
proofs/src/harness/wire.rs ~ kani::cover!(decoded, "some bytes are one") ~ kani::cover!(decoded) ~ : a cover does not say
proofs/src/harness/axis.rs ~ "some axes are not at zero" ~ "" ~ axis.rs:22: a cover does not say
proofs/src/properties/channel.rs ~ /// T5, for one step. ~ impl Other for Third {} // ~ belongs beside its trait or its type: impl Other for Third
proofs/Cargo.toml ~ no-overflow-checks = true ~ no-memory-safety-checks = true ~ [package.metadata.kani] changes what Kani proves
core/Cargo.toml ~ [package.metadata.docs.rs] ~ [package.metadata.kani.flags] ~ [package.metadata.kani] changes what Kani proves
Cargo.toml ~ [profile.bench] ~ [workspace.metadata.kani.unstable] ~ [workspace.metadata.kani] changes what Kani proves
proofs/results.json ~ {"name":"channel_ramp_is_exact" ~ {"name":"ramp" ~ proofs/results.json: ramp is not in the manifest
proofs/RESULTS.md ~ # Results ~ # Some results ~ proofs/RESULTS.md: differs from manifest, mutants and results; run `table`
proofs/RESULTS.md ~ | `motors_paired_are_equal` | T10 | ~ | `motors_paired_are_equal` | T11 | ~ proofs/RESULTS.md: differs from manifest, mutants and results; run `table`"#;

    /// A file that no row depends on, and one that may write others.
    #[test]
    fn sources_without_a_row_are_named() {
        let toy = Toy::new("without_a_row");
        for (file, said) in [
            (
                "core/src/control/stray.rs",
                "core/src/control/stray.rs: is a part of no row",
            ),
            (
                "proofs/src/properties/stray.rs",
                "proofs/src/properties/stray.rs: is a part of no row",
            ),
            (
                "core/build.rs",
                "core: a build script changes what Kani proves",
            ),
        ] {
            toy.write(file, "fn main() {}\n");
            let output = toy.run(&["check"]);
            assert_eq!(output.status.code(), Some(4), "{file}");
            assert!(out(&output).contains(said), "{}", out(&output));
            std::fs::remove_file(toy.root.join(file)).unwrap();
        }
        assert_eq!(toy.run(&["check"]).status.code(), Some(0));
    }

    #[test]
    fn every_disagreement_is_named() {
        let toy = Toy::new("disagreement");
        assert_eq!(toy.run(&["check"]).status.code(), Some(0));
        for case in CASES.lines() {
            let cells: Vec<&str> = case.split(" ~ ").collect();
            let [file, from, to, said] = cells[..] else {
                panic!("{case}")
            };
            let text = toy.read(file);
            assert!(text.contains(from), "{file}: {from}");
            toy.write(file, &text.replacen(from, to, 1));
            let output = toy.run(&["check"]);
            assert_eq!(output.status.code(), Some(4), "{said}");
            assert!(out(&output).contains(said), "{said}: {}", out(&output));
            toy.write(file, &text);
        }
        let mutants = toy.read("proofs/mutants.toml");
        toy.write(
            "proofs/mutants.toml",
            &mutants.replace("\"endpoint_events_are_counted\"", "\"total_start\""),
        );
        let said = out(&toy.run(&["check"]));
        assert!(
            said.contains("family endpoint: no mutant tries any"),
            "{said}"
        );
        toy.write("proofs/mutants.toml", &mutants);
        toy.write("proofs/src/harness/forgotten.rs", "");
        assert!(out(&toy.run(&["check"])).contains("family forgotten: no mutant tries any"));
        std::fs::remove_file(toy.root.join("proofs/src/harness/forgotten.rs")).unwrap();
        std::fs::remove_file(toy.root.join("proofs/RESULTS.md")).unwrap();
        assert!(out(&toy.run(&["check"])).contains("proofs/RESULTS.md: differs"));
        assert!(toy.run(&["table"]).status.success() && toy.run(&["check"]).status.success());
    }

    #[test]
    fn without_kani_nothing_succeeds() {
        let toy = Toy::new("missing");
        toy.write("target/kani/results.md", "of another time");
        let output = toy.run(&["prove"]);
        assert!(!toy.root.join("target/kani/results.md").exists());
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

    /// Installs a `cargo kani` that answers with these shell lines, in which `recorded NAME` prints
    /// what Kani printed once, of the harness that it is asked for.
    fn install(toy: &Toy, proof: &str, mutant: &str) {
        let script = format!(
            "#!/bin/sh\nPATH=/usr/bin:/bin\nroot=${{0%/bin/*}}\n\
             case \"$*\" in *--version*) echo 'cargo-kani 0.57.0'; exit 0;; esac\n\
             echo \"$*\" >>$root/bin/arguments\n\
             name=$(echo \"$*\" | sed 's/.*--harness \\([^ ]*\\).*/\\1/')\n\
             recorded() {{ sed \"s/harness::toy::toy_is_small/$name/\" {}/tests/kani/$1.txt; }}\n\
             case \"$*\" in\n*target/kani/copy/proofs*) {mutant};;\n*) {proof};;\nesac\n",
            env!("CARGO_MANIFEST_DIR"),
        );
        toy.write("bin/cargo-kani", &script);
        let path = toy.root.join("bin/cargo-kani");
        std::fs::set_permissions(path, PermissionsExt::from_mode(0o755)).unwrap();
    }

    const VERIFIED: &str = "recorded verified";
    const FAILED: &str = "recorded failed; exit 1";

    /// Row of a harness or mutant in results.json.
    fn row(toy: &Toy, name: &str) -> serde_json::Value {
        let json: serde_json::Value =
            serde_json::from_str(&toy.read("proofs/results.json")).unwrap();
        let rows = json["rows"].as_array().unwrap();
        rows.iter()
            .find(|row| row["name"] == name)
            .cloned()
            .unwrap_or_default()
    }

    #[test]
    fn what_is_expected_is_reported() {
        let toy = Toy::new("expected");
        install(&toy, VERIFIED, FAILED);
        let output = toy.run(&[&NAMES[..], &["--tier", "full"]].concat());
        assert_eq!(output.status.code(), Some(0), "{}", out(&output));
        assert!(
            out(&output)
                .contains("Kani 0.57.0 is not the one that proofs/kani-version names, 0.68.0")
        );
        let proof = row(&toy, NAMES[1]);
        assert_eq!(
            (&proof["verdict"], &proof["seconds"]),
            (&"verified".into(), &0.05.into())
        );
        assert_eq!((&proof["checks"], &proof["covers"]), (&3.into(), &2.into()));
        assert_eq!(
            proof["states"],
            serde_json::json!(["T5: fine", "T5: one instance is enough"])
        );
        assert_eq!(
            (&proof["kani"], &proof["cbmc"]),
            (&"0.57.0".into(), &"6.6.0".into())
        );
        assert_eq!(row(&toy, NAMES[2])["verdict"], "caught");
        assert!(
            toy.read("proofs/results.json")
                .contains("\"kani_pinned\": \"0.68.0\"")
        );
        let markdown = toy.read("target/kani/results.md");
        assert!(markdown.contains("| `channel_ramp_is_exact` | T5 | Ramp moves by exactly"));
        let arguments = toy.read("bin/arguments");
        let harness =
            "--features only,channel --exact --harness harness::channel::channel_ramp_is_exact";
        assert_eq!(arguments.matches(harness).count(), 2, "{arguments}");
    }

    /// The fault stands in the copy and never in the sources; the next run begins with a clean
    /// copy.
    #[test]
    fn a_mutant_is_applied_to_a_copy() {
        let toy = Toy::new("copy");
        let fault =
            "grep -q 'let rest = u32::MAX;' $root/target/kani/copy/core/src/control/channel.rs";
        install(&toy, VERIFIED, &format!("{fault} && {FAILED}"));
        let original = toy.read("core/src/control/channel.rs");
        for _ in 0..2 {
            let output = toy.run(&["prove", "ramp_past_zero"]);
            assert!(
                out(&output).contains("1 of 1 as expected"),
                "{}",
                out(&output)
            );
        }
        install(&toy, VERIFIED, &format!("{fault} || {FAILED}"));
        let output = toy.run(&["prove", "accel_ignored"]);
        assert!(
            out(&output).contains("the wrong check failed"),
            "{}",
            out(&output)
        );
        assert_eq!(toy.read("core/src/control/channel.rs"), original);
        let workspace = toy.read("target/kani/copy/Cargo.toml");
        assert!(
            workspace.contains("members = [\"core\", \"proofs\"]"),
            "{workspace}"
        );
        assert!(!workspace.contains("default-members"), "{workspace}");
    }

    /// Cargo cannot tell the build of a mutant from that of core, and goes by the times of files:
    /// it has folders apart, and builds again.
    #[test]
    fn no_build_is_taken_for_another() {
        let toy = Toy::new("builds");
        install(&toy, VERIFIED, FAILED);
        let folders = [
            "target/kani/kani/any/debug/.fingerprint",
            "target/kani/mutants/kani/any/debug/.fingerprint",
        ];
        for folder in folders {
            toy.write(&format!("{folder}/gantry-tau-core-1/lib"), "");
            toy.write(&format!("{folder}/heapless-1/lib"), "");
        }
        assert!(toy.run(&NAMES).status.success());
        for folder in folders {
            assert!(!toy.root.join(folder).join("gantry-tau-core-1").exists());
            assert!(toy.root.join(folder).join("heapless-1").exists());
        }
        let arguments = toy.read("bin/arguments");
        let targets: Vec<&str> = arguments
            .lines()
            .filter_map(|line| line.split("--target-dir ").nth(1))
            .collect();
        let root = toy.root.display();
        assert_eq!(
            targets,
            [
                format!("{root}/target/kani"),
                format!("{root}/target/kani/mutants")
            ]
        );
    }

    /// Rows of Kani's behaviour for a harness, its behaviour for the mutant, and the objection of
    /// the runner.
    const OBJECTIONS: &str = "FAILED ~ FAILED ~ failed: T5: never past zero
recorded unwinding; exit 1 ~ FAILED ~ failed: unwinding assertion loop 0
recorded unreached_cover ~ FAILED ~ 1 of 3 covers reached; not: never; not here
recorded no_cover ~ FAILED ~ it has no cover
recorded no_match; exit 1 ~ FAILED ~ no result: error: Failed to match
recorded out_of_memory; exit 101 ~ FAILED ~ no result: SAT checker ran out of memory
true ~ FAILED ~ no result: its output is not understood
VERIFIED; exit 1 ~ FAILED ~ Kani ended with exit status: 1
recorded verified | sed 's/1 total/0 total/' ~ FAILED ~ 0 harnesses ran instead of one
recorded verified | sed 's/1 total/2 total/' ~ FAILED ~ 2 harnesses ran instead of one
recorded verified | sed 's/Time: 0/Time: 31/' ~ FAILED ~ took 31.1 s, its tier allows 30 s
recorded verified | sed 's/SUCCESS$/UNDETERMINED/' ~ FAILED ~ could not decide
recorded verified | sed 's/SUCCESS$/UNREACHABLE/' ~ FAILED ~ never reached: T5: fine; T5: one instance is enough
recorded verified | sed 's/the end//' ~ FAILED ~ a cover does not say what it covers: proofs/src/harness/toy.rs:104:5
recorded verified | sed 's/T5/T6/' ~ FAILED ~ no check says T5, and the manifest requires none
recorded verified | sed 's/ramp_is_exact/ramp/' ~ FAILED ~ harness::channel::channel_ramp ran instead of harness::channel::channel_ramp_is_exact
recorded verified | sed '/Checking harness/d' ~ FAILED ~ no harness ran instead of
VERIFIED ~ recorded failed | sed 's/ramp_is_exact/ramp/'; exit 1 ~ harness::channel::channel_ramp ran instead of
VERIFIED ~ VERIFIED ~ the mutant verifies
VERIFIED ~ recorded failed | sed 's/T5/T6/'; exit 1 ~ the wrong check failed: T6
VERIFIED ~ recorded unwinding; exit 1 ~ failed for another reason";

    #[test]
    fn a_wrong_result_is_an_objection() {
        let toy = Toy::new("objections");
        for case in OBJECTIONS.lines() {
            let case = case.replace("VERIFIED", VERIFIED).replace("FAILED", FAILED);
            let cells: Vec<&str> = case.split(" ~ ").collect();
            let [proof, mutant, objection] = cells[..] else {
                panic!("{case}")
            };
            install(&toy, proof, mutant);
            let output = toy.run(&NAMES);
            let said = out(&output);
            assert_eq!(output.status.code(), Some(1), "{said}");
            assert!(said.contains(objection), "{objection}: {said}");
            assert!(said.contains("1 of 2 as expected"), "{said}");
            assert!(said.contains("/target/kani/logs/"), "{said}");
        }
    }

    /// The first assertion is not reached.
    const PARTLY: &str = "recorded verified | sed '1,/SUCCESS$/s/SUCCESS$/UNREACHABLE/'";

    /// A check that the manifest requires by its text is missed when it is gone.
    #[test]
    fn a_required_check_must_be_there() {
        let toy = Toy::new("required");
        let manifest = toy.read("proofs/manifest.toml");
        let own = "name = \"channel_ramp_is_exact\"\n";
        let unreached = "recorded verified | sed 's/SUCCESS$/UNREACHABLE/'";
        for (line, proof, objection) in [
            ("requires = [\"T5: fine\"]", VERIFIED, None),
            ("requires = [\"the end\"]", VERIFIED, None),
            (
                "requires = [\"T5: fin\"]",
                VERIFIED,
                Some("required, and not among its checks: T5: fin"),
            ),
            (
                "requires = [\"assertion failed: iter.len() == N\"]",
                VERIFIED,
                Some("not among its checks"),
            ),
            (
                "leaves_out = [\"T5: fine\"]",
                VERIFIED,
                Some("not among the checks that are never reached: T5: fine"),
            ),
            (
                "leaves_out = [\"T5: fine\"]",
                unreached,
                Some("never reached: T5: one instance is enough"),
            ),
            ("leaves_out = [\"T5: fine\"]", PARTLY, None),
        ] {
            toy.write(
                "proofs/manifest.toml",
                &manifest.replace(own, &format!("{own}{line}\n")),
            );
            assert!(toy.run(&["table"]).status.success());
            install(&toy, proof, FAILED);
            let output = toy.run(&NAMES);
            assert_eq!(
                output.status.success(),
                objection.is_none(),
                "{}",
                out(&output)
            );
            assert!(
                out(&output).contains(objection.unwrap_or("2 of 2 as expected")),
                "{}",
                out(&output)
            );
        }
    }

    #[test]
    fn flags_in_the_environment_are_refused() {
        let toy = Toy::new("environment");
        install(&toy, VERIFIED, FAILED);
        for name in [
            "KANIFLAGS",
            "CARGO_PROFILE_DEV_OVERFLOW_CHECKS",
            "CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_RUSTFLAGS",
        ] {
            let output = toy.command(&NAMES).env(name, "false").output().unwrap();
            assert_eq!(output.status.code(), Some(2));
            assert!(
                out(&output).contains(&format!("{name} is set, and changes what Kani proves")),
                "{}",
                out(&output)
            );
        }
        assert!(!toy.root.join("bin/arguments").exists());
    }

    /// Part of what `check` says about a row; empty if it has a result on this source.
    fn standing(toy: &Toy, name: &str) -> String {
        let output = toy.run(&["check"]);
        assert_eq!(output.status.code(), Some(0), "{}", out(&output));
        let stale = format!("STALE: {name} (");
        out(&output)
            .lines()
            .find_map(|line| line.strip_prefix(&stale))
            .unwrap_or_default()
            .to_owned()
    }

    /// File, text in it, replacement, and whether the result of a harness of `channel` is stale
    /// then.
    const EDITS: &str = r#"core/src/control/channel.rs ~ //! ~ //! Words. ~ current
core/src/control/channel.rs ~ let rest = self.value.unsigned_abs(); ~ let rest =\n self.value\n .unsigned_abs(); // Words. ~ current
core/src/control/channel.rs ~ mod tests { ~ mod tests {\nconst NEW: u32 = 0; ~ current
core/src/model/lu.rs ~ \nuse ~ \nuse core::any as _;\nuse ~ current
core/src/control/position_loop/terms.rs ~ \nuse ~ \nuse core::any as _;\nuse ~ current
core/src/control/pacer.rs ~ \nuse ~ \nuse core::any as _;\nuse ~ current
core/src/verification/position_loop.rs ~ pub use ~ use core::any as _;\npub use ~ current
core/Cargo.toml ~ default = ["model", "position-loop", "keyed", "pacer"] ~ default = ["position-loop", "model", "keyed"] ~ current
core/Cargo.toml ~ position-loop = [] ~ position-loop = ["model"] ~ current
proofs/src/properties/session.rs ~ \nuse ~ \nuse core::any as _;\nuse ~ current
proofs/src/harness/wire.rs ~ \nuse ~ \nuse core::any as _;\nuse ~ current
proofs/manifest.toml ~ theorems = ["T10"] ~ theorems = ["T10", "T9"] ~ current
proofs/mutants.toml ~ new = "within_step, true)" ~ new = "within_step, false)" ~ current
Cargo.lock ~ name = "clap" ~ name = "clasp" ~ current
core/src/control/channel.rs ~ \nuse ~ \nuse core::any as _;\nuse ~ stale
core/src/units.rs ~ \nuse ~ \nuse core::any as _;\nuse ~ stale
proofs/src/properties/channel.rs ~ "T5: the measure decreases" ~ "T5: it decreases" ~ stale
proofs/src/harness/channel.rs ~ [minisat] ~ [kissat] ~ stale
proofs/src/harness.rs ~ kani::assume($condition); ~ kani::assume(true); ~ stale
proofs/src/properties.rs ~ pub mod axis; ~ use core::any as _;\npub mod axis; ~ stale
proofs/manifest.toml ~ theorems = ["T5"] ~ theorems = ["T5", "T1"] ~ stale
proofs/manifest.toml ~ never past it; the magnitude ~ never past it; the size ~ stale
Cargo.toml ~ opt-level = 1 ~ opt-level = 2 ~ stale
core/Cargo.toml ~ heapless = "0.8" ~ heapless = "0.8.0" ~ stale
core/Cargo.toml ~ default = ["model", "position-loop", "keyed", "pacer"] ~ default = ["position-loop", "keyed", "pacer"] ~ stale
core/Cargo.toml ~ [dependencies] ~ [lib]\npath = "src/lib.rs"\n\n[dependencies] ~ stale
proofs/Cargo.toml ~ features = ["model", "verification"] ~ features = ["model", "std", "verification"] ~ stale
.cargo/config.toml ~ [build] ~ [build]\nrustflags = ["--cfg", "other"] ~ stale
Cargo.lock ~ name = "heapless"\nversion = "0.8 ~ name = "heapless"\nversion = "0.9 ~ stale"#;

    /// As [`EDITS`], of a harness of `position_loop`: a wing of core counts for the rows that name
    /// it.
    const EDITS_OF_A_WING: &str = r#"core/src/model/lu.rs ~ \nuse ~ \nuse core::any as _;\nuse ~ current
core/src/control/channel.rs ~ \nuse ~ \nuse core::any as _;\nuse ~ stale
core/src/control/position_loop/terms.rs ~ \nuse ~ \nuse core::any as _;\nuse ~ stale
core/src/verification/position_loop.rs ~ pub use ~ use core::any as _;\npub use ~ stale
core/Cargo.toml ~ default = ["model", "position-loop", "keyed", "pacer"] ~ default = ["model", "keyed", "pacer"] ~ stale
core/Cargo.toml ~ position-loop = [] ~ position-loop = ["model"] ~ stale"#;

    /// An edit makes a result stale if the verdict may depend on it; `check` names the row, and
    /// `--strict` fails.
    #[test]
    fn a_stale_row_is_named() {
        let of_the_wing = "recorded verified | sed 's/T5/T20/'";
        for (toy, proof, name, edits) in [
            (Toy::new("stale"), VERIFIED, NAMES[1], EDITS),
            (
                Toy::new("stale_wing"),
                of_the_wing,
                "position_loop_error_is_exact",
                EDITS_OF_A_WING,
            ),
        ] {
            install(&toy, proof, FAILED);
            assert!(toy.run(&["prove", name]).status.success());
            assert_eq!(standing(&toy, name), "");
            for case in edits.lines() {
                let case = case.replace("\\n", "\n");
                let cells: Vec<&str> = case.split(" ~ ").collect();
                let [file, from, to, is] = cells[..] else {
                    panic!("{case}")
                };
                let text = toy.read(file);
                assert!(text.contains(from), "{file}: {from}");
                toy.write(file, &text.replacen(from, to, 1));
                // The page repeats parts of the manifest; it does not change with the sources.
                if file.ends_with(".toml") {
                    let table = toy.run(&["table"]);
                    assert!(table.status.success(), "{}", out(&table));
                }
                let said = standing(&toy, name);
                assert_eq!(
                    said,
                    if is == "stale" {
                        "ran on other sources)"
                    } else {
                        ""
                    },
                    "{name}: {case}"
                );
                toy.write(file, &text);
            }
        }
    }

    /// A harness and its mutant survive another format of the file that the mutant changes; the
    /// fault still applies.
    #[test]
    fn a_format_leaves_results_alone() {
        let toy = Toy::new("format");
        install(&toy, VERIFIED, FAILED);
        assert!(toy.run(&NAMES).status.success());
        let file = "core/src/control/channel.rs";
        let original = toy.read(file);
        toy.write(
            file,
            &original.replace(
                "self.value.unsigned_abs();",
                "self\n.value\n.unsigned_abs(\n);",
            ),
        );
        assert_eq!(
            NAMES[1..]
                .iter()
                .map(|name| standing(&toy, name))
                .collect::<String>(),
            ""
        );
        assert!(toy.run(&["prove", NAMES[2]]).status.success());
        assert!(
            toy.read(&format!("target/kani/copy/{file}"))
                .contains("let rest = u32::MAX;")
        );
        let mutants = toy.read("proofs/mutants.toml");
        toy.write(
            "proofs/mutants.toml",
            &mutants.replace("let rest = u32::MAX;", "let rest = u32::MIN;"),
        );
        assert_eq!(standing(&toy, NAMES[1]), "");
        assert_eq!(standing(&toy, NAMES[2]), "ran on other sources)");
    }

    #[test]
    fn a_source_that_does_not_parse_is_named() {
        let toy = Toy::new("unparsed");
        toy.write("core/src/units.rs", "fn");
        let output = toy.run(&["check"]);
        assert_eq!(output.status.code(), Some(1));
        assert!(
            out(&output).contains("core/src/units.rs: does not parse: "),
            "{}",
            out(&output)
        );
    }

    /// The feature of a wing gates a module of its own, which can be left out of the others' rows.
    #[test]
    fn a_wing_is_a_module() {
        let toy = Toy::new("wing");
        for feature in ["model", "pacer", "position-loop"] {
            let file = "core/src/control/channel.rs";
            let text = toy.read(file);
            toy.write(
                file,
                &format!("{text}#[cfg(feature = \"{feature}\")]\nconst NEW: u32 = 0;\n"),
            );
            let output = toy.run(&["check"]);
            assert_eq!(output.status.code(), Some(1), "{}", out(&output));
            let said = format!(
                "channel.rs: depends on the feature `{feature}`, which results of others do not"
            );
            assert!(out(&output).contains(&said), "{}", out(&output));
            toy.write(file, &text);
        }
    }

    /// Rest of the row of a harness or mutant in the page of results.
    fn shown(toy: &Toy, name: &str) -> String {
        let page = toy.read("proofs/RESULTS.md");
        let row = page.lines().find_map(|line| {
            line.strip_prefix(&format!("| `{name}` | "))?
                .strip_suffix(" |")
        });
        row.unwrap_or_default().to_owned()
    }

    /// The page never says "proved" of a theorem with a stale row, and development goes on: `check`
    /// still succeeds.
    #[test]
    fn stale_is_not_proved() {
        let toy = Toy::new("unproved");
        install(&toy, VERIFIED, FAILED);
        assert!(toy.run(&NAMES).status.success());
        assert_eq!(
            shown(&toy, NAMES[1]),
            "T5 | fast | minisat | 0.1 | verified"
        );
        assert!(
            shown(&toy, NAMES[2]).ends_with("| fast | caught"),
            "{}",
            shown(&toy, NAMES[2])
        );
        assert!(
            toy.read("proofs/RESULTS.md")
                .contains("On this source 1 of ")
        );
        let units = toy.read("core/src/units.rs");
        toy.write(
            "core/src/units.rs",
            &format!("{units}const NEW: u32 = 0;\n"),
        );
        // The page shows what was so before.
        assert_eq!(standing(&toy, NAMES[1]), "ran on other sources)");
        assert!(toy.run(&["table"]).status.success());
        assert_eq!(shown(&toy, NAMES[1]), "T5 | fast | minisat |  | stale");
        assert!(
            shown(&toy, NAMES[2]).ends_with("| fast | stale"),
            "{}",
            shown(&toy, NAMES[2])
        );
        assert_eq!(standing(&toy, NAMES[1]), "ran on other sources)");
        let page = toy.read("proofs/RESULTS.md");
        let theorem = page
            .split("- **T5**")
            .nth(1)
            .unwrap()
            .split("- **T6**")
            .next()
            .unwrap();
        assert!(theorem.contains("not proved on this source"), "{theorem}");
        assert_eq!(theorem.matches("proved").count(), 1, "{theorem}");
        // As it was.
        toy.write("core/src/units.rs", &units);
        assert_eq!(standing(&toy, NAMES[1]), "");
        assert_eq!(toy.run(&["check", "--strict"]).status.code(), Some(5));
    }

    /// Later runs replace their own rows only; a failure is a result, and counts as none.
    #[test]
    fn a_failed_run_is_merged() {
        let toy = Toy::new("merged");
        install(&toy, VERIFIED, FAILED);
        assert!(toy.run(&NAMES).status.success());
        let written = toy.read("proofs/results.json");
        let mutant = row(&toy, NAMES[2]);
        install(
            &toy,
            "recorded verified | sed 's/Time: 0.0/Time: 9.0/'",
            FAILED,
        );
        assert!(toy.run(&NAMES).status.success());
        assert_eq!(
            toy.read("proofs/results.json"),
            written,
            "the same result: the file stays as it is"
        );
        install(&toy, FAILED, FAILED);
        assert_eq!(toy.run(&NAMES[..2]).status.code(), Some(1));
        assert_eq!(row(&toy, NAMES[2]), mutant);
        let failed = row(&toy, NAMES[1]);
        assert_eq!(failed["verdict"], "failed");
        assert_eq!(failed["objection"], "failed: T5: never past zero");
        assert_eq!(
            standing(&toy, NAMES[1]),
            "failed: failed: T5: never past zero)"
        );
        assert_eq!(shown(&toy, NAMES[1]), "T5 | fast | minisat |  | failed");
        // Nothing else is left to prove of the two.
        let output = toy.run(&[&NAMES[..], &["--stale"]].concat());
        assert!(
            out(&output).contains("[1/1] channel_ramp_is_exact"),
            "{}",
            out(&output)
        );
    }

    /// A result belongs to the sources before the run: if they change meanwhile, there is none.
    #[test]
    fn sources_that_change_meanwhile_give_no_result() {
        let toy = Toy::new("meanwhile");
        install(
            &toy,
            &format!("echo 'const NEW: u32 = 0;' >>$root/core/src/units.rs; {VERIFIED}"),
            FAILED,
        );
        let output = toy.run(&NAMES[..2]);
        assert_eq!(output.status.code(), Some(1));
        assert!(
            out(&output).contains("the sources changed while it ran"),
            "{}",
            out(&output)
        );
        assert_eq!(row(&toy, NAMES[1])["verdict"], "failed");
    }

    /// Texts behind a key in a file of the proofs.
    fn texts(toy: &Toy, key: &str, path: &str) -> Vec<String> {
        let text = toy.read(path);
        let lines = text.lines().filter_map(|line| line.strip_prefix(key));
        lines
            .flat_map(|line| {
                line.split('"')
                    .skip(1)
                    .step_by(2)
                    .map(str::to_owned)
                    .collect::<Vec<_>>()
            })
            .collect()
    }

    fn strict(toy: &Toy) -> Output {
        toy.run(&["check", "--strict"])
    }

    /// With a result of every row `--strict` succeeds, until a page claims more, or the source
    /// changes.
    #[test]
    fn strict_wants_every_row() {
        let toy = Toy::new("strict");
        // One output for all rows reaches every check.
        let manifest = toy.read("proofs/manifest.toml");
        let reached = manifest
            .lines()
            .filter(|line| !line.starts_with("leaves_out"));
        toy.write(
            "proofs/manifest.toml",
            &reached.map(|line| format!("{line}\n")).collect::<String>(),
        );
        assert!(toy.run(&["table"]).status.success());
        let check = "Check 9: x.assertion.1\n\t - Status: STATUS\n\t - Description: \"\"TEXT\"\"\n\t - Location: proofs/src/x.rs:1:1 in function x\n";
        let of_theorems = |status: &str| -> String {
            let numbers = 1..=33;
            let texts = numbers.map(|number| check.replace("TEXT", &format!("T{number}: all")));
            texts.map(|check| check.replace("STATUS", status)).collect()
        };
        let theorems = of_theorems("SUCCESS");
        let required: String = texts(&toy, "requires = ", "proofs/manifest.toml")
            .iter()
            .map(|text| check.replace("STATUS", "SUCCESS").replace("TEXT", text))
            .collect();
        let fails: String = texts(&toy, "fails = ", "proofs/mutants.toml")
            .iter()
            .map(|text| check.replace("STATUS", "FAILURE").replace("TEXT", text))
            .collect();
        let quoted: String = texts(&toy, "  (* says: ", "proofs/composition/Rows.v")
            .iter()
            .map(|text| check.replace("STATUS", "SUCCESS").replace("TEXT", text))
            .collect();
        toy.write("bin/holds", &format!("{theorems}{required}{quoted}"));
        toy.write("bin/fails", &fails);
        install(
            &toy,
            "recorded verified; cat $root/bin/holds",
            "recorded failed; cat $root/bin/fails; exit 1",
        );
        let output = toy.run(&["prove", "--tier", "full"]);
        assert!(output.status.success(), "{}", out(&output));
        // What no mutant makes fail may be a check of nothing.
        let said = out(&strict(&toy));
        assert_eq!(strict(&toy).status.code(), Some(5), "{said}");
        assert!(
            said.contains("UNTRIED: \"T5: all\" of ") && !said.contains("STALE"),
            "{said}"
        );
        assert_eq!(toy.run(&["check"]).status.code(), Some(0));
        let mut required = format!("{required}{quoted}").replace("SUCCESS", "FAILURE");
        for text in ["T5: fine", "T5: one instance is enough"] {
            required += &check.replace("STATUS", "FAILURE").replace("TEXT", text);
        }
        toy.write(
            "bin/fails",
            &format!("{fails}{required}{}", of_theorems("FAILURE")),
        );
        let output = toy.run(&["prove", NAMES[2]]);
        assert!(output.status.success(), "{}", out(&output));
        assert_eq!(
            strict(&toy).status.code(),
            Some(0),
            "{}",
            out(&strict(&toy))
        );
        toy.write(
            "README.md",
            "| bounds | T2 to T4. Proved at one axis |\n| others | T10: proved |\n",
        );
        let guarantees = "# Bounds\n\nT10: proved.\n\n- T5 is\n  proved.\n- T1: not proved.\n\nThe bounds (T2)\nare proved.\n";
        toy.write("docs/guarantees.md", guarantees);
        assert_eq!(
            strict(&toy).status.code(),
            Some(0),
            "{}",
            out(&strict(&toy))
        );
        // A quotation of another text than the row has.
        let rows = toy.read("proofs/composition/Rows.v");
        let (stands, other) = (
            "T9: what stands has not stepped",
            "T5: the measure decreases",
        );
        toy.write("proofs/composition/Rows.v", &rows.replace(stands, other));
        let said = out(&strict(&toy));
        assert!(
            said.contains(
                "whose property has no line \"Composed as: `nominal_that_stands_is_within`.\""
            ),
            "{said}"
        );
        let property = "proofs/src/properties/channel.rs";
        let source = toy.read(property);
        toy.write(
            property,
            &source.replace(
                "Composed as: ",
                "Composed as: `nominal_that_stands_is_within`, ",
            ),
        );
        let said = out(&strict(&toy));
        assert!(
            said.contains(
                "STALE: nominal_that_stands_is_within (its axiom quotes \"T5: the measure"
            ) && said.contains("STALE: composition (Coq has not"),
            "{said}"
        );
        toy.write("proofs/composition/Rows.v", &rows);
        // Rows of T1, T2, T3 and T5.
        let harnesses = "proofs/src/harness/axis.rs";
        toy.write(
            harnesses,
            &format!("{}const NEW: u32 = 0;\n", toy.read(harnesses)),
        );
        let said = out(&strict(&toy));
        assert_eq!(strict(&toy).status.code(), Some(5), "{said}");
        assert!(
            said.contains("STALE: axis_shadow_is_bounded (ran on other sources)"),
            "{said}"
        );
        assert!(
            // T4 of runs rests on the rows of an axis.
            said.contains("README.md:1: says \"proved\" of T2, T3, T4, which"),
            "{said}"
        );
        assert!(!said.contains("README.md:2"), "{said}");
        assert!(
            said.contains("docs/guarantees.md:5: says \"proved\" of T5, which"),
            "{said}"
        );
        assert!(
            said.contains("docs/guarantees.md:9: says \"proved\" of T2, which"),
            "{said}"
        );
        assert_eq!(said.matches("docs/guarantees.md:").count(), 2, "{said}");
        assert!(
            toy.run(&["prove", "--stale", "--tier", "full"])
                .status
                .success()
        );
        // The harness and its mutants, twice.
        let name = "axis_shadow_is_bounded";
        let mutants = texts(&toy, "harness = ", "proofs/mutants.toml")
            .iter()
            .filter(|harness| *harness == name)
            .count();
        assert_eq!(
            toy.read("bin/arguments").matches(name).count(),
            2 * (1 + mutants)
        );
        assert_eq!(
            strict(&toy).status.code(),
            Some(0),
            "{}",
            out(&strict(&toy))
        );
        // Of the profile that Kani builds with, what the linker does is no part of a row.
        let workspace = toy.read("Cargo.toml");
        for (line, changed, is_stale) in [
            ("\nlto = \"off\"\n", "\nlto = \"fat\"\n", false),
            ("\nopt-level = 1\n", "\nopt-level = 3\n", true),
        ] {
            assert!(workspace.contains(line), "{line}");
            toy.write("Cargo.toml", &workspace.replacen(line, changed, 1));
            let said = out(&strict(&toy));
            assert_eq!(said.contains("(ran on other sources)"), is_stale, "{said}");
        }
        toy.write("Cargo.toml", &workspace);
        let interface = "host/capi/src/memory.rs";
        toy.write(
            interface,
            &format!("{}const NEW: u32 = 0;\n", toy.read(interface)),
        );
        let said = out(&strict(&toy));
        assert!(
            said.contains("STALE: capi_pointer_is_judged (ran on other sources)"),
            "{said}"
        );
        assert!(!said.contains("STALE: channel"), "{said}");
    }

    /// Behaviour of a solver: it goes on alone when Kani is killed.
    const ENDLESS: &str = "echo 'Checking harness x...'; sleep 600 & echo $! > ${0%/*}/pid; wait";

    fn wait_until(what: &str, is_so: impl Fn() -> bool) {
        let began = Instant::now();
        while !is_so() {
            assert!(
                began.elapsed() < Duration::from_secs(60),
                "not so in a minute: {what}"
            );
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// The solver goes. A zombie stays if no parent waits for it.
    fn assert_solver_goes(toy: &Toy) {
        let pid = toy.read("bin/pid");
        wait_until("the solver is gone", || {
            let state = Command::new("/bin/ps")
                .args(["-o", "stat=", "-p", pid.trim()])
                .output()
                .unwrap();
            state.stdout.trim_ascii().is_empty() || state.stdout.trim_ascii().starts_with(b"Z")
        });
    }

    #[test]
    fn a_proof_that_takes_too_long_is_ended() {
        let toy = Toy::new("timeout");
        install(&toy, ENDLESS, FAILED);
        let output = toy.run(&[&NAMES[..], &["--seconds", "0.5"]].concat());
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
        let output = toy.run(&[&NAMES[..], &["--build-minutes", "0"]].concat());
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
        let mut child = toy.command(&NAMES).spawn().unwrap();
        let pid = toy.root.join("bin/pid");
        wait_until("the solver runs", || {
            std::fs::read_to_string(&pid).is_ok_and(|pid| pid.ends_with('\n'))
        });
        Command::new("/bin/kill")
            .arg(child.id().to_string())
            .status()
            .unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(1));
        assert_solver_goes(&toy);
    }
}
