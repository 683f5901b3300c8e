//! Types of the options that name files, and the policy of `gantry_tau_system::output` over all
//! options of a command.

use std::ops::Deref;
use std::path::{Path, PathBuf};

use clap::ArgMatches;
use clap::builder::{PathBufValueParser, TypedValueParser};
use gantry_tau_identify::measurements;
use gantry_tau_machine::robot_file::AnyRobotFile;
use gantry_tau_record::recording::RecordTo;
use gantry_tau_system::output::{Kind, Output, WriteError, check_apart, write_all};

use super::plan;

/// A file that a command reads.
#[derive(Clone, Debug)]
pub(super) struct InputFile(PathBuf);

/// Something that is built in, or a file that a command reads.
#[derive(Clone, Debug)]
pub(super) struct NamedInput(String);

impl From<std::ffi::OsString> for InputFile {
    fn from(path: std::ffi::OsString) -> Self {
        Self(path.into())
    }
}

impl From<InputFile> for PathBuf {
    fn from(input: InputFile) -> Self {
        input.0
    }
}

impl Deref for InputFile {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

impl From<String> for NamedInput {
    fn from(name: String) -> Self {
        Self(name)
    }
}

impl From<NamedInput> for String {
    fn from(name: NamedInput) -> Self {
        name.0
    }
}

impl Deref for NamedInput {
    type Target = str;

    fn deref(&self) -> &str {
        &self.0
    }
}

/// A table of windows that is written row by row, and continued where it exists.
#[derive(Clone, Debug)]
pub(super) struct ContinuedTable(PathBuf);

impl From<std::ffi::OsString> for ContinuedTable {
    fn from(path: std::ffi::OsString) -> Self {
        Self(path.into())
    }
}

impl Deref for ContinuedTable {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

/// Option for a whole file of a kind.
pub(super) fn file(kind: Kind) -> impl TypedValueParser<Value = Output> {
    PathBufValueParser::new().map(move |path| Output::new(path, kind))
}

/// Checks every output that the options of a command name, before the command begins.
///
/// # Errors
/// [`WriteError`].
pub(super) fn check(matches: &ArgMatches) -> Result<(), WriteError> {
    let mut matches = matches;
    while let Some((_, of_command)) = matches.subcommand() {
        matches = of_command;
    }
    let mut outputs: Vec<Output> = values(matches);
    let planned: Vec<Output> = outputs.iter().flat_map(plan::beside).collect();
    outputs.extend(planned);
    let is_overwriting = matches
        .try_get_one::<bool>("overwrite")
        .is_ok_and(|overwrite| overwrite == Some(&true));
    outputs
        .iter()
        .try_for_each(|output| output.check(is_overwriting))?;
    let mut paths: Vec<&Path> = outputs.iter().map(Output::path).collect();
    let recordings: Vec<RecordTo> = values(matches);
    paths.extend(recordings.iter().map(RecordTo::path));
    let tables: Vec<ContinuedTable> = values(matches);
    paths.extend(tables.iter().map(|table| &**table));
    let inputs: Vec<PathBuf> = inputs(matches);
    check_apart(
        &paths,
        &inputs.iter().map(PathBuf::as_path).collect::<Vec<_>>(),
    )
}

/// Files that the options name, and the tables that set-ups among them name. The table of a plan is
/// not an input of `experiment`.
fn inputs(matches: &ArgMatches) -> Vec<PathBuf> {
    let mut inputs: Vec<PathBuf> = values::<InputFile>(matches)
        .into_iter()
        .map(PathBuf::from)
        .collect();
    if values::<ContinuedTable>(matches).is_empty() {
        let tables: Vec<PathBuf> = inputs
            .iter()
            .filter_map(|setup| measurements::table_of(setup))
            .collect();
        inputs.extend(tables);
    }
    inputs.extend(
        values::<NamedInput>(matches)
            .into_iter()
            .map(|name| PathBuf::from(name.0)),
    );
    inputs
}

/// Values of all options of a type.
fn values<T: Clone + Send + Sync + 'static>(matches: &ArgMatches) -> Vec<T> {
    let options = matches
        .ids()
        .filter_map(|id| matches.try_get_many::<T>(id.as_str()).ok().flatten());
    options.flatten().cloned().collect()
}

/// Writes a robot file that can be read, the answer for programs and the page: all of them, or, if
/// one of them cannot be written, none.
pub(super) fn write_learned(
    robot_file: &Output,
    text: &str,
    others: &[(Option<&Output>, &str)],
) -> Result<(), Box<dyn std::error::Error>> {
    AnyRobotFile::parse("what was found", text).map_err(|error| {
        format!("{error}: it is no robot file, and nothing is written; look at the units of the measured columns, and at these keys of the file that it began with")
    })?;
    let asked = others
        .iter()
        .filter_map(|(output, text)| output.map(|output| (output, *text)));
    Ok(write_all(
        &asked.chain([(robot_file, text)]).collect::<Vec<_>>(),
    )?)
}

#[cfg(test)]
mod tests;
