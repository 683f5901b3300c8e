//! Arrays of one length, side by side.
//!
//! Counted, not zipped: a model checker counts to `N` at once, but has to search for the distance
//! between two pointers. The compiler makes the same code of both.

/// Element by element.
#[inline]
pub(crate) fn zip<'a, A, B, const N: usize>(
    a: &'a [A; N],
    b: &'a [B; N],
) -> impl Iterator<Item = (&'a A, &'a B)> {
    (0..N).filter_map(|index| Some((a.get(index)?, b.get(index)?)))
}

/// One array.
#[inline]
pub(crate) fn each<A, const N: usize>(a: &[A; N]) -> impl Iterator<Item = &A> {
    (0..N).filter_map(|index| a.get(index))
}
