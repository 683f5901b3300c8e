//! Windows as JSON lines, by core's `serde` types.

use gantry_tau_core::control::session::Output;
use gantry_tau_server::black_box::Window;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::FileError;

/// Label of the files of sessions.
const LABEL: Label = Label {
    format: "gantry-tau black box",
    version: 8,
    what: "a black box of gantry-tau",
};
/// Number of lines before the first tick.
const HEAD: usize = 2;

/// Names of a kind of file.
pub(super) struct Label {
    /// Name of the format, in the first line.
    pub(super) format: &'static str,
    /// Version of the layout.
    pub(super) version: u32,
    /// The kind in errors.
    pub(super) what: &'static str,
}

/// The first line.
#[derive(Serialize, Deserialize)]
struct Head {
    format: String,
    version: u32,
    axes: usize,
    ticks: usize,
}

/// Returns the text of a file with this window.
#[must_use]
pub fn encode<const N: usize>(window: &Window<N>) -> String {
    let mut lines = vec![head(&LABEL, N, window.entries.len()), json(&window.before)];
    lines.extend(window.entries.iter().map(json));
    lines.push(String::new());
    lines.join("\n")
}

/// Returns the first line of a file.
pub(super) fn head(label: &Label, axes: usize, ticks: usize) -> String {
    json(&Head {
        format: label.format.to_owned(),
        version: label.version,
        axes,
        ticks,
    })
}

/// As [`super::axes`].
pub(super) fn axes(name: &str, bytes: &[u8]) -> Result<usize, FileError> {
    Lines::of(name, bytes, &LABEL).axes()
}

/// As [`super::decode`].
pub(super) fn decode<const N: usize>(name: &str, bytes: &[u8]) -> Result<Window<N>, FileError> {
    let lines = Lines::of(name, bytes, &LABEL);
    let numbers = lines.ticks(N)?;
    let before = lines.read(2)?;
    let entries = numbers.map(|number| lines.read(number));
    Ok(Window {
        before,
        entries: entries.collect::<Result<_, _>>()?,
        loops: None,
    })
}

/// Returns the path of the first field in which two outputs differ, and its JSON in each.
#[must_use]
pub fn first_difference<const N: usize>(
    recorded: &Output<N>,
    replayed: &Output<N>,
) -> Option<(String, String, String)> {
    let recorded = serde_json::to_value(recorded).ok()?;
    let replayed = serde_json::to_value(replayed).ok()?;
    let (path, recorded, replayed) = difference(&recorded, &replayed)?;
    let path = path.strip_prefix('.').unwrap_or(&path).to_owned();
    Some((path, recorded, replayed))
}

/// As [`first_difference`], of two JSON values. The path begins with a dot or a bracket.
fn difference(left: &Value, right: &Value) -> Option<(String, String, String)> {
    match (left, right) {
        (Value::Object(a), Value::Object(b)) if a.keys().eq(b.keys()) => {
            let mut fields = a.iter().zip(b.values());
            fields.find_map(|((name, a), b)| difference_within(&format!(".{name}"), a, b))
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            let mut items = a.iter().zip(b).enumerate();
            items.find_map(|(index, (a, b))| difference_within(&format!("[{index}]"), a, b))
        }
        _ => (left != right).then(|| (String::new(), left.to_string(), right.to_string())),
    }
}

/// As [`difference`], of the values at `place`, with which the path begins.
fn difference_within(place: &str, left: &Value, right: &Value) -> Option<(String, String, String)> {
    let (path, left, right) = difference(left, right)?;
    Some((format!("{place}{path}"), left, right))
}

/// Returns a value as JSON. Core's types have no value without; an error would stand in the line,
/// which no reader takes.
pub(super) fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).unwrap_or_else(|error| error.to_string())
}

/// The lines of a file, counted from 1.
pub(super) struct Lines<'a> {
    name: &'a str,
    lines: Vec<&'a [u8]>,
    label: &'a Label,
}

impl<'a> Lines<'a> {
    pub(super) fn of(name: &'a str, bytes: &'a [u8], label: &'a Label) -> Self {
        let whole = bytes.strip_suffix(b"\n").unwrap_or(bytes);
        Self {
            name,
            lines: whole.split(|byte| *byte == b'\n').collect(),
            label,
        }
    }

    /// The first line as JSON; `null` if it is not JSON.
    fn first(&self) -> Value {
        let first = self.lines.first().copied().unwrap_or_default();
        serde_json::from_slice(first).unwrap_or_default()
    }

    /// True if the first line names the format.
    pub(super) fn is_labelled(&self) -> bool {
        self.first().get("format").and_then(Value::as_str) == Some(self.label.format)
    }

    /// Number of axes that the first line announces.
    pub(super) fn axes(&self) -> Result<usize, FileError> {
        self.head().map(|head| head.axes)
    }

    /// Checks the first line against the number of axes and of lines. Returns the numbers of the
    /// lines with ticks.
    pub(super) fn ticks(&self, axes: usize) -> Result<std::ops::RangeInclusive<usize>, FileError> {
        let head = self.head()?;
        if head.axes != axes {
            return Err(self.refuse(1, format!("axes is {}, expected {axes}", head.axes)));
        }
        let last = self.lines.len();
        let found = last.saturating_sub(HEAD);
        if found != head.ticks {
            let announced = head.ticks;
            let reason = format!("the file ends with {found} ticks, line 1 announces {announced}");
            return Err(self.refuse(last, reason));
        }
        Ok(HEAD + 1..=last)
    }

    /// Reads the first line: format and version before anything else.
    fn head(&self) -> Result<Head, FileError> {
        if !self.is_labelled() {
            return Err(self.refuse(1, format!("this is not {}", self.label.what)));
        }
        let first = self.first();
        let version = first.get("version").unwrap_or(&Value::Null);
        let known = self.label.version;
        if version != known {
            let reason = format!("version is {version}; this program reads version {known}");
            return Err(self.refuse(1, reason));
        }
        let head: Head = self.read(1)?;
        if head.ticks == 0 {
            return Err(self.refuse(1, "ticks is 0: there is nothing to replay"));
        }
        Ok(head)
    }

    /// Reads a line as one value, which must be written as [`json`] writes it: serde takes an
    /// absent field for `None`, and unknown ones.
    pub(super) fn read<T: Serialize + DeserializeOwned>(
        &self,
        number: usize,
    ) -> Result<T, FileError> {
        let line = number
            .checked_sub(1)
            .and_then(|index| self.lines.get(index));
        let Some(line) = line else {
            let reason = format!("the file ends here, line {number} is missing");
            return Err(self.refuse(self.lines.len(), reason));
        };
        let mut deserializer = serde_json::Deserializer::from_slice(line);
        let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
            let inner = error.inner().to_string();
            // serde_json counts lines within the line.
            let reason = inner.split(" at line ").next().unwrap_or(&inner);
            let reason = format!("{reason} (column {})", error.inner().column());
            let path = error.path().to_string();
            let at_root = path == ".";
            self.refuse(
                number,
                if at_root {
                    reason
                } else {
                    format!("{path}: {reason}")
                },
            )
        })?;
        if json(&value).as_bytes() != *line {
            let reason =
                "a field is missing, unknown or out of order, or there is more than one value";
            return Err(self.refuse(number, reason));
        }
        Ok(value)
    }

    pub(super) fn refuse(&self, line: usize, reason: impl Into<String>) -> FileError {
        FileError {
            place: format!("{}, line {line}", self.name),
            reason: reason.into(),
        }
    }
}
