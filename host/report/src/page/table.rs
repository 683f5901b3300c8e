//! Tables of a page.

use crate::text::Text;

/// A table.
#[derive(Clone, Debug)]
pub struct Table {
    class: &'static str,
    html: String,
}

/// Cell of a table.
#[derive(Clone, Debug)]
pub struct Cell {
    html: String,
}

impl<T: Into<Text>> From<T> for Cell {
    fn from(text: T) -> Self {
        let html = text.into().into_html();
        Self {
            html: format!("<td>{html}</td>"),
        }
    }
}

impl Cell {
    /// Cell that names its row or its column.
    #[must_use]
    pub fn heading(text: impl Into<Text>) -> Self {
        let html = text.into().into_html();
        Self {
            html: format!("<th>{html}</th>"),
        }
    }

    /// Cell with a colour behind it: of a value from -1 to 1, none for 0.
    #[must_use]
    pub fn shaded(text: impl Into<Text>, value: f64) -> Self {
        let hue = if value < 0.0 { 220 } else { 20 };
        let lightness = 100.0 - 45.0 * value.abs();
        let html = text.into().into_html();
        Self {
            html: format!(
                "<td style=\"background:hsl({hue},80%,{lightness:.0}%);color:#222\">{html}</td>"
            ),
        }
    }

    /// Cell to be filled in by hand.
    #[must_use]
    pub fn tick_box() -> Self {
        Self::from("☐")
    }
}

impl Table {
    /// Creates a table with the names of its columns.
    #[must_use]
    pub fn new<T: Into<Text>>(columns: impl IntoIterator<Item = T>) -> Self {
        let mut table = Self {
            class: "data",
            html: String::new(),
        };
        table.row(columns.into_iter().map(Cell::heading));
        table
    }

    /// Creates a table without names of its columns.
    #[must_use]
    pub const fn unnamed() -> Self {
        Self {
            class: "data",
            html: String::new(),
        }
    }

    /// Draws a frame around every cell, as in a form on paper.
    #[must_use]
    pub fn framed(self) -> Self {
        Self {
            class: "form",
            ..self
        }
    }

    /// Adds a row.
    pub fn row<C: Into<Cell>>(&mut self, cells: impl IntoIterator<Item = C>) {
        let cells: String = cells.into_iter().map(|cell| cell.into().html).collect();
        self.html += &format!("<tr>{cells}</tr>\n");
    }

    /// Adds a row that begins with its name.
    pub fn named_row<C: Into<Cell>>(
        &mut self,
        name: impl Into<Text>,
        cells: impl IntoIterator<Item = C>,
    ) {
        let cells = cells.into_iter().map(Into::into);
        self.row(std::iter::once(Cell::heading(name)).chain(cells));
    }

    pub(super) fn into_html(self) -> String {
        format!(
            "<div class=\"wide\"><table class=\"{}\">\n{}</table></div>\n",
            self.class, self.html
        )
    }
}
