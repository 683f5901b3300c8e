//! Measured columns of a table that stand a row away from what was set when they were measured.

use std::fmt;

/// Row in which measured columns stand, by that to which they belong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MovedRows {
    /// The next one.
    Later,
    /// The one before.
    Earlier,
}

impl MovedRows {
    /// Each of them.
    pub(crate) const ALL: [Self; 2] = [Self::Later, Self::Earlier];

    /// Rows as they were set, each with the row in which what was measured then stands. There is
    /// one less.
    pub(crate) fn pairs<T>(self, rows: &[T]) -> impl Iterator<Item = (&T, &T)> {
        let later = rows.get(1..).unwrap_or_default();
        let (set, measured) = match self {
            Self::Later => (rows, later),
            Self::Earlier => (later, rows),
        };
        set.iter().zip(measured)
    }
}

impl fmt::Display for MovedRows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (when, to) = match self {
            Self::Later => ("later", "up"),
            Self::Earlier => ("earlier", "down"),
        };
        write!(
            f,
            "stand a row {when} than the others; move them {to} by a row"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_measured_is_found_in_the_next_row_or_the_one_before() {
        fn pairs(rows: &[u8]) -> [Vec<(u8, u8)>; 2] {
            MovedRows::ALL.map(|moved| moved.pairs(rows).map(|(a, b)| (*a, *b)).collect())
        }
        assert_eq!(
            pairs(&[1, 2, 3]),
            [vec![(1, 2), (2, 3)], vec![(2, 1), (3, 2)]]
        );
        assert_eq!(pairs(&[1]), [vec![], vec![]]);
        assert_eq!(pairs(&[]), [vec![], vec![]]);
        let said = MovedRows::ALL.map(|moved| moved.to_string());
        assert_eq!(
            said[0],
            "stand a row later than the others; move them up by a row"
        );
        assert_eq!(
            said[1],
            "stand a row earlier than the others; move them down by a row"
        );
    }
}
