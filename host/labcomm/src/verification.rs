//! Items for proofs and fuzzing, without a promise of stability.

pub use crate::scan::{Extent, Scan, ScanPlace, scan};
