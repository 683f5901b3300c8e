//! A self-contained HTML page: headings, text, tables, pictures.
//!
//! A page takes text and escapes it; parts that are set apart are [`Text`], and pictures are
//! [`Svg`].

mod table;

use crate::svg::Svg;
pub use crate::text::Text;
pub use table::{Cell, Table};

/// Light, dark and print.
const STYLE: &str = include_str!("page/style.css");

/// A page.
#[derive(Clone, Debug)]
pub struct Page {
    title: Text,
    body: String,
}

impl Page {
    /// Creates a page with the title of its window and its heading.
    #[must_use]
    pub fn new(title: &str, heading: impl Into<Text>) -> Self {
        let mut page = Self {
            title: title.into(),
            body: String::new(),
        };
        page.element("h1", heading);
        page
    }

    /// Begins a section.
    pub fn section(&mut self, heading: impl Into<Text>) {
        self.element("h2", heading);
    }

    /// Begins a part of a section.
    pub fn subsection(&mut self, heading: impl Into<Text>) {
        self.element("h3", heading);
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: impl Into<Text>) {
        self.element("p", text);
    }

    /// Adds a paragraph on something that is not as it should be.
    pub fn warning(&mut self, text: impl Into<Text>) {
        self.body += &format!("<p class=\"bad\">{}</p>\n", text.into().into_html());
    }

    /// Adds lines whose columns are aligned.
    pub fn preformatted(&mut self, text: impl Into<Text>) {
        self.element("pre", text);
    }

    /// Adds a list.
    pub fn list<T: Into<Text>>(&mut self, items: impl IntoIterator<Item = T>) {
        self.items("ul", items);
    }

    /// Adds a numbered list.
    pub fn steps<T: Into<Text>>(&mut self, steps: impl IntoIterator<Item = T>) {
        self.items("ol", steps);
    }

    /// Adds a table.
    pub fn table(&mut self, table: Table) {
        self.body += &table.into_html();
    }

    /// Adds a picture.
    pub fn picture(&mut self, picture: &Svg) {
        self.body += &format!("<figure>{}</figure>\n", picture.as_str());
    }

    /// Adds pictures beside each other.
    pub fn pictures(&mut self, pictures: impl IntoIterator<Item = Svg>) {
        self.named_pictures(pictures.into_iter().map(|picture| ("", picture)));
    }

    /// Adds pictures with names beside each other.
    pub fn named_pictures<T: Into<Text>>(&mut self, pictures: impl IntoIterator<Item = (T, Svg)>) {
        self.body += "<div class=\"row\">\n";
        for (name, picture) in pictures {
            self.body += "<div>";
            let name = name.into();
            if !name.is_empty() {
                self.subsection(name);
            }
            self.picture(&picture);
            self.body += "</div>\n";
        }
        self.body += "</div>\n";
    }

    /// Adds what `content` adds; the printer keeps it on one sheet of paper.
    pub fn together(&mut self, content: impl FnOnce(&mut Self)) {
        self.body += "<section class=\"together\">\n";
        content(self);
        self.body += "</section>\n";
    }

    /// Returns the page.
    #[must_use]
    pub fn html(self) -> String {
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
             <title>{}</title><style>\n{STYLE}</style></head>\n<body>\n{}</body></html>\n",
            self.title.into_html(),
            self.body
        )
    }

    fn element(&mut self, tag: &str, text: impl Into<Text>) {
        self.body += &format!("<{tag}>{}</{tag}>\n", text.into().into_html());
    }

    fn items<T: Into<Text>>(&mut self, tag: &str, items: impl IntoIterator<Item = T>) {
        self.body += &format!("<{tag}>\n");
        for item in items {
            self.element("li", item);
        }
        self.body += &format!("</{tag}>\n");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::svg::Drawing;

    #[test]
    fn every_text_is_escaped_wherever_it_is_put() {
        const TEXT: &str = "<b>&\"";
        let mut page = Page::new(TEXT, TEXT);
        page.section(TEXT);
        page.subsection(TEXT.to_owned());
        page.paragraph(Text::from(TEXT).and(Text::code(TEXT)).and(TEXT));
        page.warning(Text::bad(TEXT));
        page.preformatted(TEXT);
        page.list([TEXT]);
        page.together(|page| page.steps([Text::strong(TEXT), Text::emphasis(TEXT)]));
        let mut table = Table::new([TEXT, TEXT]);
        table.row([TEXT, TEXT]);
        table.named_row(TEXT, [Cell::shaded(TEXT, -0.5), TEXT.into()]);
        page.table(table);
        page.named_pictures([(TEXT, Drawing::new(1.0, 1.0).finish(TEXT, TEXT))]);
        let html = page.html();
        assert_eq!(html.matches("&lt;b&gt;&amp;&quot;").count(), 23);
        assert!(!html.contains(TEXT));
    }

    /// A colour with a role has a rule for its fill and for its outline, in light and in dark.
    #[test]
    fn the_stylesheet_has_every_role_in_light_and_dark() {
        let phases = [
            "phase-0", "phase-1", "phase-2", "phase-3", "phase-4", "phase-5",
        ];
        for role in ["ink", "faint", "grid", "paper"].iter().chain(&phases) {
            assert_eq!(STYLE.matches(&format!("--{role}:")).count(), 2, "{role}");
            assert!(
                STYLE.contains(&format!(".fill-{role}{{fill:var(--{role})}}")),
                "{role}"
            );
        }
    }
}
