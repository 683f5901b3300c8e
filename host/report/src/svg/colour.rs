//! Colours of drawings.

use std::fmt;

/// Colour of a shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour {
    red: u8,
    green: u8,
    blue: u8,
    role: Option<&'static str>,
}

impl Colour {
    /// Text, and lines that matter as much.
    pub const INK: Self = Self::of(0x22_22_22).named("ink");
    /// Text and lines that matter less.
    pub const FAINT: Self = Self::of(0x77_77_77).named("faint");
    /// Lines behind a plot.
    pub const GRID: Self = Self::of(0xdd_dd_dd).named("grid");
    /// Background.
    pub const PAPER: Self = Self::of(0xff_ff_ff).named("paper");
    /// Something to look at first.
    pub const ALERT: Self = Self::of(0xcc_00_00);
    /// White on paper of any colour.
    pub const WHITE: Self = Self::of(0xff_ff_ff);

    /// Creates a colour from its red, green and blue, a byte each.
    #[must_use]
    pub const fn of(rgb: u32) -> Self {
        let [_, red, green, blue] = rgb.to_be_bytes();
        Self::rgb(red, green, blue)
    }

    /// Creates a colour.
    #[must_use]
    pub const fn rgb(red: u8, green: u8, blue: u8) -> Self {
        Self {
            red,
            green,
            blue,
            role: None,
        }
    }

    /// Gives the colour a role, for which the stylesheet of a page has colours of its own:
    /// `--ROLE` in `style.css`.
    #[must_use]
    pub const fn named(self, role: &'static str) -> Self {
        Self {
            role: Some(role),
            ..self
        }
    }

    pub(super) const fn role(self) -> Option<&'static str> {
        self.role
    }
}

impl fmt::Display for Colour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            red, green, blue, ..
        } = self;
        write!(f, "#{red:02x}{green:02x}{blue:02x}")
    }
}
