//! The commands of the Markdown pages, as they are printed, in order, in an empty folder.
//!
//! | block | meaning |
//! |---|---|
//! | `sh` | each command ends by itself, with exit code 0 or the one that its comment names (`# exit code 3`) |
//! | `sh terminal` | one command in a terminal of its own: it runs until the end of the section, where Ctrl-C ends it, with the exit code as above |
//! | `sh elsewhere` | not run here: [`ELSEWHERE`] has the reason |
//! | `text` behind one of them | lines of the output of the last command; `...` stands for anything |
//! | `toml FILE`, `csv FILE` | a file that the page asks to save |
//!
//! With `repository` behind `sh` the folder has the files of the repository. A section ends at the
//! next heading.

use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use rustix::fs::{FlockOperation, flock};

use crate::process::{self, BINARY, Folder, Running};

/// Root of the repository.
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// Names of languages of shells. Pages use `sh`.
const SHELLS: [&str; 6] = ["sh", "bash", "console", "shell", "zsh", "powershell"];

/// First words of a command.
const PROGRAMS: [&str; 9] = [
    "gantry-tau",
    "cargo",
    "sudo",
    "make",
    "python3",
    "gcc",
    "git",
    "cd",
    "echo",
];

/// Returns a lock on the default addresses, which the pages print: one page at a time, also of
/// another run of these tests.
fn lock_ports() -> File {
    let folder = File::open(std::env::temp_dir()).unwrap();
    flock(&folder, FlockOperation::LockExclusive).unwrap();
    folder
}

/// A part of a page.
enum Part {
    Heading,
    Fenced(Block),
    Prose(String),
}

/// A fenced block.
struct Block {
    language: String,
    /// Behind the language.
    words: Vec<String>,
    text: String,
}

impl Block {
    fn is(&self, word: &str) -> bool {
        self.words.iter().any(|have| have == word)
    }

    fn is_run(&self) -> bool {
        self.language == "sh" && !self.is("elsewhere")
    }

    /// Returns the commands, without comments; a backslash continues a line.
    fn commands(&self) -> Vec<String> {
        let joined = self.text.replace("\\\n", " ");
        let lines = joined.lines().map(str::trim);
        lines
            .filter(|line| !line.is_empty() && !line.starts_with('#'))
            .map(str::to_owned)
            .collect()
    }
}

/// Returns headings, blocks and lines of prose of a page. Blank lines are left out.
fn parts(page: &str) -> Vec<Part> {
    let mut found = Vec::new();
    let mut lines = page.lines();
    while let Some(line) = lines.next() {
        if let Some(info) = line.trim_start().strip_prefix("```") {
            let indent = line.len() - line.trim_start().len();
            let mut words = info.split_whitespace().map(str::to_owned);
            let language = words.next().unwrap_or_default();
            let text = lines
                .by_ref()
                .take_while(|line| line.trim() != "```")
                .map(|line| format!("{}\n", line.get(indent..).unwrap_or_default()))
                .collect();
            found.push(Part::Fenced(Block {
                language,
                words: words.collect(),
                text,
            }));
        } else if line.starts_with('#') {
            found.push(Part::Heading);
        } else if !line.trim().is_empty() {
            found.push(Part::Prose(line.to_owned()));
        }
    }
    found
}

fn read(page: &str) -> Vec<Part> {
    parts(&std::fs::read_to_string(Path::new(ROOT).join(page)).unwrap())
}

/// True if the output has the lines, in their order.
fn shows(output: &str, lines: &str) -> bool {
    let mut rest = output;
    lines
        .lines()
        .flat_map(|line| line.split("..."))
        .all(|piece| {
            rest.split_once(piece.trim()).is_some_and(|(_, after)| {
                rest = after;
                true
            })
        })
}

/// Returns the exit code that the comment of a command names.
fn exit_code(command: &str) -> i32 {
    let named = command
        .split_once("exit code ")
        .map(|(_, code)| code.trim().parse().unwrap());
    named.unwrap_or(0)
}

/// A reader at work: a folder, and terminals in it.
struct Walk {
    folder: Folder,
    /// With their exit codes.
    terminals: Vec<(Running, i32)>,
    /// Commands so far.
    count: usize,
}

impl Walk {
    fn start(&mut self, command: &str) -> Running {
        self.count += 1;
        let programs = Path::new(BINARY).parent().unwrap().display().to_string();
        let path = format!("{programs}:{}", std::env::var("PATH").unwrap_or_default());
        let mut shell = process::command("sh");
        shell
            .args(["-c", command])
            .env("PATH", path)
            .env("PYTHONDONTWRITEBYTECODE", "1");
        self.folder
            .start_command(&format!("terminal-{}", self.count), shell, Stdio::null())
    }

    /// Runs the commands of a block; `shown` is the output of the last one.
    fn run(&mut self, block: &Block, shown: &str) {
        if block.is("repository") {
            self.link_repository();
        }
        let mut said = String::new();
        for command in block.commands() {
            if block.is("terminal") {
                // The signal is for the command, not for its shell.
                let mut terminal = self.start(&format!("exec {command}"));
                let what = format!("`{command}` does not show\n{shown}");
                assert!(!shown.is_empty(), "`{command}`: a terminal shows something");
                terminal.await_that(&what, |terminal| shows(&terminal.said(), shown));
                self.terminals.push((terminal, exit_code(&command)));
                return;
            }
            let ended = self.start(&command).end();
            said = format!("{}\n{}", ended.stdout, ended.stderr);
            assert_eq!(ended.code, Some(exit_code(&command)), "`{command}`: {said}");
        }
        assert!(
            shows(&said, shown),
            "{}does not show\n{shown}\nbut\n{said}",
            block.text
        );
    }

    /// Ends what runs in the terminals, the newest first.
    fn end_section(&mut self) {
        while let Some((terminal, code)) = self.terminals.pop() {
            let ended = terminal.stop();
            assert_eq!(ended.code, Some(code), "{}{}", ended.stdout, ended.stderr);
        }
    }

    fn link_repository(&self) {
        for entry in std::fs::read_dir(ROOT).unwrap() {
            let entry = entry.unwrap();
            let link = self.folder.path(&entry.file_name().to_string_lossy());
            if !link.exists() && entry.file_name() != "target" {
                let target = entry.path().canonicalize().unwrap();
                std::os::unix::fs::symlink(target, link).unwrap();
            }
        }
    }
}

/// Runs the commands of a page.
fn run(page: &str) {
    let _alone = lock_ports();
    let mut walk = Walk {
        folder: Folder::new("docs"),
        terminals: Vec::new(),
        count: 0,
    };
    let parts = read(page);
    let uses_python = parts.iter().any(|part| match part {
        Part::Fenced(block) => block.is_run() && block.text.contains("python3 "),
        _ => false,
    });
    if uses_python && Command::new("python3").arg("--version").output().is_err() {
        let required = std::env::var_os("GANTRY_TAU_REQUIRE_PYTHON").is_some();
        assert!(!required, "{page}: python3 is missing");
        eprintln!("{page}: not run, python3 is missing");
        return;
    }
    for (part, next) in parts
        .iter()
        .zip(parts.iter().skip(1).map(Some).chain([None]))
    {
        match part {
            Part::Heading => walk.end_section(),
            Part::Prose(_) => {}
            Part::Fenced(block) if block.is_run() => {
                let shown = match next {
                    Some(Part::Fenced(next)) if next.language == "text" => &next.text,
                    _ => "",
                };
                walk.run(block, shown);
            }
            Part::Fenced(block) if matches!(block.language.as_str(), "toml" | "csv") => {
                if let Some(name) = block.words.first() {
                    walk.folder.write(name, &block.text);
                }
            }
            Part::Fenced(_) => {}
        }
    }
    walk.end_section();
}

/// A test for each page.
macro_rules! pages {
    ($($name:ident: $path:literal;)*) => {
        $(#[test] fn $name() { run($path); })*

        /// Pages with commands that are run.
        const PAGES: &[&str] = &[$($path),*];
    };
}

pages! {
    cli: "docs/cli.md";
    dynamics: "docs/dynamics.md";
    identification: "docs/identification.md";
    python: "host/python/README.md";
    readme: "README.md";
    robot_file: "docs/robot-file.md";
    simulators: "docs/simulators.md";
    slow_programs: "docs/slow-programs.md";
    tutorial: "docs/tutorial.md";
}

/// Blocks that are not run here: page, beginning of the first command, reason and where they are run.
const ELSEWHERE: &[[&str; 3]] = &[
    [
        "CONTRIBUTING.md",
        "cargo test",
        "builds the workspace: `.ci/run`, but for `cargo demo`",
    ],
    [
        "CONTRIBUTING.md",
        r#"cargo install --locked kani-verifier --version "$(cat proofs/kani-version)" && cargo kani setup"#,
        "installs Kani: `.github/workflows/proofs.yml`",
    ],
    [
        "CONTRIBUTING.md",
        "cargo fmt --all --check",
        "builds the workspace: `.ci/run`",
    ],
    [
        "CONTRIBUTING.md",
        "cargo run -p gantry-tau-proofs -- check --compile",
        "names of a new theorem, and Kani: nowhere as printed; the runner's commands in `proofs/tests/it`",
    ],
    [
        "README.md",
        "cargo run --release -p gantry-tau -- demo",
        "builds the workspace: `.ci/run`, the demo shortened",
    ],
    [
        "README.md",
        "cargo install --path host/cli",
        "builds and installs the program: `.ci/run`, into a folder",
    ],
    [
        "docs/ethercat.md",
        "cargo install --path host/cli --features ethercat",
        "builds and installs the program: nowhere; `.ci/package` builds with this feature",
    ],
    [
        "docs/ethercat.md",
        "gantry-tau serve --plan plan.toml --pace lockstep",
        "needs a program with EtherCAT: `host/cli/tests/it/gauges.rs`, on ports that are free",
    ],
    [
        "docs/ethercat.md",
        "gantry-tau bus scan emulated",
        "needs a program with EtherCAT: `host/cli/tests/it/golden.rs`, which records the output",
    ],
    [
        "docs/fmi.md",
        "pip install fmpy",
        "builds the library of the units, and needs fmpy: `tests/tests/tools/fmi/of_page.py`",
    ],
    [
        "docs/fmi.md",
        "cargo build --release -p gantry-tau-fmi-library",
        "builds the library of the units: `tests/tests/tools/fmi`, with other settings",
    ],
    [
        "docs/fmi.md",
        "gantry-tau fmu l2 --kind server",
        "needs the library of the units: `tests/tests/tools/fmi/of_page.py`",
    ],
    [
        "docs/cli.md",
        "gantry-tau fmu l2",
        "needs the library of the units: `tests/tests/tools/fmi/of_validity.py`",
    ],
    [
        "docs/python.md",
        "pip install maturin",
        "builds a wheel and installs it: `.ci/run`, with `tests/tests/tools/python/of_wheel.py`",
    ],
    [
        "docs/python.md",
        "gantry-tau serve --pace lockstep --quasi-static",
        "needs numpy: the same script",
    ],
    [
        "docs/python.md",
        "python3 host/python/examples/slow_compensation.py",
        "needs numpy: the same script, which runs the page's Python as well",
    ],
    [
        "docs/linuxcnc.md",
        "sudo apt-get install --no-install-recommends build-essential git linuxcnc-uspace linuxcnc-uspace-dev",
        "root and LinuxCNC: `make` in `.ci/run`, the modules in `tests/tests/tools/linuxcnc`",
    ],
    [
        "docs/linuxcnc.md",
        "make demo ROBOT=l2",
        "LinuxCNC: `tests/tests/tools/linuxcnc`",
    ],
    [
        "docs/linuxcnc.md",
        "make screen ROBOT=l2",
        "LinuxCNC and a display: `tests/tests/tools/linuxcnc`",
    ],
    [
        "docs/security.md",
        "gantry-tau key new machine.key",
        "two computers: with one, in `docs/cli.md`",
    ],
    [
        "docs/security.md",
        "cargo build --release -p gantry-tau",
        "root and systemd: nowhere as printed; the unit in `tests/tests/tools/service`",
    ],
    [
        "fuzz/README.md",
        "rustup toolchain install nightly && cargo install cargo-fuzz --locked",
        "nightly Rust: `.ci/run`",
    ],
    [
        "fuzz/README.md",
        "fuzz/coverage.sh",
        "llvm-cov of rustc's version: nowhere",
    ],
    [
        "host/capi/README.md",
        "cargo build --release --manifest-path host/capi/Cargo.toml",
        "builds the library: `tests/tests/tools/capi`",
    ],
    [
        "host/capi/README.md",
        "cd host/capi",
        "a C compiler: `tests/tests/tools/capi`",
    ],
    [
        "host/capi/README.md",
        "gcc -std=c99 -O2 -Wall -Iinclude examples/session.c",
        "a C compiler: `tests/tests/tools/capi/recipes.rs`, as printed",
    ],
    [
        "host/capi/README.md",
        "echo '{ global: gt_*; local: *; };' > gt.map",
        "a C compiler: `tests/tests/tools/capi/recipes.rs`, as printed",
    ],
    [
        "host/capi/README.md",
        r#"python3 -c "import ctypes;"#,
        "the shared library: `tests/tests/tools/capi/recipes.rs`, as printed",
    ],
    [
        "host/linuxcnc/README.md",
        "sudo apt-get install --no-install-recommends linuxcnc-uspace linuxcnc-uspace-dev",
        "root and LinuxCNC: `make` in `.ci/run`, the rest in `tests/tests/tools/linuxcnc`",
    ],
    [
        "proofs/README.md",
        r#"cargo install --locked kani-verifier --version "$(cat proofs/kani-version)" && cargo kani setup"#,
        "Kani: `.github/workflows/proofs.yml`",
    ],
    [
        "tests/firmware/README.md",
        "tests/firmware/build.sh check",
        "a cross compiler and QEMU: `tests/tests/tools/firmware`",
    ],
    [
        "proofs/composition.md",
        "apt-get install --no-install-recommends coq",
        "installs Coq: `.ci/run`, and the trial `composition::is_checked_by_coq`; the full tier nowhere",
    ],
    [
        "docs/simulators.md",
        "pip install mujoco",
        "needs MuJoCo: the trial engines::mujoco_is_the_machine_of_a_server",
    ],
];

/// Returns the Markdown pages below a folder of the repository.
fn pages_below(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        let name = entry.file_name().to_string_lossy().into_owned();
        let path = entry.path();
        if entry.file_type().unwrap().is_dir() {
            if name != "target" && !name.starts_with('.') {
                pages_below(&path, found);
            }
        } else if name.ends_with(".md") {
            found.push(path.strip_prefix(ROOT).unwrap().to_owned());
        }
    }
}

fn all_pages() -> Vec<String> {
    let mut found = Vec::new();
    pages_below(Path::new(ROOT), &mut found);
    let names = found.iter().map(|page| page.to_str().unwrap().to_owned());
    names.collect()
}

/// Returns the first line that looks like a command, but is not in a block of `sh`.
fn stray_command(part: &Part) -> Option<&str> {
    let (text, indent) = match part {
        Part::Prose(line) => (line, 4),
        Part::Fenced(block) if block.language.is_empty() => (&block.text, 0),
        _ => return None,
    };
    text.lines().find(|line| {
        let trimmed = line.trim_start();
        let first = trimmed.split_whitespace().next().unwrap_or_default();
        line.len() - trimmed.len() >= indent && (first == "$" || PROGRAMS.contains(&first))
    })
}

/// A front page of 1 000 words, and no line that a screen cannot show.
#[test]
fn pages_are_short_and_narrow() {
    for page in all_pages() {
        let text = std::fs::read_to_string(Path::new(ROOT).join(&page)).unwrap();
        let words = text.split_whitespace().count();
        assert!(
            page != "README.md" || words <= 1_000,
            "{page}: {words} words"
        );
        let long = text.lines().find(|line| line.chars().count() > 200);
        assert_eq!(long, None, "{page}");
    }
}

/// Every block of commands in the repository is run, or stands in [`ELSEWHERE`].
#[test]
fn every_page_is_run() {
    let mut run = BTreeSet::new();
    let mut elsewhere = Vec::new();
    for page in all_pages() {
        for part in read(&page) {
            let stray = stray_command(&part);
            assert_eq!(stray, None, "{page}: a command outside of a block of sh");
            let Part::Fenced(block) = part else { continue };
            if !SHELLS.contains(&block.language.as_str()) {
                continue;
            }
            assert_eq!(block.language, "sh", "{page}: {}", block.text);
            for word in &block.words {
                let known = ["terminal", "elsewhere", "repository"].contains(&word.as_str());
                assert!(known, "{page}: sh {word}");
            }
            if block.is("elsewhere") {
                let first = block.commands().first().cloned().unwrap_or_default();
                elsewhere.push((page.clone(), first));
            } else {
                run.insert(page.clone());
            }
        }
    }
    let listed = PAGES.iter().map(|page| (*page).to_owned()).collect();
    assert_eq!(run, listed, "pages with commands, and pages that are run");
    for [page, first, _] in ELSEWHERE {
        let before = elsewhere.len();
        elsewhere.retain(|(of, command)| of != page || !command.starts_with(first));
        assert_eq!(
            elsewhere.len() + 1,
            before,
            "{page}: {first}: not one block"
        );
    }
    assert_eq!(elsewhere, [], "blocks that are neither run nor listed");
}
