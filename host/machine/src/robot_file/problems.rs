//! Errors of a robot file: each with its key and its reason, and all of them rather than the first.

use gantry_tau_system::output::printable;

use super::RobotFileError;

/// Key and description of an error; the file's name is added later.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// Key, with its section and index; empty for the whole file.
    pub key: String,
    /// Description of the error.
    pub reason: String,
}

impl Problem {
    pub(super) fn new(key: impl Into<String>, reason: impl ToString) -> Self {
        Self {
            key: key.into(),
            reason: reason.to_string(),
        }
    }

    pub(super) fn in_file(self, file: &str) -> RobotFileError {
        RobotFileError {
            file: one_line(file),
            key: one_line(&self.key),
            reason: one_line(&self.reason),
        }
    }
}

/// Returns a text without line breaks and controls.
fn one_line(text: &str) -> String {
    printable(&text.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// Errors that were found so far, in the order of the checks.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Problems {
    found: Vec<Problem>,
    /// Sections with values that are not their own, or too many of them.
    distrusted: Vec<&'static str>,
}

impl Problems {
    /// Adds an error.
    pub(super) fn add(&mut self, key: impl Into<String>, reason: impl ToString) {
        self.found.push(Problem::new(key, reason));
    }

    /// Adds the error of a check, if it has one; returns its value.
    pub(super) fn keep<T>(&mut self, checked: Result<T, Problem>) -> Option<T> {
        checked.map_err(|problem| self.found.push(problem)).ok()
    }

    /// Checks `lower <= value <= upper`; NaN is refused.
    pub(super) fn range(&mut self, key: &str, value: f64, lower: f64, upper: f64) {
        if !(lower..=upper).contains(&value) {
            self.add(key, format!("is {value}; expected from {lower} to {upper}"));
        }
    }

    /// Keeps further checks from a section.
    pub(super) fn distrust(&mut self, section: &'static str) {
        self.distrusted.push(section);
    }

    /// Runs a check of sections, unless one of them is distrusted: an error of values that are not
    /// its own would not be an error of the file.
    pub(super) fn of<T>(
        &mut self,
        sections: &[&str],
        check: impl FnOnce(&mut Self) -> T,
    ) -> Option<T> {
        let is_any_distrusted = sections
            .iter()
            .any(|section| self.distrusted.contains(section));
        (!is_any_distrusted).then(|| check(self))
    }

    /// Runs a check; returns true if it finds nothing.
    pub(super) fn none_in(&mut self, check: impl FnOnce(&mut Self)) -> bool {
        let before = self.found.len();
        check(self);
        self.found.len() == before
    }

    /// True if nothing was found.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.found.is_empty()
    }

    /// Returns all errors.
    #[must_use]
    pub fn into_all(self) -> Vec<Problem> {
        self.found
    }

    /// Returns the first error.
    #[must_use]
    pub fn into_first(self) -> Problem {
        let first = self.found.into_iter().next();
        first.unwrap_or_else(|| Problem::new("", "is not a robot file"))
    }
}

impl From<Problem> for Problems {
    fn from(problem: Problem) -> Self {
        Self {
            found: vec![problem],
            distrusted: Vec::new(),
        }
    }
}
