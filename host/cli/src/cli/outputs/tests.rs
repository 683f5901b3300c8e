//! Every option of every command that names a file is of a type with a policy, and every output
//! keeps to it.

use std::any::TypeId;
use std::ffi::OsString;
use std::{fmt, fs};

use clap::{ArgAction, Command, CommandFactory};

use super::super::Arguments;
use super::*;

/// Files of the state of a server, new keys, and folders, which have policies of their own.
const FOLDERS: [(&str, &str); 4] = [
    ("key new", "file"),
    ("serve", "epoch_file"),
    ("serve", "black_box"),
    ("man", "folder"),
];

/// Commands that do something, with the arguments that they need; `IN` is a file that is read.
const COMMANDS: [(&str, &[&str]); 35] = [
    ("demo", &["--client", "IN"]),
    ("serve", &["--robot", "IN"]),
    ("client", &["--robot", "IN"]),
    ("pace", &["--robot", "IN"]),
    ("key new", &["new"]),
    ("key show-id", &["IN"]),
    ("key export", &["IN", "--c"]),
    ("monitor", &["--robot", "IN"]),
    ("recover", &["IN"]),
    (
        "faults",
        &[
            "--listen",
            "127.0.0.1:1",
            "--to",
            "127.0.0.1:1",
            "--script",
            "IN",
        ],
    ),
    ("follow", &["--robot", "IN"]),
    ("replay", &["IN"]),
    ("robot check", &["IN"]),
    ("bus scan", &["emulated"]),
    ("gauges", &["emulated", "IN"]),
    ("workspace", &["--robot", "IN"]),
    ("stability", &["--robot", "IN"]),
    ("draw", &["--robot", "IN"]),
    ("header", &["--robot", "IN"]),
    ("export", &["--robot", "IN"]),
    ("fmu", &["--robot", "IN", "--kind", "server"]),
    ("labcomm decode", &["IN"]),
    ("labcomm encode", &["IN"]),
    ("labcomm schema", &["--robot", "IN"]),
    ("calibrate", &["IN", "--robot", "l2"]),
    ("identify", &["IN", "--robot", "l2"]),
    ("verify", &["IN", "--robot", "l2"]),
    ("plan springs", &["--robot", "l2", "--gauges", "IN"]),
    ("plan geometry", &["--robot", "IN"]),
    ("plan verify", &["--robot", "IN"]),
    ("plan check", &["IN", "--robot", "l2"]),
    ("experiment", &["IN"]),
    ("solve", &[]),
    ("completions", &["bash"]),
    ("man", &["folder"]),
];

/// Commands without others below them, by their names.
fn leaves(command: &Command, path: &str) -> Vec<(String, Command)> {
    if !command.has_subcommands() {
        return vec![(path.to_owned(), command.clone())];
    }
    let below = command
        .get_subcommands()
        .filter(|below| below.get_name() != "help");
    below
        .flat_map(|below| leaves(below, format!("{path} {}", below.get_name()).trim()))
        .collect()
}

/// Outputs of all commands: name of the command, and of the option as it is typed.
fn outputs() -> Vec<(String, String, TypeId)> {
    let types = [
        TypeId::of::<Output>(),
        TypeId::of::<RecordTo>(),
        TypeId::of::<ContinuedTable>(),
    ];
    let mut found = Vec::new();
    for (path, command) in leaves(&Arguments::command(), "") {
        for argument in command.get_arguments() {
            let of = argument.get_value_parser().type_id();
            if let Some(ty) = types.iter().find(|ty| of == **ty) {
                let short = argument.get_short().map(|short| format!("-{short}"));
                let long = argument.get_long().map(|long| format!("--{long}"));
                found.push((path.clone(), long.or(short).unwrap(), *ty));
            }
        }
    }
    found
}

#[test]
fn every_option_that_names_a_file_has_a_policy() {
    let types = [
        TypeId::of::<Output>(),
        TypeId::of::<RecordTo>(),
        TypeId::of::<ContinuedTable>(),
        TypeId::of::<InputFile>(),
        TypeId::of::<NamedInput>(),
    ];
    for (path, command) in leaves(&Arguments::command(), "") {
        assert!(
            COMMANDS.iter().any(|(name, _)| *name == path),
            "{path} is not in the table of this test"
        );
        let with_values = command
            .get_arguments()
            .filter(|argument| argument.get_action().takes_values());
        for argument in with_values {
            let of = argument.get_value_parser().type_id();
            let names = argument.get_value_names().unwrap_or_default().join(" ");
            let is_path = of == TypeId::of::<PathBuf>() || of == TypeId::of::<OsString>();
            // Words that stand in place of a path's name.
            let says_so = ["FILE", "FOLDER", "PLAN", "PAGE", "TABLE", ".csv", ".toml"]
                .iter()
                .any(|word| names.contains(word));
            let id = argument.get_id().as_str();
            if FOLDERS.contains(&(path.as_str(), id)) || !(is_path || says_so) {
                continue;
            }
            assert!(
                types.iter().any(|ty| of == *ty),
                "{path}: {id} <{names}> has no type of cli/outputs.rs"
            );
        }
    }
}

/// An output of a command, in a folder of its own.
struct Walk<'a> {
    folder: &'a Path,
    outputs: &'a [(String, String, TypeId)],
    path: &'a str,
    option: &'a str,
    /// True for an output that is written as a whole.
    is_whole: bool,
    /// Extension that the option takes.
    extension: &'static str,
}

impl<'a> Walk<'a> {
    fn new(
        folder: &'a Path,
        outputs: &'a [(String, String, TypeId)],
        (path, option, ty): &'a (String, String, TypeId),
    ) -> Self {
        let mut walk = Self {
            folder,
            outputs,
            path,
            option,
            is_whole: *ty == TypeId::of::<Output>(),
            extension: "",
        };
        walk.extension = [
            "toml", "html", "json", "csv", "svg", "mcap", "jsonl", "h", "fmu",
        ]
        .into_iter()
        .find(|extension| {
            let parsed = walk.parse(&format!("x.{extension}"));
            parsed.is_ok_and(|parsed| check(&parsed).is_ok())
        })
        .unwrap_or_else(|| panic!("{walk} takes no extension of this list"));
        walk
    }

    /// Path of a file in the folder.
    fn at(&self, name: &str) -> String {
        self.folder.join(name).to_str().unwrap().to_owned()
    }

    /// Path of a file with the output's extension.
    fn output(&self, stem: &str) -> String {
        self.at(&format!("{stem}.{}", self.extension))
    }

    /// Parses the command with the output `name`.
    fn parse(&self, name: &str) -> Result<ArgMatches, clap::Error> {
        let words = self
            .path
            .split(' ')
            .map(str::to_owned)
            .chain(["--overwrite".to_owned()]);
        let words = words.filter(|word| word != "--overwrite" || has_overwrite(self.path));
        let (_, given) = COMMANDS
            .iter()
            .find(|(name, _)| *name == self.path)
            .unwrap();
        let given = given.iter().map(|word| match *word {
            "IN" => self.at("in.toml"),
            // The folder that a command reads lies beside the others.
            "folder" => self.at("folder"),
            word => word.to_owned(),
        });
        // Other outputs that are needed.
        let needed = self.outputs.iter().filter(|(other, name, _)| {
            other == self.path && name != self.option && is_needed(self.path, name)
        });
        let needed = needed.flat_map(|(_, name, _)| [name.clone(), self.at("needed.toml")]);
        let all = words
            .chain(given)
            .chain(needed)
            .chain([self.option.to_owned(), self.at(name)]);
        let program = ["gantry-tau".to_owned()].into_iter();
        Arguments::command().try_get_matches_from(program.chain(all))
    }

    /// Checks the command with the output `stem`.
    fn check(&self, stem: &str) -> Result<(), WriteError> {
        let name = format!("{stem}.{}", self.extension);
        check(&self.parse(&name).unwrap())
    }

    /// Requires that a file with this text is kept, and refused by an output that replaces it.
    fn keeps(&self, what: &str, stem: &str, text: &str) {
        let file = self.output(stem);
        fs::write(&file, text).unwrap();
        let checked = self.check(stem);
        // A recording gets another name; a table is judged where its columns are known.
        assert!(
            checked.is_err() == (self.is_whole && !is_evidence(self.option)),
            "{self} {what}: {checked:?}"
        );
        assert_eq!(fs::read_to_string(&file).unwrap(), text, "{self} {what}");
        fs::remove_file(&file).unwrap();
    }

    /// Requires that the input is refused as the output, by its own name or another.
    fn keeps_its_input(&self) {
        if self.extension != "toml" {
            fs::hard_link(self.at("in.toml"), self.output("input")).unwrap();
            let error = self.check("input").unwrap_err().to_string();
            assert!(
                self.is_whole || error.contains("the same command reads this file"),
                "{self}: {error}"
            );
            fs::remove_file(self.output("input")).unwrap();
        }
        let checked = self.check("in");
        assert!(
            self.extension != "toml" || checked.is_err(),
            "{self} onto its input"
        );
    }

    /// Requires that a folder, a file in a missing folder and a read-only file are refused.
    fn requires_a_writable_file(&self) {
        fs::create_dir(self.output("dir")).unwrap();
        assert!(
            !self.is_whole || self.check("dir").is_err(),
            "{self} onto a folder"
        );
        fs::remove_dir(self.output("dir")).unwrap();
        assert!(
            !self.is_whole || self.check("no/such").is_err(),
            "{self} into a missing folder"
        );
        let file = self.output("read");
        fs::write(&file, "").unwrap();
        let mut read_only = fs::metadata(&file).unwrap().permissions();
        read_only.set_readonly(true);
        fs::set_permissions(&file, read_only).unwrap();
        let checked = self.check("read");
        assert!(
            !self.is_whole || is_evidence(self.option) || checked.is_err(),
            "{self} onto a read-only file"
        );
        fs::remove_file(&file).unwrap();
    }
}

impl fmt::Display for Walk<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.path, self.option)
    }
}

/// The walk: each output of each command onto an input, onto measured and foreign files, a folder,
/// a read-only file, into no folder.
#[test]
fn every_output_of_every_command_keeps_to_the_policy() {
    let folder = std::env::temp_dir().join(format!("gantry-tau-walk-{}", std::process::id()));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    let outputs = outputs();
    assert!(outputs.len() >= 29, "{outputs:#?}");
    for output in &outputs {
        let walk = Walk::new(&folder, &outputs, output);
        fs::write(
            walk.at("in.toml"),
            "model = \"l2\"\nmeasurements = \"table.csv\"\n",
        )
        .unwrap();
        walk.check("free")
            .unwrap_or_else(|error| panic!("{walk}: {error}"));
        walk.keeps_its_input();
        walk.keeps(
            "onto measured data",
            "rows",
            "series,mounting,pose,window,stroke\na,1,p,1,1\n",
        );
        walk.keeps("onto a recording", "record", "tick,state\n1,obtain\n");
        walk.keeps("onto a foreign file", "foreign", "somebody's own work\n");
        walk.requires_a_writable_file();
        // Nothing is left by all that.
        fs::remove_file(walk.at("in.toml")).unwrap();
        let left: Vec<_> = fs::read_dir(&folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        assert!(left.is_empty(), "{walk}: {left:?}");
    }
    fs::remove_dir_all(&folder).unwrap();
}

fn has_overwrite(path: &str) -> bool {
    let leaves = leaves(&Arguments::command(), "");
    let (_, command) = leaves.iter().find(|(name, _)| name == path).unwrap();
    command.get_arguments().any(|argument| {
        argument.get_long() == Some("overwrite")
            && matches!(argument.get_action(), ArgAction::SetTrue)
    })
}

/// True if a command does not parse without this output.
fn is_needed(path: &str, option: &str) -> bool {
    option == "--output" && !["header", "draw", "workspace"].contains(&path)
}

/// True for outputs that get another name where theirs is taken.
fn is_evidence(option: &str) -> bool {
    option == "--black-box"
}
