//! LabComm decoded twice: by the crate, and by a second decoder that was written from
//! `docs/labcomm.md` by somebody who had not read the crate.

pub mod second_decoder;

use gantry_tau_labcomm::{
    Decoded, Decoder, Definition, ErrorKind, Kind, Leaf, MAX_VALUE, Malformed, Step, Walk,
};

use second_decoder::{Ending, Event, Type, Value};

/// Decoder with the limits of the page. Boxed: about 80 KiB.
type StreamDecoder = Box<Decoder<256, 65_536>>;

/// Decodes a stream by both; fails if they find different events, or end differently.
///
/// Where the bytes end within an item that is beyond a limit already, one may say so before the
/// other: the page allows both.
pub fn agree(stream: &[u8]) -> (Vec<Event>, Ending) {
    let (events, ending) = by_crate(stream);
    let (second_events, second_ending) = second_decoder::decode(stream);
    assert_eq!(
        events, second_events,
        "events of {stream:02x?}: {ending:?}, {second_ending:?}"
    );
    let same = match (&ending, &second_ending) {
        (Ending::Clean, Ending::Clean) | (Ending::Incomplete, Ending::Incomplete) => true,
        (Ending::Refused(_), Ending::Refused(_)) => true,
        (Ending::Incomplete, Ending::Refused(why)) | (Ending::Refused(why), Ending::Incomplete) => {
            why.contains("limit")
        }
        _ => false,
    };
    assert!(
        same,
        "{stream:02x?} ends with {ending:?}, by the second decoder {second_ending:?}"
    );
    (events, ending)
}

/// Decodes by the crate, into the events of the second decoder.
pub fn by_crate(stream: &[u8]) -> (Vec<Event>, Ending) {
    let mut decoder: StreamDecoder = Box::new(Decoder::new(MAX_VALUE));
    let (mut events, mut start) = (Vec::new(), 0);
    while start < stream.len() {
        let at = decoder.offset();
        match decoder.decode(&stream[start..]) {
            Ok(Decoded::Event { event, used }) => {
                events.push(event_of(at, &event));
                start += used;
            }
            Ok(Decoded::Need(least)) => {
                assert!(
                    least > stream.len() - start,
                    "more is needed than there was"
                );
                return (events, Ending::Incomplete);
            }
            Err(error) => {
                assert_ne!(
                    error.kind,
                    ErrorKind::Incomplete,
                    "bytes that are missing are no error of a stream that goes on"
                );
                // A packed number of five bytes that goes on is beyond 32 bits already.
                let is_limit = matches!(
                    error.kind,
                    ErrorKind::Limit(_) | ErrorKind::Malformed(Malformed::LargeNumber)
                );
                let limit = if is_limit { "limit: " } else { "" };
                return (events, Ending::Refused(format!("{limit}{error}")));
            }
        }
    }
    (events, Ending::Clean)
}

fn event_of(at: u64, event: &gantry_tau_labcomm::Event<'_, '_>) -> Event {
    use gantry_tau_labcomm::Event as Crate;
    match event {
        Crate::Version(version) => Event::Version {
            at,
            text: version.text().unwrap().as_bytes().to_vec(),
        },
        Crate::Define(definition) => {
            let (index, name, kind) = declaration(definition);
            Event::Define {
                at,
                index,
                name,
                kind,
            }
        }
        Crate::Reference(definition) => {
            let (index, name, kind) = declaration(definition);
            Event::Reference {
                at,
                index,
                name,
                kind,
            }
        }
        Crate::Data { definition, value } => Event::Data {
            at,
            index: definition.index,
            value: flat(value),
        },
        Crate::Skipped(tag) => Event::Skip { at, tag: *tag },
    }
}

fn declaration(of: &Definition<'_>) -> (u32, Vec<u8>, Type) {
    (of.index, of.name.to_vec(), type_of(&of.ty))
}

fn type_of(ty: &gantry_tau_labcomm::Type<'_>) -> Type {
    match ty.kind() {
        Kind::Primitive(primitive) => Type::Basic(primitive.code()),
        Kind::Array(array) => Type::Array(
            array.indices().collect(),
            Box::new(type_of(&array.element())),
        ),
        Kind::Structure(structure) => Type::Struct(
            structure
                .fields()
                .map(|(name, ty)| (name.to_vec(), type_of(&ty)))
                .collect(),
        ),
    }
}

/// Leaves of a value, and the sizes that are in its bytes, in the order of the stream. The steps of
/// the walk must be those of the type.
fn flat(value: &gantry_tau_labcomm::Value<'_, '_>) -> Vec<Value> {
    let (mut walk, mut out) = (value.walk(), Vec::new());
    flatten(&value.ty(), &mut walk, &mut out);
    assert!(
        walk.step().unwrap().is_none() && walk.rest().is_empty(),
        "the walk ends with the value"
    );
    out
}

fn flatten(ty: &gantry_tau_labcomm::Type<'_>, walk: &mut Walk<'_, '_>, out: &mut Vec<Value>) {
    let step = walk.step().unwrap().expect("a step of the value");
    match (ty.kind(), step) {
        (Kind::Primitive(_), Step::Leaf(leaf)) => return out.push(leaf_of(leaf)),
        (Kind::Array(array), Step::Array(sizes)) => {
            let mut elements = 1_u64;
            for (of_type, size) in array.indices().zip(sizes) {
                elements = elements.saturating_mul(u64::from(size));
                if of_type == 0 {
                    out.push(Value::Size(size));
                } else {
                    assert_eq!(size, of_type, "a fixed size");
                }
            }
            let element = array.element();
            (0..elements).for_each(|_| flatten(&element, walk, out));
        }
        (Kind::Structure(structure), Step::Structure(fields)) => {
            assert_eq!(
                structure.fields().count(),
                usize::try_from(fields).unwrap(),
                "number of fields"
            );
            for (name, field) in structure.fields() {
                assert!(
                    matches!(walk.step().unwrap(), Some(Step::Field(of_walk)) if of_walk == name),
                    "name of a field"
                );
                flatten(&field, walk, out);
            }
        }
        (_, step) => panic!("{step:?} is no step of {ty:?}"),
    }
    assert!(
        matches!(walk.step().unwrap(), Some(Step::Leave)),
        "end of an array or a structure"
    );
}

fn leaf_of(leaf: Leaf<'_>) -> Value {
    match leaf {
        Leaf::Boolean(byte) => Value::Boolean(byte != 0),
        Leaf::Byte(byte) => Value::Byte(byte),
        Leaf::Short(number) => Value::Short(number),
        Leaf::Int(number) => Value::Int(number),
        Leaf::Long(number) => Value::Long(number),
        Leaf::Float(bits) => Value::Float(bits),
        Leaf::Double(bits) => Value::Double(bits),
        Leaf::String(bytes) => Value::Text(bytes.to_vec()),
        Leaf::Reference(index) => Value::Sample(index),
    }
}
