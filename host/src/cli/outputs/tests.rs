//! Every option of every command that names a file is of a type with a policy, and every output keeps to it.

use std::any::TypeId;
use std::ffi::OsString;
use std::fs;

use clap::{Arg, ArgAction, Command, CommandFactory};

use super::super::Arguments;
use super::*;

/// Files of the state of a server and folders of evidence, which have policies of their own.
const STATE: [(&str, &str); 2] = [("serve", "epoch_file"), ("serve", "black_box")];

/// Commands that do something, with the arguments that they need; `IN` is a file that is read.
const COMMANDS: [(&str, &[&str]); 24] = [
    ("demo", &["--client", "IN"]),
    ("serve", &["--robot", "IN"]),
    ("client", &["--robot", "IN"]),
    ("monitor", &["--robot", "IN"]),
    ("recover", &["IN"]),
    ("faults", &["--listen", "127.0.0.1:1", "--to", "127.0.0.1:1", "--script", "IN"]),
    ("follow", &["--robot", "IN"]),
    ("replay", &["IN"]),
    ("workspace", &["IN"]),
    ("draw", &["IN"]),
    ("header", &["IN"]),
    ("labcomm decode", &["IN"]),
    ("labcomm encode", &["IN"]),
    ("labcomm schema", &["--robot", "IN"]),
    ("linuxcnc-report", &["folder", "--robot", "IN"]),
    ("calibrate", &["IN", "--robot", "l2"]),
    ("identify", &["IN", "--robot", "l2"]),
    ("verify", &["IN", "--robot", "l2"]),
    ("plan springs", &["l2", "--gauges", "IN"]),
    ("plan geometry", &["IN"]),
    ("plan verify", &["IN"]),
    ("plan check", &["IN", "l2"]),
    ("experiment", &["IN"]),
    ("solve", &[]),
];

/// Commands without others below them, by their names.
fn leaves(command: &Command, path: &str) -> Vec<(String, Command)> {
    if !command.has_subcommands() {
        return vec![(path.to_owned(), command.clone())];
    }
    let below = command.get_subcommands().filter(|below| below.get_name() != "help");
    below.flat_map(|below| leaves(below, format!("{path} {}", below.get_name()).trim())).collect()
}

/// Outputs of all commands: name of the command, and of the option as it is typed.
fn outputs() -> Vec<(String, String, TypeId)> {
    let types = [TypeId::of::<Output>(), TypeId::of::<RecordTo>(), TypeId::of::<ContinuedTable>()];
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
        TypeId::of::<Input>(),
        TypeId::of::<NamedInput>(),
    ];
    for (path, command) in leaves(&Arguments::command(), "") {
        assert!(COMMANDS.iter().any(|(name, _)| *name == path), "{path} is not in the table of this test");
        for argument in command.get_arguments() {
            let of = argument.get_value_parser().type_id();
            let names = argument.get_value_names().unwrap_or_default().join(" ");
            let is_path = of == TypeId::of::<PathBuf>() || of == TypeId::of::<OsString>();
            // Words that stand in place of a path's name.
            let says_so =
                ["FILE", "FOLDER", "PLAN", "PAGE", "TABLE", ".csv", ".toml"].iter().any(|word| names.contains(word));
            let id = argument.get_id().as_str();
            if STATE.contains(&(path.as_str(), id)) || !(is_path || says_so) {
                continue;
            }
            assert!(types.iter().any(|ty| of == *ty), "{path}: {id} <{names}> has no type of cli/outputs.rs");
        }
    }
}

/// The walk: each output of each command onto an input, onto measured and foreign files, a folder, a read-only file, into no folder.
#[test]
fn every_output_of_every_command_keeps_to_the_policy() {
    let folder = std::env::temp_dir().join(format!("gantry-tau-walk-{}", std::process::id()));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    let at = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let outputs = outputs();
    assert!(outputs.len() >= 29, "{outputs:#?}");
    for (path, option, ty) in &outputs {
        let (_, given) = COMMANDS.iter().find(|(name, _)| name == path).unwrap();
        // The name must have an extension that the option takes.
        let takes = |name: &str| {
            let words = path.split(' ').map(str::to_owned).chain(["--force".to_owned()]);
            let words = words.filter(|word| word != "--force" || has_force(path));
            let given = given.iter().map(|word| if *word == "IN" { at("in.toml") } else { at_if(word, &at) });
            // Other outputs that are needed.
            let needed =
                outputs.iter().filter(|(other, name, _)| other == path && name != option && is_needed(path, name));
            let needed = needed.flat_map(|(_, name, _)| [name.clone(), at("needed.toml")]);
            let all = words.chain(given).chain(needed).chain([option.clone(), at(name)]);
            let program = ["gantry-tau".to_owned()].into_iter();
            Arguments::command().try_get_matches_from(program.chain(all))
        };
        let endings = ["toml", "html", "json", "csv", "svg", "mcap"];
        let ending = endings.into_iter().find(|ending| takes(&format!("x.{ending}")).is_ok());
        let ending = ending.unwrap_or_else(|| panic!("{path} {option}: {}", takes("x.toml").unwrap_err()));
        let judge = |name: &str| check(&takes(&format!("{name}.{ending}")).unwrap());
        let is_whole = *ty == TypeId::of::<Output>();
        let keeps = |what: &str, name: &str, text: &str| {
            let file = at(&format!("{name}.{ending}"));
            fs::write(&file, text).unwrap();
            let judged = judge(name);
            // A recording gets another name; a table is judged where its columns are known.
            assert!(judged.is_err() == (is_whole && !is_evidence(option)), "{path} {option} {what}: {judged:?}");
            assert_eq!(fs::read_to_string(&file).unwrap(), text, "{path} {option} {what}");
            fs::remove_file(&file).unwrap();
        };
        fs::write(at("in.toml"), "model = \"l2\"\nmeasurements = \"table.csv\"\n").unwrap();
        judge("free").unwrap_or_else(|error| panic!("{path} {option}: {error}"));
        // Onto the input, by its own name or another.
        if ending != "toml" {
            fs::hard_link(at("in.toml"), at(&format!("input.{ending}"))).unwrap();
            let error = judge("input").unwrap_err().to_string();
            assert!(is_whole || error.contains("the same command reads this file"), "{path} {option}: {error}");
            fs::remove_file(at(&format!("input.{ending}"))).unwrap();
        }
        let is_input = judge("in");
        assert!(ending != "toml" || is_input.is_err(), "{path} {option} onto its input");
        keeps("onto measured data", "rows", "series,mounting,pose,window,stroke\na,1,p,1,1\n");
        keeps("onto a recording", "record", "tick,state\n1,obtain\n");
        keeps("onto a foreign file", "foreign", "somebody's own work\n");
        fs::create_dir(at(&format!("dir.{ending}"))).unwrap();
        assert!(!is_whole || judge("dir").is_err(), "{path} {option} onto a folder");
        fs::remove_dir(at(&format!("dir.{ending}"))).unwrap();
        assert!(!is_whole || judge("no/such").is_err(), "{path} {option} into a missing folder");
        fs::write(at(&format!("read.{ending}")), "").unwrap();
        let mut read_only = fs::metadata(at(&format!("read.{ending}"))).unwrap().permissions();
        read_only.set_readonly(true);
        fs::set_permissions(at(&format!("read.{ending}")), read_only).unwrap();
        let judged = judge("read");
        assert!(!is_whole || is_evidence(option) || judged.is_err(), "{path} {option} onto a read-only file");
        fs::remove_file(at(&format!("read.{ending}"))).unwrap();
        // Nothing is left by all that.
        fs::remove_file(at("in.toml")).unwrap();
        let left: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert!(left.is_empty(), "{path} {option}: {left:?}");
    }
    fs::remove_dir_all(&folder).unwrap();
}

fn has_force(path: &str) -> bool {
    let leaves = leaves(&Arguments::command(), "");
    let (_, command) = leaves.iter().find(|(name, _)| name == path).unwrap();
    let is_flag = |argument: &Arg| matches!(argument.get_action(), ArgAction::SetTrue);
    command.get_arguments().any(|argument| argument.get_long() == Some("force") && is_flag(argument))
}

/// True if a command does not parse without this output.
fn is_needed(path: &str, option: &str) -> bool {
    option == "-o" && !path.starts_with("header")
}

/// True for outputs that get another name where theirs is taken.
fn is_evidence(option: &str) -> bool {
    option == "--black-box"
}

/// The folder that a command reads lies beside the others.
fn at_if(word: &str, at: &impl Fn(&str) -> String) -> String {
    if word == "folder" { at(word) } else { word.to_owned() }
}
