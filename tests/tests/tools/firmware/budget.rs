//! `tests/firmware/sizes.toml`: goals and measurements.

use std::collections::BTreeMap;
use std::fs;
use std::sync::{Mutex, PoisonError};

use toml::{Table, Value};

use super::emulator::{Build, folder};

/// Numbers by their name.
pub(crate) type Measured = BTreeMap<String, i64>;

/// True if measurements are recorded instead of compared.
pub(crate) fn recording() -> bool {
    std::env::var_os("GANTRY_TAU_RECORD_SIZES").is_some_and(|value| value == "1")
}

/// Compares measurements with those recorded: none may exceed its goal, or the last measurement by
/// more than a fiftieth (another compiler, another rounding of the clock); a digest must be the
/// same.
pub(crate) fn judge(build: Build, subject: &str, measured: &Measured) {
    // Tests run side by side, and each writes the whole file.
    static FILE: Mutex<()> = Mutex::new(());
    let _file = FILE.lock().unwrap_or_else(PoisonError::into_inner);
    let key = &format!("{}_{subject}", build.name().replace('-', "_"));
    let path = folder().join("sizes.toml");
    let text = fs::read_to_string(&path).unwrap();
    let (head, _) = text.split_once("\n[").unwrap_or((&text, ""));
    let mut file: Table = text.parse().unwrap();
    for (name, value) in measured {
        println!("{key}: {name} = {value}");
    }
    if recording() {
        let numbers = measured
            .iter()
            .map(|(name, value)| (name.clone(), Value::Integer(*value)));
        let entry = section(&mut file, "measured");
        entry.insert(key.to_owned(), Value::Table(numbers.collect()));
        fs::write(&path, format!("{head}\n{file}")).unwrap();
    }
    let recorded = section(&mut file, "measured").get(key).cloned();
    let recorded = recorded.unwrap_or_else(|| panic!("sizes.toml has no [measured.{key}]"));
    for (name, value) in measured {
        let last = recorded.get(name).and_then(Value::as_integer);
        let last = last.unwrap_or_else(|| panic!("sizes.toml: no {name} in [measured.{key}]"));
        if name.ends_with("crc32") {
            assert_eq!(*value, last, "{key}: {name} is not the recorded one");
        } else {
            assert!(
                *value <= last + last / 50,
                "{key}: {name} is {value}, recorded {last}"
            );
        }
    }
    let subjects = section(&mut file, "measured").clone();
    let goals = section(&mut file, "goals");
    let stray = goals.keys().find(|goal| !subjects.contains_key(*goal));
    // One that is measured later has no row yet.
    assert!(
        recording() || stray.is_none(),
        "sizes.toml has a goal of nothing measured: {stray:?}"
    );
    let goals = goals.get(key).cloned();
    for (name, goal) in goals.iter().filter_map(Value::as_table).flatten() {
        let (value, goal) = (measured[name], goal.as_integer().unwrap());
        assert!(
            value <= goal,
            "{key}: {name} is {value}, the goal is {goal}"
        );
    }
}

/// Returns a goal of `sizes.toml`.
pub(crate) fn goal(key: &str, name: &str) -> i64 {
    let file: Table = fs::read_to_string(folder().join("sizes.toml"))
        .unwrap()
        .parse()
        .unwrap();
    file["goals"][key][name].as_integer().unwrap()
}

fn section<'a>(file: &'a mut Table, name: &str) -> &'a mut Table {
    let entry = file
        .entry(name)
        .or_insert_with(|| Value::Table(Table::new()));
    entry.as_table_mut().unwrap()
}
