//! Items for proofs and fuzzing, without a promise of stability.

pub use crate::decoder::{packed_definition, unframed_definition};
pub use crate::ty::scan::{Extent, Scan, ScanPlace, product, scan};
pub use crate::walk::elements;
