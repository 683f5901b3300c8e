//! LabComm: any bytes as a stream, and any text as lines to encode (T16).

use gantry_tau_labcomm::{Decoded, Decoder, Encoder, Error, ErrorKind, Event, Version};
use gantry_tau_proofs::properties::labcomm::{broken_stays_broken, decode_is_judged};
use gantry_tau_record::labcomm::{decode, encode};

use crate::labcomm::agree;

/// Small, so that a stream of a fuzzer can fill it.
type StreamDecoder = Decoder<4, 256>;

/// Largest number of bytes of a value.
const MAX_VALUE: u32 = 4096;

/// The bytes are the stream: whole and cut it has the same events, each event has no other bytes
/// than those it came in, and a second decoder finds the same.
pub fn labcomm(data: &[u8]) {
    let _ = agree(data);
    let whole = ends(data, data.len());
    for length in [1, 7, 64] {
        assert_eq!(ends(data, length), whole, "T16: any split");
    }
}

/// Offsets behind each event of a stream that comes in chunks of a length, and its error.
fn ends(stream: &[u8], length: usize) -> (Vec<usize>, Option<Error>) {
    let (mut decoder, mut ends, mut start) = (StreamDecoder::new(MAX_VALUE), Vec::new(), 0);
    for given in (0..stream.len())
        .step_by(length.max(1))
        .map(|from| (from + length).min(stream.len()))
    {
        loop {
            // Long streams once only: each copy has all definitions.
            if stream.len() < 1000 {
                let _ = decode_is_judged(&mut decoder.clone(), &stream[start..given]);
            }
            match decoder.decode(&stream[start..given]) {
                Ok(Decoded::Event { event, used }) => {
                    let version = match event {
                        Event::Version(version) => version,
                        Event::Define(definition) | Event::Reference(definition) => {
                            definition.ty.version()
                        }
                        Event::Data { definition, .. } => definition.ty.version(),
                        Event::Skipped(_) => Version::V2014,
                    };
                    event_is_canonical(version, &event, &stream[start..start + used]);
                    start += used;
                    ends.push(start);
                }
                Ok(Decoded::Need(_)) => break,
                Err(error) => {
                    broken_stays_broken(&mut decoder, &stream[start..given]);
                    return (ends, Some(error));
                }
            }
        }
    }
    (ends, None)
}

/// An event that can be sent is encoded to the bytes that it came in.
fn event_is_canonical(version: Version, event: &Event<'_, '_>, bytes: &[u8]) {
    let mut room = vec![0; bytes.len()];
    let mut encoder = Encoder::new(version, &mut room);
    let written = match event {
        Event::Version(_) => encoder.version(),
        Event::Define(of) => encoder.define_type(of.index, of.name, &of.ty),
        Event::Data { definition, value } => {
            encoder.data_bytes(definition.index, &definition.ty, value.bytes())
        }
        Event::Reference(_) | Event::Skipped(_) => return,
    };
    assert_eq!(
        written,
        Ok::<(), ErrorKind>(()),
        "T16: what decodes can be encoded"
    );
    assert_eq!(
        encoder.bytes(),
        bytes,
        "T16: decode(b) = e => encode(e) = b"
    );
}

/// The bytes are lines to encode: what is encoded decodes, and its lines are encoded to the same
/// bytes.
pub fn labcomm_json(data: &[u8]) {
    for version in [Version::V2006, Version::V2014] {
        let mut stream = Vec::new();
        // A line that cannot be encoded ends it; what stands before it is a stream.
        let _ = encode(version, data, &mut stream);
        let mut lines = Vec::new();
        assert!(
            decode(&stream[..], &mut lines, true).is_ok_and(|is_whole| is_whole),
            "what is encoded decodes"
        );
        let mut again = Vec::new();
        let encoded = encode(version, &lines[..], &mut again);
        assert!(encoded.is_ok(), "what is decoded is encoded: {encoded:?}");
        // A boolean is any byte but 0, of which 1 is sent; a size of an array without elements is
        // not in its lines.
        assert!(again.len() <= stream.len(), "no longer than before");
        let mut same = Vec::new();
        assert!(
            decode(&again[..], &mut same, true).is_ok(),
            "and decodes again"
        );
        assert_eq!(
            without_places(&same),
            without_places(&lines),
            "to the same events"
        );
    }
}

fn without_places(lines: &[u8]) -> Vec<serde_json::Value> {
    let lines = std::str::from_utf8(lines).unwrap().lines();
    let read = lines.map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    read.map(|mut event| {
        event["at"].take();
        event
    })
    .collect()
}
