//! Tables of a robot file, read section by section. Where a value cannot be read, that of the
//! built-in machine takes its place, so that one error does not hide the others.

use serde::de::DeserializeOwned;
use serde_path_to_error::{Path, Segment};
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

use super::problems::{Problem, Problems};
use super::sections::Sections;
use super::{Keys, ModelName};

/// Name of the keys outside of sections, for [`Problems::of`].
pub(super) const GEOMETRY: &str = "";
/// Largest number of errors of a section that are looked for.
const MAX_ERRORS: usize = 50;

/// Parses a text. Of each line that is not TOML, one error.
pub(super) fn parse(text: &str) -> Result<Spanned<DeTable<'_>>, Problems> {
    let (root, mut errors) = DeTable::parse_recoverable(text);
    errors.sort_by_key(|error| line_of(text, byte(error)));
    errors.dedup_by_key(|error| line_of(text, byte(error)));
    if errors.is_empty() {
        return Ok(root);
    }
    let mut problems = Problems::default();
    for error in &errors {
        let key = key_before(text, byte(error));
        problems.add(key, at_line(error.message(), text, byte(error)));
    }
    Err(problems)
}

/// Reads `model` before anything else: another machine's keys would only be called unknown.
pub(super) fn model(root: &DeTable) -> Result<ModelName, Problem> {
    match root.get("model").map(Spanned::get_ref) {
        Some(DeValue::String(name)) if name == "l2" => Ok(ModelName::L2),
        Some(DeValue::String(name)) if name == "f1" => Ok(ModelName::F1),
        Some(_) => Err(Problem::new("model", "must be \"l2\" or \"f1\"")),
        None => Err(Problem::new("model", "is missing")),
    }
}

/// Byte of the text at which an error is.
fn byte(error: &toml::de::Error) -> usize {
    error.span().map_or(0, |span| span.start)
}

/// Returns the key that an error of TOML's grammar concerns: the last one up to its line.
fn key_before(text: &str, byte: usize) -> String {
    let before = text.get(..byte).unwrap_or("");
    let line_start = before.rfind('\n').map_or(0, |end| end.saturating_add(1));
    let line = text.get(line_start..).and_then(|rest| rest.lines().next());
    // A section that is there twice.
    if let Some(section) = line.and_then(section_named) {
        return section.to_owned();
    }
    let section = before.lines().rev().find_map(section_named);
    let key = (before.lines().chain(line).rev())
        .find_map(|line| line.split_once('=').map(|(key, _)| key.trim()));
    match (section, key) {
        (Some(section), Some(key)) if key != section => format!("{section}.{key}"),
        (None, Some(key)) => key.to_owned(),
        (Some(section), _) => section.to_owned(),
        (None, None) => String::new(),
    }
}

/// Returns the name of the section that a line begins.
fn section_named(line: &str) -> Option<&str> {
    let name = line.trim().strip_prefix('[')?.strip_suffix(']')?;
    let is_name = name.starts_with(char::is_alphabetic)
        && (name.chars()).all(|c| c.is_alphanumeric() || "._".contains(c));
    is_name.then_some(name)
}

/// Number of the line of a byte, from 1.
fn line_of(text: &str, byte: usize) -> usize {
    let before = text.get(..byte).unwrap_or("");
    before.matches('\n').count().saturating_add(1)
}

/// Returns a reason with the line of a byte.
fn at_line(reason: &str, text: &str, byte: usize) -> String {
    format!("{reason} (line {})", line_of(text, byte))
}

/// Reads the keys of the machine, then the sections; neither knows the other's names. `None` only
/// if the built-in machine's cannot be read either.
pub(super) fn tables<K: Keys<N>, const N: usize>(
    text: &str,
    problems: &mut Problems,
) -> Option<(K, Sections<N>)> {
    let root = match parse(text) {
        Ok(root) => root,
        Err(found) => {
            *problems = found;
            return None;
        }
    };
    let known = DeTable::parse(K::BUILT_IN).ok()?;
    let mut reader = TableReader {
        text,
        root: root.get_ref(),
        known: known.get_ref(),
        problems,
    };
    reader.refuse_unknown(
        &["model"]
            .iter()
            .chain(K::NAMES)
            .chain(&Sections::<N>::NAMES)
            .copied()
            .collect::<Vec<_>>(),
    );
    let keys = reader.geometry()?;
    Some((keys, Sections::read(&mut reader)?))
}

/// A file that is being read, and the built-in machine of its kind.
pub(super) struct TableReader<'a, 't> {
    text: &'t str,
    root: &'a DeTable<'t>,
    known: &'a DeTable<'t>,
    problems: &'a mut Problems,
}

impl<'t> TableReader<'_, 't> {
    fn refuse_unknown(&mut self, names: &[&str]) {
        for unknown in self.root.keys() {
            let name = unknown.get_ref().as_ref();
            if !names.contains(&name) {
                let reason = format!(
                    "unknown field `{name}`, expected one of `{}`",
                    names.join("`, `")
                );
                self.problems
                    .add(name, at_line(&reason, self.text, unknown.span().start));
            }
        }
    }

    /// Reads the keys outside of sections.
    fn geometry<T: DeserializeOwned>(&mut self) -> Option<T> {
        let [own, known] =
            [self.root, self.known].map(|all| Spanned::new(0..0, DeValue::Table(all.clone())));
        self.value(GEOMETRY, own, Some(&known))
    }

    /// Reads a section that every file has.
    pub(super) fn section<T: DeserializeOwned>(&mut self, name: &'static str) -> Option<T> {
        let known = self.known.get(name)?;
        match self.root.get(name) {
            Some(section) => self.value(name, section.clone(), Some(known)),
            None => {
                self.problems
                    .add(name, at_line(&format!("missing field `{name}`"), "", 0));
                self.problems.distrust(name);
                self.value(name, known.clone(), None)
            }
        }
    }

    /// Reads a section that may be absent. One that cannot be repaired counts as absent.
    pub(super) fn optional<T: DeserializeOwned>(&mut self, name: &'static str) -> Option<T> {
        let section = self.root.get(name)?;
        self.value(name, section.clone(), self.known.get(name))
    }

    /// Reads a value. After each error the key that it concerns gets the known value, or is
    /// removed; at the end the whole value is the known one.
    fn value<T: DeserializeOwned>(
        &mut self,
        section: &'static str,
        mut value: Spanned<DeValue<'t>>,
        known: Option<&Spanned<DeValue<'t>>>,
    ) -> Option<T> {
        let mut keys = Vec::new();
        loop {
            let deserializer = ValueDeserializer::from(value.clone());
            let error = match serde_path_to_error::deserialize(deserializer) {
                Ok(read) => return Some(read),
                Err(error) => error,
            };
            let at = Location::of(error.path(), error.inner().message());
            let key = at.key(section);
            if keys.contains(&key) || keys.len() == MAX_ERRORS {
                // What stands at this key could not be repaired.
                let known = ValueDeserializer::from(known?.clone());
                // With the same wrapper as above: the types' code for another deserializer would
                // be as long again.
                return serde_path_to_error::deserialize(known).ok();
            }
            let error = error.into_inner();
            let reason = at_line(error.message(), self.text, byte(&error));
            self.problems.add(key.as_str(), reason);
            if !at.is_unknown {
                self.problems.distrust(section);
            }
            at.repair(&mut value, known);
            keys.push(key);
        }
    }
}

/// Place of an error in a section.
struct Location {
    /// Names of tables and keys, and indices of arrays.
    segments: Vec<Segment>,
    /// A key that does not belong there.
    is_unknown: bool,
}

impl Location {
    fn of(path: &Path, message: &str) -> Self {
        let mut segments: Vec<Segment> = path.iter().cloned().collect();
        let is_unknown = message.starts_with("unknown field");
        // What is missing is not a part of the path.
        let missing = message.strip_prefix("missing field `");
        if let Some(key) = missing.and_then(|rest| rest.strip_suffix('`')) {
            let key = key.to_owned();
            segments.push(Segment::Map { key });
        }
        // An element of a list of numbers is not a key of its own.
        while matches!(segments.last(), Some(Segment::Seq { .. })) {
            segments.pop();
        }
        Self {
            segments,
            is_unknown,
        }
    }

    /// The key with its section, as messages name it.
    fn key(&self, section: &str) -> String {
        let mut key = section.to_owned();
        for segment in &self.segments {
            match segment {
                Segment::Seq { index } => key.push_str(&format!("[{index}]")),
                Segment::Map { key: name } if key.is_empty() => key.push_str(name),
                Segment::Map { key: name } => key.push_str(&format!(".{name}")),
                Segment::Enum { .. } | Segment::Unknown => {}
            }
        }
        key
    }

    /// Gives the key its known value, or removes it.
    fn repair<'t>(&self, value: &mut Spanned<DeValue<'t>>, known: Option<&Spanned<DeValue<'t>>>) {
        let Some((Segment::Map { key }, tables)) = self.segments.split_last() else {
            return;
        };
        let mut table = value;
        let mut known = known;
        for segment in tables {
            let Some(below) = below_mut(table, segment) else {
                return;
            };
            table = below;
            known = known.and_then(|known| below_of(known, segment));
        }
        let DeValue::Table(table) = table.get_mut() else {
            return;
        };
        let known = known.and_then(|known| match known.get_ref() {
            DeValue::Table(known) => known.get_key_value(key.as_str()),
            _ => None,
        });
        table.remove(key.as_str());
        if let Some((key, known)) = known.filter(|_| !self.is_unknown) {
            table.insert(key.clone(), known.clone());
        }
    }
}

/// Value at a segment below a table or an array.
fn below_mut<'v, 't>(
    value: &'v mut Spanned<DeValue<'t>>,
    segment: &Segment,
) -> Option<&'v mut Spanned<DeValue<'t>>> {
    match (value.get_mut(), segment) {
        (DeValue::Table(table), Segment::Map { key }) => table.get_mut(key.as_str()),
        (DeValue::Array(array), Segment::Seq { index }) => array.get_mut(*index),
        _ => None,
    }
}

/// As [`below_mut`], to be read.
fn below_of<'v, 't>(
    value: &'v Spanned<DeValue<'t>>,
    segment: &Segment,
) -> Option<&'v Spanned<DeValue<'t>>> {
    match (value.get_ref(), segment) {
        (DeValue::Table(table), Segment::Map { key }) => table.get(key.as_str()),
        (DeValue::Array(array), Segment::Seq { index }) => array.get(*index),
        _ => None,
    }
}
