//! Black boxes as files: what a frozen [`BlackBox`] holds, one JSON value per line, exact to the bit.
//!
//! | line | what |
//! |---|---|
//! | 1 | `{"format":"gantry-tau black box","version":1,"axes":3,"ticks":129}` |
//! | 2 | `{"config":{...}}`: the session's [`Config`] |
//! | 3 | `{"before":{...}}`: the [`Parts`] of the session before the oldest tick |
//! | 4 on | `{"input":{...},"output":{...}}`: one [`Entry`] per tick, oldest first; as many as line 1 announces |
//!
//! Fields have the names, the order and the units they have in core: positions in nm, velocities in µm/s, torques in per mille,
//! times in ticks unless the name says otherwise. A variant of an enum is its name, or an object of that name with what it
//! carries; what is absent is `null`; 128 bits are a string of hexadecimal digits. Integers are written in full: a reader must
//! take 64 bits, not the 53 of a float.
//!
//! A file is read through core's constructors only. One that was edited is replayed like any other or refused with line and
//! reason. A change to the layout, a field of core gained or lost included, is a new version.

pub mod archive;
mod fields;
pub mod handover;
mod text;

use std::fmt;
use std::path::Path;

use gantry_tau_core::control::message::Cause;
use gantry_tau_core::control::session::config::Config;
use gantry_tau_core::control::session::{BlackBox, Entry, Output, Parts, Session};
use gantry_tau_core::units::{Epoch, Tick};
use serde_json::Value;

use text::{Object, Problem, Text, write_object};

/// What the first line says the file is.
const FORMAT: &str = "gantry-tau black box";
/// Version of the layout.
const VERSION: u32 = 1;
/// Lines before the first tick.
const HEAD: usize = 3;

/// Consecutive ticks, and the session before them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Window<const N: usize> {
    /// The session before the oldest tick.
    pub before: Session<N>,
    /// The ticks, oldest first; at least one.
    pub entries: Vec<Entry<N>>,
}

/// What a window is about: why a session ended or the server stopped, and when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct End {
    /// Its entry in the window.
    pub index: usize,
    /// Its tick.
    pub tick: Tick,
    /// Epoch of the session.
    pub epoch: Epoch,
    /// The cause; `None` where the window was cut short before any, because the machine did not take the last references.
    pub cause: Option<Cause>,
}

/// Why a file is no black box. Both have the file's name and, where there is one, the line, counted from 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileError {
    file: String,
    line: Option<usize>,
    reason: String,
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, line, reason } = self;
        match line {
            Some(line) => write!(f, "{file}, line {line}: {reason}"),
            None => write!(f, "{file}: {reason}"),
        }
    }
}

impl std::error::Error for FileError {}

impl<const N: usize> Window<N> {
    /// What a black box holds; `None` when it holds nothing.
    #[must_use]
    pub fn of<const HALF: usize>(black_box: &BlackBox<N, HALF>) -> Option<Self> {
        let before = *black_box.before()?;
        let entries: Vec<_> = black_box.entries().cloned().collect();
        (!entries.is_empty()).then_some(Self { before, entries })
    }

    /// The end that froze the box, the first one in it; the last entry where the window was cut short before any.
    #[must_use]
    pub fn end(&self) -> End {
        let mut outputs = self.entries.iter().map(|entry| &entry.output);
        let ended = outputs.position(|output| output.ended.is_some());
        let index = ended.unwrap_or(self.entries.len().saturating_sub(1));
        let output = self.entries.get(index).map(|entry| &entry.output);
        let discrete = &self.before.parts().discrete;
        End {
            index,
            tick: output.map_or(discrete.tick, |output| output.state.tick),
            epoch: output.map_or(discrete.epoch, |output| output.state.epoch),
            cause: output.and_then(|output| output.ended),
        }
    }

    /// What a file of this window is called: epoch, tick and cause.
    #[must_use]
    pub fn file_name(&self) -> String {
        let end = self.end();
        let cause = end.cause.map(|cause| format!("{cause:?}"));
        let cause = cause.unwrap_or_else(|| "CutShort".to_owned());
        format!("epoch-{}-tick-{}-{cause}.jsonl", end.epoch.0, end.tick.0)
    }

    /// The window as the text of a file.
    #[must_use]
    pub fn encode(&self) -> String {
        let mut text = String::new();
        let head = [
            ("format", format!("\"{FORMAT}\"")),
            ("version", VERSION.text()),
            ("axes", N.text()),
            ("ticks", self.entries.len().text()),
        ];
        write_object(&mut text, &head);
        text.push('\n');
        write_object(&mut text, &[("config", self.before.config().text())]);
        text.push('\n');
        write_object(&mut text, &[("before", self.before.parts().text())]);
        text.push('\n');
        for entry in &self.entries {
            entry.write(&mut text);
            text.push('\n');
        }
        text
    }

    /// The window of a file; `name` stands for the file in errors.
    ///
    /// # Errors
    /// [`FileError`]: the first line that is not as it should be.
    pub fn decode(name: &str, bytes: &[u8]) -> Result<Self, FileError> {
        let lines = Lines::of(name, bytes);
        let head = Head::read(&lines)?;
        if head.axes != N {
            let reason = format!("axes is {}, it must be {N}", head.axes);
            return Err(lines.refuse(1, reason));
        }
        let config: Config<N> = lines.field(2, "config")?;
        let parts: Parts<N> = lines.field(3, "before")?;
        let before = session(config, parts)
            .map_err(|problem| lines.refuse_problem(3, problem.within("before")))?;
        lines.check_count(head.ticks)?;
        let entries = (1..=head.ticks).map(|number| lines.whole(HEAD + number));
        Ok(Self {
            before,
            entries: entries.collect::<Result<_, _>>()?,
        })
    }
}

/// The bytes of a file.
///
/// # Errors
/// [`FileError`] when it cannot be read.
pub fn bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    std::fs::read(path).map_err(|error| FileError {
        file: path.display().to_string(),
        line: None,
        reason: error.to_string(),
    })
}

/// The number of axes that a file announces; `name` stands for the file in errors.
///
/// # Errors
/// [`FileError`] when its first line is none of a black box.
pub fn axes(name: &str, bytes: &[u8]) -> Result<usize, FileError> {
    Head::read(&Lines::of(name, bytes)).map(|head| head.axes)
}

/// The field in which two outputs differ first, and how it is written in each.
#[must_use]
pub fn first_difference<const N: usize>(
    recorded: &Output<N>,
    replayed: &Output<N>,
) -> Option<(String, String, String)> {
    let value = |output: &Output<N>| serde_json::from_str(&output.text()).ok();
    let difference = text::first_difference(&value(recorded)?, &value(replayed)?)?;
    let (place, recorded, replayed) = difference;
    Some((place, recorded.to_string(), replayed.to_string()))
}

/// A session as core accepts it.
fn session<const N: usize>(config: Config<N>, parts: Parts<N>) -> Result<Session<N>, Problem> {
    fields::check_channels(&parts.axes, &config)?;
    let contradiction = "contradicts itself: core accepts no such session";
    Session::from_parts(config, parts).ok_or_else(|| Problem::new(contradiction))
}

/// The first line.
struct Head {
    axes: usize,
    ticks: usize,
}

impl Head {
    fn read(lines: &Lines<'_>) -> Result<Self, FileError> {
        let refuse = |problem| lines.refuse_problem(1, problem);
        let foreign = || lines.refuse(1, "this is no black box of gantry-tau");
        let object = lines.whole(1).ok().and_then(|line| Object::of(line).ok());
        let mut head = object.ok_or_else(foreign)?;
        let format = head.take::<Value>("format");
        if !format.is_ok_and(|format| format == FORMAT) {
            return Err(foreign());
        }
        let version: u32 = head.take("version").map_err(refuse)?;
        if version != VERSION {
            let reason = format!("version is {version}, this program reads version {VERSION}");
            return Err(lines.refuse(1, reason));
        }
        let axes = head.take("axes").map_err(refuse)?;
        let ticks = head.take("ticks").map_err(refuse)?;
        head.end().map_err(refuse)?;
        if ticks == 0 {
            return Err(lines.refuse(1, "ticks is 0: there is nothing to replay"));
        }
        Ok(Self { axes, ticks })
    }
}

/// The lines of a file, counted from 1.
struct Lines<'a> {
    name: &'a str,
    lines: Vec<&'a [u8]>,
}

impl<'a> Lines<'a> {
    fn of(name: &'a str, bytes: &'a [u8]) -> Self {
        let whole = bytes.strip_suffix(b"\n").unwrap_or(bytes);
        Self {
            name,
            lines: whole.split(|byte| *byte == b'\n').collect(),
        }
    }

    fn get(&self, number: usize) -> Option<&'a [u8]> {
        self.lines.get(number.checked_sub(1)?).copied()
    }

    /// As many ticks as were announced.
    fn check_count(&self, announced: usize) -> Result<(), FileError> {
        let last = self.lines.len();
        match last.saturating_sub(HEAD) {
            there if there == announced => Ok(()),
            there => Err(self.refuse(
                last,
                format!("the file ends with {there} ticks, line 1 announces {announced}"),
            )),
        }
    }

    /// A line as one value.
    fn whole<T: Text>(&self, number: usize) -> Result<T, FileError> {
        let line = self.get(number).ok_or_else(|| {
            let last = self.lines.len();
            self.refuse(
                last,
                format!("the file ends here, line {number} is missing"),
            )
        })?;
        let value = serde_json::from_slice(line).map_err(|error| {
            // It counts lines within the line.
            let text = error.to_string();
            let reason = text.split(" at line ").next().unwrap_or(&text);
            self.refuse(number, format!("{reason} (column {})", error.column()))
        })?;
        T::read(value).map_err(|problem| self.refuse_problem(number, problem))
    }

    /// A line as an object with one field.
    fn field<T: Text>(&self, number: usize, name: &str) -> Result<T, FileError> {
        let read = |line| {
            let mut object = Object::of(line)?;
            let value = object.take(name)?;
            object.end()?;
            Ok(value)
        };
        read(self.whole(number)?).map_err(|problem| self.refuse_problem(number, problem))
    }

    fn refuse_problem(&self, line: usize, problem: Problem) -> FileError {
        let Problem { place, reason } = problem;
        let reason = if place.is_empty() {
            reason
        } else {
            format!("{place}: {reason}")
        };
        self.refuse(line, reason)
    }

    fn refuse(&self, line: usize, reason: impl Into<String>) -> FileError {
        FileError {
            file: self.name.to_owned(),
            line: Some(line),
            reason: reason.into(),
        }
    }
}

#[cfg(test)]
mod tests;
