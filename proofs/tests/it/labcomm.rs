//! T16 on stable Rust: types and values that are drawn, whole walks and streams, noise, random
//! cuts.

use gantry_tau_labcomm::samples::{Data, ForceSensor, SessionEvent, Tool};
use gantry_tau_labcomm::{
    Collector, Decoded, Decoder, Encoder, Error, ErrorKind, Place, Registry, Sink, Type, Version,
    Walk, Writer, value_len,
};
use gantry_tau_proofs::properties::labcomm::{
    broken_stays_broken, chunk_is_collected, decode_is_judged, definition_is_judged,
    definition_is_kept, front_is_dropped, number_is_canonical, number_survives, product_is_bounded,
    sample_is_canonical, sample_survives, sizes_are_taken, type_is_judged, walk_advances,
};
use proptest::collection::vec;
use proptest::prelude::*;

fn version() -> impl Strategy<Value = Version> {
    prop_oneof![
        Just(Version::V2006),
        Just(Version::V2014),
        Just(Version::V2014_0)
    ]
}

/// Type of LabComm as a tree, apart from the crate's own.
#[derive(Clone, Debug)]
enum Tree {
    Leaf(u32),
    Array(Vec<u32>, Box<Tree>),
    Structure(Vec<Tree>),
}

fn tree() -> impl Strategy<Value = Tree> {
    (0x20_u32..0x28)
        .prop_map(Tree::Leaf)
        .prop_recursive(4, 24, 4, |inner| {
            prop_oneof![
                (vec(0_u32..4, 0..3), inner.clone())
                    .prop_map(|(sizes, element)| Tree::Array(sizes, Box::new(element))),
                vec(inner, 0..4).prop_map(Tree::Structure),
            ]
        })
}

impl Tree {
    fn write(&self, sink: &mut Writer<'_>) {
        match self {
            Self::Leaf(code) => sink.number(*code),
            Self::Array(sizes, element) => {
                sink.number(0x10);
                sink.number(u32::try_from(sizes.len()).unwrap());
                sizes.iter().for_each(|size| sink.number(*size));
                element.write(sink);
            }
            Self::Structure(fields) => {
                sink.number(0x11);
                sink.number(u32::try_from(fields.len()).unwrap());
                for field in fields {
                    sink.text(b"x");
                    field.write(sink);
                }
            }
        }
    }

    /// Writes a value; `draw` gives sizes and bytes.
    fn write_value(&self, sink: &mut Writer<'_>, draw: &mut impl FnMut() -> u8) {
        match self {
            Self::Leaf(0x27) => {
                let text: Vec<u8> = (0..draw() % 5).map(|_| draw()).collect();
                sink.text(&text);
            }
            Self::Leaf(code) => {
                let length = [1, 1, 2, 4, 8, 4, 8][usize::try_from(code - 0x20).unwrap()];
                (0..length).for_each(|_| sink.array([draw()]));
            }
            Self::Array(sizes, element) => {
                let mut count = 1;
                for size in sizes {
                    let mut size = *size;
                    if size == 0 {
                        size = (draw() % 3).into();
                        sink.number(size);
                    }
                    count *= size;
                }
                (0..count).for_each(|_| element.write_value(sink, draw));
            }
            Self::Structure(fields) => fields
                .iter()
                .for_each(|field| field.write_value(sink, draw)),
        }
    }

    /// True if an array in it has elements without bytes.
    fn has_empty_element(&self) -> bool {
        match self {
            Self::Leaf(_) => false,
            Self::Array(_, element) => element.is_empty() || element.has_empty_element(),
            Self::Structure(fields) => fields.iter().any(Self::has_empty_element),
        }
    }

    fn is_empty(&self) -> bool {
        matches!(self, Self::Structure(fields) if fields.iter().all(Self::is_empty))
    }
}

/// Bytes written by a function.
fn bytes(version: Version, write: impl FnOnce(&mut Writer<'_>)) -> Vec<u8> {
    let mut room = vec![0; 1 << 16];
    let mut writer = Writer::new(version, &mut room);
    write(&mut writer);
    let length = writer.finish().unwrap();
    room.truncate(length);
    room
}

/// Every step of a walk over a value; the number of bytes it took.
fn walk_to_the_end(ty: &Type<'_>, value: &[u8]) -> Result<usize, ErrorKind> {
    let mut walk = Walk::new(ty, value);
    let mut steps = 0;
    loop {
        let stepped = walk_advances(ty, walk.rest(), *walk.place());
        let step = walk.step()?;
        assert_eq!(stepped, step.is_some());
        steps += 1;
        // Each level is entered and left, each field named, for each element, of which each takes a
        // byte.
        assert!(
            steps <= 4 * (ty.bytes().len() + 1) * (value.len() + 1),
            "T16: steps are bounded"
        );
        if step.is_none() {
            return Ok(value.len() - walk.rest().len());
        }
    }
}

fn noise() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![
        0_u8..6,
        0x10_u8..0x12,
        0x20_u8..0x29,
        0x40_u8..0x43,
        0x7e_u8..0x83,
        any::<u8>()
    ];
    vec(byte, 0..64)
}

/// Ends of the events of a stream that is decoded in chunks, and the error that ends it.
fn ends_of_events(stream: &[u8], mut chunk: impl FnMut() -> usize) -> Vec<Result<usize, Error>> {
    let mut decoder = Decoder::<4, 512>::new(4096);
    let (mut given, mut ends) = (0, Vec::new());
    while given < stream.len() {
        given = (given + chunk()).min(stream.len());
        loop {
            let start = usize::try_from(decoder.offset()).unwrap();
            let mut copy = decoder.clone();
            let _ = decode_is_judged(&mut copy, &stream[start..given]);
            match decoder.decode(&stream[start..given]) {
                Ok(Decoded::Event { used, .. }) => ends.push(Ok(start + used)),
                Ok(Decoded::Need(_)) => break,
                Err(error) => {
                    broken_stays_broken(&mut decoder, &stream[start..given]);
                    ends.push(Err(error));
                    return ends;
                }
            }
        }
    }
    ends
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn numbers(version in version(), number: u32, shift in 0_u32..32, bytes in vec(prop_oneof![Just(0x80_u8), any::<u8>()], 0..7)) {
        number_survives(version, number >> shift);
        let _ = number_is_canonical(version, &bytes);
    }

    #[test]
    fn products(one: u32, other: u32, shifts in (0_u32..32, 0_u32..32)) {
        product_is_bounded(one >> shifts.0, other >> shifts.1);
    }

    #[test]
    fn sizes(version in version(), sizes in vec(0_u32..400, 0..6), of_value in vec(0_u32..400, 0..6), extra in 0_u32..2, tail in noise()) {
        let ty = bytes(version, |sink| sizes.iter().for_each(|size| sink.number(*size)));
        let value = bytes(version, |sink| of_value.iter().for_each(|size| sink.number(*size)));
        let indices = u32::try_from(sizes.len()).unwrap();
        let _ = sizes_are_taken(version, indices + extra, &ty, &value);
        let _ = sizes_are_taken(version, indices, &[&ty[..], &tail].concat(), &tail);
        // Those of the value stand where the type has none.
        let mut open = of_value.iter().copied();
        let all: Option<Vec<u32>> = sizes.iter().map(|size| if *size == 0 { open.next() } else { Some(*size) }).collect();
        let counted = all.is_some_and(|all| {
            all.contains(&0) || all.iter().try_fold(1_u64, |product, size| Some(product * u64::from(*size)).filter(|p| *p <= 1 << 24)).is_some()
        });
        prop_assert_eq!(sizes_are_taken(version, indices, &ty, &value), counted);
    }

    #[test]
    fn definitions(version in version(), tree in tree(), indices in vec(0x40_u32..0x44, 1..5), name in vec(any::<u8>(), 0..9), tail in noise(), at in 0_usize..40) {
        let ty_bytes = bytes(version, |sink| tree.write(sink));
        let Ok(ty) = Type::whole(version, &ty_bytes) else { return Ok(()) };
        let mut registry = Registry::<3, 64>::new(version);
        for index in indices {
            let (known, used) = (registry.get(index).is_some(), registry.len() * (name.len() + ty_bytes.len()));
            let has_room = registry.len() < 3 && used + name.len() + ty_bytes.len() <= 64;
            prop_assert_eq!(definition_is_kept(&mut registry, index, &name, &ty, at), known || has_room);
        }
        let definition = bytes(version, |sink| {
            sink.number(0x40);
            sink.text(&name);
            if version.is_packed() { sink.text(&ty_bytes) } else { sink.slice(&ty_bytes) }
        });
        prop_assert!(definition_is_judged(version, &definition));
        let _ = definition_is_judged(version, &[&definition[..], &tail].concat());
        let _ = definition_is_judged(version, &tail);
    }

    #[test]
    fn types_and_values(version in version(), tree in tree(), seed in vec(any::<u8>(), 1..20), place in noise()) {
        let ty_bytes = bytes(version, |sink| tree.write(sink));
        let judged = type_is_judged(version, &ty_bytes);
        prop_assert_eq!(judged, !tree.has_empty_element(), "T16: a type is one unless an element takes no bytes");
        let Ok(ty) = Type::whole(version, &ty_bytes) else { return Ok(()) };
        let mut drawn = seed.iter().cycle().copied();
        let value = bytes(version, |sink| tree.write_value(sink, &mut || drawn.next().unwrap()));
        prop_assert_eq!(walk_to_the_end(&ty, &value), Ok(value.len()));
        prop_assert_eq!(value_len(&ty, &value), Ok(value.len()), "T16: skipped as far as walked");
        prop_assert_eq!(value_len(&ty, &[&value[..], &place].concat()), Ok(value.len()));
        for cut in 0..value.len() {
            prop_assert_eq!(value_len(&ty, &value[..cut]), Err(ErrorKind::Incomplete), "T16: a part is incomplete");
        }
        // Any bytes: the walk and the length agree.
        prop_assert_eq!(walk_to_the_end(&ty, &place), value_len(&ty, &place));
    }

    #[test]
    fn bytes_as_types(version in version(), bytes in noise(), value in noise()) {
        let _ = type_is_judged(version, &bytes);
        if let Ok((ty, _)) = Type::parse(version, &bytes) {
            let _ = walk_to_the_end(&ty, &value);
            let _ = walk_advances(&ty, &value, Place::START);
        }
    }

    #[test]
    fn any_stream_any_cut(version in version(), tree in tree(), tail in noise(), cuts in vec(0_usize..30, 1..6), flip in any::<(u16, u8)>()) {
        let mut stream = vec![0; 1 << 12];
        let mut encoder = Encoder::new(version, &mut stream);
        encoder.version().unwrap();
        let ty_bytes = bytes(version, |sink| tree.write(sink));
        encoder.define::<Tool>(0x80).unwrap();
        if let Ok(ty) = Type::whole(version, &ty_bytes) {
            let value = bytes(version, |sink| tree.write_value(sink, &mut || 2));
            encoder.define_type(0x81, b"tree", &ty).unwrap();
            prop_assert!(encoder.data_bytes(0x81, &ty, &value).is_ok() || value.len() > 2000);
        }
        let mut stream = [encoder.bytes(), &tail].concat();
        let at = usize::from(flip.0) % stream.len();
        stream[at] ^= flip.1;
        // Whole, and in chunks behind each other: the same events end at the same places.
        let mut lengths = cuts.iter().cycle();
        let whole = ends_of_events(&stream, || usize::MAX / 2);
        prop_assert_eq!(whole, ends_of_events(&stream, || lengths.next().unwrap() + 1), "T16: any split");
    }

    #[test]
    fn samples(version in version(), data: [i32; 3], force: [u32; 6], bytes: [u8; 24]) {
        sample_survives::<Data, 12>(version, &Data(data));
        sample_survives::<ForceSensor, 24>(version, &ForceSensor(force.map(f32::from_bits)));
        sample_is_canonical::<ForceSensor, 24>(version, &bytes);
        let event = SessionEvent { tick: data[0].into(), kind: bytes[0], cause: bytes[1], text: gantry_tau_labcomm::Text::cut("end") };
        if version == Version::V2014 {
            sample_survives::<SessionEvent, 14>(version, &event);
        }
    }

    #[test]
    fn chunks(held in vec(any::<u8>(), 0..33), chunk in vec(any::<u8>(), 0..40), at in 0_usize..80, dropped in 0_usize..80) {
        let mut collector = Collector::<32>::new();
        prop_assert_eq!(collector.append(&held), held.len().min(32));
        chunk_is_collected(&collector, &chunk, at);
        front_is_dropped(&collector, dropped, at);
    }
}
