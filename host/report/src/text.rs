//! Text of a page: escaped where it is put in.

/// Text of a page. Parts of it may be set apart.
#[derive(Clone, Debug, Default)]
pub struct Text {
    html: String,
}

impl Text {
    /// File names, keys, commands.
    #[must_use]
    pub fn code(text: &str) -> Self {
        Self::within("code", text)
    }

    /// Words in another sense than usual.
    #[must_use]
    pub fn emphasis(text: &str) -> Self {
        Self::within("em", text)
    }

    /// What matters most of its surroundings.
    #[must_use]
    pub fn strong(text: &str) -> Self {
        Self::within("b", text)
    }

    /// An exponent.
    #[must_use]
    pub fn raised(text: &str) -> Self {
        Self::within("sup", text)
    }

    /// Something that is not as it should be.
    #[must_use]
    pub fn bad(text: &str) -> Self {
        let Self { html } = Self::from(text);
        Self {
            html: format!("<span class=\"bad\">{html}</span>"),
        }
    }

    /// Continues the text.
    #[must_use]
    pub fn and(mut self, more: impl Into<Self>) -> Self {
        self.html += &more.into().html;
        self
    }

    fn within(tag: &str, text: &str) -> Self {
        let Self { html } = Self::from(text);
        Self {
            html: format!("<{tag}>{html}</{tag}>"),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.html.is_empty()
    }

    /// Returns the text as HTML, which may also stand between double quotes.
    pub(crate) fn into_html(self) -> String {
        self.html
    }
}

impl From<&str> for Text {
    fn from(text: &str) -> Self {
        let html = text
            .replace('&', "&amp;")
            .replace('<', "&lt;")
            .replace('>', "&gt;")
            .replace('"', "&quot;");
        Self { html }
    }
}

impl From<String> for Text {
    fn from(text: String) -> Self {
        Self::from(text.as_str())
    }
}

impl From<&String> for Text {
    fn from(text: &String) -> Self {
        Self::from(text.as_str())
    }
}
