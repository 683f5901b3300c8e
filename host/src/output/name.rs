//! Names that may stand in tables, on terminals and in file names.

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

/// Checks a name: printable, not empty, at most [`MAX_NAME`] characters, without `=`, `+`, `-` or `@` at its start.
///
/// # Errors
/// [`NameError`].
pub fn check_name(text: &str) -> Result<(), NameError> {
    let length = text.chars().count();
    if length > MAX_NAME {
        return Err(NameError::Long(length));
    }
    if let Some(bad) = text.chars().find(|letter| !is_printable(*letter)) {
        return Err(NameError::Unprintable(bad));
    }
    match text.chars().next() {
        None => Err(NameError::Empty),
        Some(first) if "=+-@".contains(first) => Err(NameError::Formula(first)),
        Some(_) => Ok(()),
    }
}

/// Returns a text in which characters that are not printable are escaped.
#[must_use]
pub fn printable(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut shown, letter| {
        if is_printable(letter) {
            shown.push(letter);
        } else {
            shown.extend(letter.escape_default());
        }
        shown
    })
}

/// False for control characters, ends of lines, and marks that turn the direction of a text.
fn is_printable(letter: char) -> bool {
    let turns =
        matches!(letter, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{feff}');
    !letter.is_control() && !turns
}
