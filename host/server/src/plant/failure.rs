//! Text of a machine's error in records, which are copied without an allocation.

use std::fmt::{self, Write};

/// Longest text, bytes.
const MAX_LEN: usize = 184;

/// Text of the error of a call to a [`Plant`](super::Plant), of at most 184 bytes; a longer one is
/// cut.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct PlantFailure {
    bytes: [u8; MAX_LEN],
    len: u8,
}

impl PlantFailure {
    /// Writes the text of an error.
    #[must_use]
    pub fn of(error: &impl fmt::Display) -> Self {
        let mut failure = Self {
            bytes: [0; MAX_LEN],
            len: 0,
        };
        // A text that is cut, and an error that cannot be shown, leave what was written before.
        let _ = write!(failure, "{error}");
        failure
    }

    /// Returns the text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let bytes = self.bytes.get(..usize::from(self.len)).unwrap_or_default();
        std::str::from_utf8(bytes).unwrap_or_default()
    }
}

impl Write for PlantFailure {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let room = self
            .bytes
            .get_mut(usize::from(self.len)..)
            .unwrap_or_default();
        let mut end = text.len().min(room.len());
        while !text.is_char_boundary(end) {
            end = end.saturating_sub(1);
        }
        let (Some(place), Some(taken)) = (room.get_mut(..end), text.as_bytes().get(..end)) else {
            return Err(fmt::Error);
        };
        place.copy_from_slice(taken);
        // At most MAX_LEN.
        self.len = self
            .len
            .saturating_add(u8::try_from(end).unwrap_or(u8::MAX));
        if end == text.len() {
            Ok(())
        } else {
            Err(fmt::Error)
        }
    }
}

impl fmt::Display for PlantFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl fmt::Debug for PlantFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_text_is_cut_at_a_character() {
        let short = PlantFailure::of(&"the bus does not answer");
        assert_eq!(short.as_str(), "the bus does not answer");
        let long = PlantFailure::of(&"\u{b5}".repeat(100));
        assert_eq!(long.as_str(), "\u{b5}".repeat(92));
        let odd = PlantFailure::of(&format!("a{}", "\u{b5}".repeat(100)));
        assert_eq!(odd.as_str(), format!("a{}", "\u{b5}".repeat(91)));
        assert_eq!(PlantFailure::of(&"").as_str(), "");
    }
}
