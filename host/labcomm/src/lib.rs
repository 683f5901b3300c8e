#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(feature = "verification"),
    allow(
        unreachable_pub,
        dead_code,
        reason = "internals that only the module `verification` makes public"
    )
)]

#[cfg(kani)]
extern crate kani;

mod cursor;
mod decoder;
mod encoder;
mod error;
pub mod number;
mod registry;
mod sample;
pub mod samples;
mod ty;
mod value;
#[cfg(feature = "verification")]
pub mod verification;
mod walk;

pub use cursor::{Comparer, Counter, Reader, Sink, Writer};
pub use decoder::{Collector, Decoded, Decoder, Event, MAX_NAME};
pub use encoder::Encoder;
pub use error::{Error, ErrorKind, Limit, Malformed, Unsupported};
pub use number::{MAX_NUMBER, Version};
pub use registry::{Definition, Registry};
pub use sample::{Field, Sample, Text, encoded_value_len, type_len};
pub use ty::scan::{ARRAY, MAX_DEPTH, MAX_FIELDS, MAX_TYPE, MAX_VALUE, Primitive, STRUCTURE};
pub use ty::{Array, Fields, Indices, Kind, Structure, Type};
pub use value::Value;
pub use walk::{Leaf, Place, Sizes, Step, Walk, value_len};
