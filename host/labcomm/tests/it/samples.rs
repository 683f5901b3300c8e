use gantry_tau_labcomm::samples::{Axes, Data, ForceSensor, SessionEvent, State, Tool};
use gantry_tau_labcomm::{
    Decoded, Decoder, Encoder, ErrorKind, Event, Field, Limit, Sample, Text, Type, Version, Writer,
    type_len,
};

use super::decode;

/// Bytes of a definition and of one sample.
fn sizes<T: Sample>(version: Version, value: &T) -> (usize, usize) {
    let mut buffer = [0; 512];
    let mut encoder = Encoder::new(version, &mut buffer);
    encoder.define::<T>(version.first_index()).unwrap();
    let definition = encoder.len();
    encoder.data(version.first_index(), value).unwrap();
    (definition, encoder.len() - definition)
}

fn both<T: Sample>(value: &T) -> [(usize, usize); 2] {
    [Version::V2006, Version::V2014].map(|version| sizes(version, value))
}

/// The numbers were counted on the peer's encoder.
#[test]
fn definitions_and_samples_have_the_sizes_of_the_peer() {
    assert_eq!(both(&Data::ZERO), [(32, 16), (13, 14)]);
    assert_eq!(both(&ForceSensor::ZERO), [(39, 28), (20, 26)]);
    assert_eq!(both(&State::ZERO), [(182, 77), (106, 75)]);
    assert_eq!(both(&Axes::<3>::ZERO), [(291, 147), (196, 146)]);
    assert_eq!(both(&Tool::ZERO), [(162, 136), (77, 135)]);
    assert_eq!(
        both(&SessionEvent {
            text: Text::cut("session granted"),
            ..Field::ZERO
        }),
        [(82, 33), (45, 28)]
    );
}

#[test]
fn values_survive_and_are_found_by_their_definition() {
    let event = SessionEvent {
        tick: 7,
        kind: 2,
        cause: 3,
        text: Text::cut("geräusch"),
    };
    let axes = Axes::<6> {
        tick: -1,
        ..Field::ZERO
    };
    let tool = Tool {
        tick: i64::MAX,
        step: 4,
        load: [f64::MIN_POSITIVE; 6],
        ..Field::ZERO
    };
    for version in [Version::V2006, Version::V2014, Version::V2014_0] {
        let mut buffer = [0; 2048];
        let mut encoder = Encoder::new(version, &mut buffer);
        encoder.version().unwrap();
        encoder.define::<SessionEvent>(0x90).unwrap();
        encoder.define::<Axes<6>>(0x91).unwrap();
        encoder.define::<Tool>(0x4000).unwrap();
        encoder.data(0x90, &event).unwrap();
        encoder.data(0x91, &axes).unwrap();
        encoder.data(0x4000, &tool).unwrap();
        let mut decoder = Decoder::<4, 1024>::default();
        let (mut rest, mut found) = (encoder.bytes(), 0);
        while let Ok(Decoded::Event { event: seen, used }) = decoder.decode(rest) {
            if let Event::Data { definition, value } = seen {
                found += 1;
                assert!(!definition.is::<Axes<3>>());
                if definition.is::<SessionEvent>() {
                    assert_eq!(value.read(), Ok(event));
                } else if definition.is::<Tool>() {
                    assert_eq!(value.read(), Ok(tool));
                    assert!(value.read::<SessionEvent>().is_err());
                } else {
                    assert!(definition.is::<Axes<6>>());
                    assert_eq!(value.read(), Ok(axes));
                }
            }
            rest = &rest[used..];
        }
        assert_eq!((found, rest.len()), (3, 0));
    }
}

/// A buffer of any size holds whole packets, and says when the next does not fit.
#[test]
fn a_full_buffer_holds_whole_packets() {
    for version in [Version::V2006, Version::V2014] {
        for size in 0..=90 {
            let mut buffer = vec![0; size];
            let mut encoder = Encoder::new(version, &mut buffer);
            let written = [
                encoder.version(),
                encoder.define::<Data>(0x80),
                encoder.data(0x80, &Data([1, 2, 3])),
            ];
            let full = written
                .iter()
                .filter(|written| **written == Err(ErrorKind::Limit(Limit::Room)))
                .count();
            let whole =
                written.len() - full - usize::from(version == Version::V2006 && written[0].is_ok());
            let bytes = encoder.bytes().to_vec();
            // Without its version packet a stream of 2014 is none.
            if written[0].is_ok() && (written[1].is_ok() || written[2].is_err()) {
                let (seen, at_boundary, error) = decode(&bytes);
                assert_eq!(
                    (seen.len(), at_boundary, error),
                    (whole, true, None),
                    "{version:?}, {size} bytes"
                );
            }
        }
    }
}

#[test]
fn indices_below_0x40_are_tags() {
    let mut buffer = [0; 64];
    let mut encoder = Encoder::new(Version::V2014, &mut buffer);
    assert!(encoder.define::<Data>(0x3f).is_err());
    assert!(encoder.data(2, &Data::ZERO).is_err());
    assert!(encoder.is_empty());
}

#[test]
fn types_known_at_run_time_are_written_alike() {
    for version in [Version::V2006, Version::V2014] {
        let (mut fixed, mut dynamic, mut ty) = ([0; 256], [0; 256], [0; 64]);
        let mut sink = Writer::new(version, &mut ty);
        ForceSensor::write_type(&mut sink);
        let length = sink.finish().unwrap();
        assert_eq!(length, type_len::<ForceSensor>(version));
        let ty = Type::whole(version, &ty[..length]).unwrap();
        let mut encoder = Encoder::new(version, &mut fixed);
        encoder.define::<ForceSensor>(0x80).unwrap();
        encoder.data(0x80, &ForceSensor([1.0; 6])).unwrap();
        let mut other = Encoder::new(version, &mut dynamic);
        other.define_type(0x80, b"forcesensor", &ty).unwrap();
        let value = 1.0_f32.to_be_bytes().repeat(6);
        other.data_bytes(0x80, &ty, &value).unwrap();
        assert_eq!(encoder.bytes(), other.bytes());
        assert!(other.data_bytes(0x80, &ty, &value[1..]).is_err());
    }
}

#[test]
fn texts_are_cut_between_characters() {
    assert_eq!(Text::<4>::cut("aåbc").as_bytes(), "aåb".as_bytes());
    assert_eq!(Text::<2>::cut("aå").as_bytes(), b"a");
}
