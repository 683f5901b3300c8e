//! Names that may stand in tables, on terminals and in file names.

use std::borrow::Borrow;
use std::fmt;
use std::ops::Deref;
use std::str::FromStr;

/// Longest name, characters.
pub const MAX_NAME: usize = 64;

/// Reason why a text is not a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NameError {
    /// It has no character.
    #[error("is empty; give it a name")]
    Empty,
    /// It has more than [`MAX_NAME`] characters.
    #[error("has {0} characters; expected at most {MAX_NAME}")]
    Long(usize),
    /// It has a character that moves the cursor, ends a line or cannot be seen.
    #[error("has the character {0:?}; expected printable ones")]
    Unprintable(char),
    /// A spreadsheet would take it for a formula, and the command line for an option.
    #[error("begins with {0:?}, which spreadsheets take for a formula; begin with a letter")]
    Formula(char),
}

/// Name that a user gives: of a series, a pose, a gauge. Printable, not empty, at most [`MAX_NAME`]
/// characters, without `=`, `+`, `-` or `@` at its start. It may have commas and quotation marks:
/// tables are written by a writer of CSV.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "String")
)]
pub struct Name(String);

impl Name {
    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Returns the name of something that this program names itself: what may not stand in a name
    /// becomes `_`, what is too long is cut.
    pub fn made(text: impl fmt::Display) -> Self {
        let text = text.to_string();
        let cut = text
            .chars()
            .take(MAX_NAME)
            .map(|letter| if is_printable(letter) { letter } else { '_' });
        let mut name: String = cut.collect();
        if name.is_empty() || name.starts_with(is_formula) {
            name = format!("_{}", name.get(1..).unwrap_or_default());
        }
        Self(name)
    }
}

impl FromStr for Name {
    type Err = NameError;

    fn from_str(text: &str) -> Result<Self, NameError> {
        let length = text.chars().count();
        if length > MAX_NAME {
            return Err(NameError::Long(length));
        }
        if let Some(bad) = text.chars().find(|letter| !is_printable(*letter)) {
            return Err(NameError::Unprintable(bad));
        }
        match text.chars().next() {
            None => Err(NameError::Empty),
            Some(first) if is_formula(first) => Err(NameError::Formula(first)),
            Some(_) => Ok(Self(text.to_owned())),
        }
    }
}

/// A text in a file that is not a name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("name {text:?}: {reason}")]
pub struct NameInFileError {
    /// The text.
    pub text: String,
    /// Reason why it is not a name.
    #[source]
    pub reason: NameError,
}

/// For files: the error names the text that is not a name.
impl TryFrom<String> for Name {
    type Error = NameInFileError;

    fn try_from(text: String) -> Result<Self, NameInFileError> {
        text.parse()
            .map_err(|reason| NameInFileError { text, reason })
    }
}

impl Deref for Name {
    type Target = str;

    fn deref(&self) -> &str {
        self.as_str()
    }
}

impl Borrow<str> for Name {
    fn borrow(&self) -> &str {
        self
    }
}

impl PartialEq<str> for Name {
    fn eq(&self, other: &str) -> bool {
        **self == *other
    }
}

/// As of the text.
impl fmt::Debug for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self)
    }
}

/// Returns a text in which characters that are not printable are escaped.
#[must_use]
pub fn printable(text: &str) -> String {
    escaped(text, is_printable)
}

/// Returns a text in which the characters that may not stand are escaped.
pub fn escaped(text: &str, may_stand: impl Fn(char) -> bool) -> String {
    text.chars()
        .fold(String::with_capacity(text.len()), |mut shown, letter| {
            if may_stand(letter) {
                shown.push(letter);
            } else {
                shown.extend(letter.escape_default());
            }
            shown
        })
}

/// True for a letter that makes a formula of a cell.
fn is_formula(first: char) -> bool {
    "=+-@".contains(first)
}

/// False for control characters, ends of lines, and marks that turn the direction of a text.
fn is_printable(letter: char) -> bool {
    let turns = matches!(letter, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{feff}');
    !letter.is_control() && !turns
}
