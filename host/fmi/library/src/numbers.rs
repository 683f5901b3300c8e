//! Numbers by which a master knows components and saved states.

use std::sync::atomic::{AtomicUsize, Ordering};

static NUMBERS: AtomicUsize = AtomicUsize::new(1);

/// Returns a number that no component and no state has had.
pub(crate) fn fresh_number() -> usize {
    NUMBERS.fetch_add(1, Ordering::Relaxed)
}
