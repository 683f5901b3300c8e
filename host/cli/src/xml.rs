//! Elements of XML whose attributes are numbers, names and words.

use std::fmt;

/// An element with its attributes and the elements in it.
#[derive(Clone, Debug)]
pub(crate) struct Element {
    name: &'static str,
    attributes: String,
    inner: Vec<Self>,
}

impl Element {
    pub(crate) const fn new(name: &'static str) -> Self {
        Self {
            name,
            attributes: String::new(),
            inner: Vec::new(),
        }
    }

    /// Adds an attribute. The value has no character that XML escapes.
    #[must_use]
    pub(crate) fn with(mut self, name: &str, value: impl fmt::Display) -> Self {
        self.attributes += &format!(" {name}=\"{value}\"");
        self
    }

    /// Adds an attribute of a text for people.
    #[must_use]
    pub(crate) fn with_text(self, name: &str, text: &str) -> Self {
        let escaped = text
            .replace('&', "&amp;")
            .replace('<', "&lt;")
            .replace('>', "&gt;")
            .replace('"', "&quot;");
        self.with(name, escaped)
    }

    /// Adds an attribute of numbers, each with as many digits as tell it from its neighbours.
    #[must_use]
    pub(crate) fn with_numbers(self, name: &str, numbers: &[f64]) -> Self {
        let all: Vec<String> = numbers
            .iter()
            // -0.0 + 0.0 is +0.0.
            .map(|number| format!("{:?}", number + 0.0))
            .collect();
        self.with(name, all.join(" "))
    }

    /// Adds elements behind those that are in it.
    #[must_use]
    pub(crate) fn containing(mut self, inner: impl IntoIterator<Item = Self>) -> Self {
        self.inner.extend(inner);
        self
    }

    fn write(&self, f: &mut fmt::Formatter<'_>, depth: usize) -> fmt::Result {
        let (name, indent) = (self.name, 2 * depth);
        write!(f, "{:indent$}<{name}{}", "", self.attributes)?;
        if self.inner.is_empty() {
            return writeln!(f, "/>");
        }
        writeln!(f, ">")?;
        self.inner
            .iter()
            .try_for_each(|inner| inner.write(f, depth + 1))?;
        writeln!(f, "{:indent$}</{name}>", "")
    }
}

impl fmt::Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write(f, 0)
    }
}
