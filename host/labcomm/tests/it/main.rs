//! The crate through its public interface.
#![allow(
    missing_docs,
    clippy::arithmetic_side_effects,
    clippy::unwrap_used,
    clippy::panic,
    clippy::indexing_slicing,
    reason = "tests"
)]

mod hostile;
mod numbers;
mod page;
mod samples;
mod streams;
mod types;

use gantry_tau_labcomm::{Decoded, Decoder, Error, Event, Version};

/// Event of a stream, owned.
#[derive(Clone, Debug, PartialEq)]
enum Seen {
    Version(Version),
    Define(u32, Vec<u8>, Vec<u8>),
    Reference(u32, Vec<u8>, Vec<u8>),
    Data(u32, Vec<u8>),
    Skipped(u32),
}

impl From<Event<'_, '_>> for Seen {
    fn from(event: Event<'_, '_>) -> Self {
        match event {
            Event::Version(version) => Self::Version(version),
            Event::Define(of) => Self::Define(of.index, of.name.to_vec(), of.ty.bytes().to_vec()),
            Event::Reference(of) => {
                Self::Reference(of.index, of.name.to_vec(), of.ty.bytes().to_vec())
            }
            Event::Data { definition, value } => {
                Self::Data(definition.index, value.bytes().to_vec())
            }
            Event::Skipped(tag) => Self::Skipped(tag),
        }
    }
}

/// Events of a stream, whether it ends at a boundary, and its error.
fn decode(bytes: &[u8]) -> (Vec<Seen>, bool, Option<Error>) {
    let (mut decoder, mut rest, mut seen) = (Decoder::<8, 1024>::default(), bytes, Vec::new());
    loop {
        match decoder.decode(rest) {
            Ok(Decoded::Event { event, used }) => {
                seen.push(event.into());
                assert!(used > 0 && used <= rest.len());
                rest = &rest[used..];
            }
            Ok(Decoded::Need(least)) => {
                assert!(least > rest.len());
                return (seen, rest.is_empty(), None);
            }
            Err(error) => return (seen, rest.is_empty(), Some(error)),
        }
    }
}

/// Bytes of a hex text.
fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u8> = text.bytes().filter(u8::is_ascii_hexdigit).collect();
    digits
        .chunks(2)
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap())
        .collect()
}
