//! LabComm: T16. Numbers, types, one step of a walk, one event of a stream, the samples of the
//! thesis, and the collector.

use gantry_tau_labcomm::number::{decode, encode};
use gantry_tau_labcomm::verification::{
    Scan, ScanPlace, elements, packed_definition, product, unframed_definition,
};
use gantry_tau_labcomm::{
    Collector, Decoded, Decoder, Event, Field, Kind, MAX_DEPTH, MAX_NUMBER, MAX_TYPE, MAX_VALUE,
    Place, Reader, Registry, Step, Type, Version, Walk, Writer,
};

/// From a number to bytes and back: the same number, in as many bytes as were written.
pub fn number_survives(version: Version, number: u32) {
    let bytes = encode(version, number);
    let length = bytes.as_slice().len();
    assert!(
        (1..=MAX_NUMBER).contains(&length),
        "T16: a number has 1 to 5 bytes"
    );
    assert!(
        decode(version, bytes.as_slice()) == Ok((number, length)),
        "T16: decode(encode(n)) = n"
    );
}

/// From bytes to a number and back: the same bytes. True if they begin with one.
#[must_use]
pub fn number_is_canonical(version: Version, bytes: &[u8]) -> bool {
    let Ok((number, taken)) = decode(version, bytes) else {
        return false;
    };
    assert!(taken >= 1 && taken <= bytes.len(), "T16: consumed <= given");
    let again = encode(version, number);
    let again = again.as_slice();
    assert!(again.len() == taken, "T16: one length");
    for at in 0..MAX_NUMBER {
        assert!(
            at >= taken || again[at] == bytes[at],
            "T16: decode(b) = n => encode(n) = b"
        );
    }
    true
}

/// Bytes are a type at their front or not; a type lies within the bytes and within the limits, and
/// has a kind. Its bytes alone are the same type. True if there is one.
#[must_use]
pub fn type_is_judged(version: Version, bytes: &[u8]) -> bool {
    let Ok((ty, length)) = Type::parse(version, bytes) else {
        return false;
    };
    assert!(
        length >= 1 && length <= bytes.len() && length <= MAX_TYPE,
        "T16: consumed <= given"
    );
    assert!(
        ty.bytes().len() == length,
        "T16: a type is the front of the bytes"
    );
    assert!(
        u32::try_from(ty.smallest_size()).is_ok_and(|size| size <= MAX_VALUE),
        "T16: no value exceeds the limit"
    );
    if let Kind::Primitive(primitive) = ty.kind() {
        assert!(
            u32::from(bytes[0]) == primitive.code() || !version.is_packed(),
            "T16: a primitive is its code"
        );
    }
    true
}

/// A product is at most the limit, zero exactly if a factor is, and else no less than either; it is
/// refused only beyond the limit.
pub fn product_is_bounded(one: u32, other: u32) {
    match product(one, other) {
        Some(product) => {
            assert!(product <= MAX_VALUE, "T16: no product exceeds the limit");
            assert!(
                (product == 0) == (one == 0 || other == 0),
                "T16: a product is zero where a factor is"
            );
            assert!(
                product == 0 || (product >= one && product >= other),
                "T16: a product is no less than its factors"
            );
        }
        None => assert!(one > 0 && other > 0, "T16: zero is not refused"),
    }
}

/// One step of the check of a type, from any valid place: it takes a byte or leaves a level, and
/// leaves a valid place; a type that is complete is within the limits. True if there is a step.
#[must_use]
pub fn scan_advances(version: Version, bytes: &[u8], place: ScanPlace) -> bool {
    let Some(mut scan) = Scan::from_parts(version, bytes, place) else {
        return false;
    };
    let step = scan.step();
    let (left, depth) = (scan.rest().len(), scan.place().depth());
    assert!(left <= bytes.len(), "T16: consumed <= given");
    assert!(depth <= MAX_DEPTH, "T16: the stack has room");
    let Ok(step) = step else { return false };
    assert!(scan.place().is_valid(), "T16: the place stays valid");
    assert!(
        left < bytes.len() || depth < place.depth(),
        "T16: a step takes a byte, or leaves what took one"
    );
    if let Some(extent) = step {
        assert!(depth == 0, "T16: a type ends outside of all");
        assert!(
            extent.smallest <= MAX_VALUE,
            "T16: no value exceeds the limit"
        );
    }
    true
}

/// Sizes of an array: each takes a byte of the type, none goes past an end, and their product is
/// within the limit. True if there is one.
#[must_use]
pub fn sizes_are_taken(version: Version, indices: u32, ty: &[u8], value: &[u8]) -> bool {
    let (mut of_type, mut of_value) = (Reader::new(version, ty), Reader::new(version, value));
    let count = elements(indices, &mut of_type, &mut of_value);
    assert!(
        of_type.rest().len() <= ty.len() && of_value.rest().len() <= value.len(),
        "T16: sizes end within the bytes"
    );
    let Ok(count) = count else { return false };
    assert!(
        usize::try_from(indices).is_ok_and(|sizes| sizes <= ty.len() - of_type.rest().len()),
        "T16: a size takes a byte"
    );
    assert!(
        count.is_none_or(|count| count <= MAX_VALUE),
        "T16: no array exceeds the limit"
    );
    count.is_some()
}

/// One step of a walk from any valid place: it ends, takes what is there, and leaves a valid place.
/// True if there is a step.
#[must_use]
pub fn walk_advances(ty: &Type<'_>, value: &[u8], place: Place) -> bool {
    let Some(mut walk) = Walk::from_parts(ty, value, place) else {
        return false;
    };
    let step = walk.step();
    assert!(walk.is_valid(), "T16: the place stays valid");
    assert!(walk.place().depth() <= MAX_DEPTH, "T16: the stack has room");
    let left = walk.rest().len();
    assert!(left <= value.len(), "T16: never past the end");
    match step {
        Ok(Some(Step::Leaf(_))) => assert!(left < value.len(), "T16: a value takes a byte"),
        Ok(Some(Step::Array(_))) => {
            let is_bounded =
                usize::try_from(walk.place().left()).is_ok_and(|elements| elements <= left);
            assert!(
                is_bounded,
                "T16: as many elements as there are bytes, at most"
            );
        }
        Ok(Some(Step::Leave)) => {
            assert!(walk.place().depth() < MAX_DEPTH, "T16: a level is left");
        }
        Ok(Some(_)) => {}
        Ok(None) | Err(_) => return false,
    }
    true
}

/// Anything given to a decoder in any valid state: an event lies within the bytes, a need goes
/// beyond them, the decoder stays valid, and keeps an error. True if there is an event.
#[must_use]
pub fn decode_is_judged<const S: usize, const B: usize>(
    decoder: &mut Decoder<S, B>,
    bytes: &[u8],
) -> bool {
    let before = decoder.offset();
    let (used, error) = match decoder.decode(bytes) {
        Ok(Decoded::Event { event, used }) => {
            if let Event::Data { value, .. } = event {
                let length = value.bytes().len();
                assert!(length < used, "T16: a value lies behind its index");
                assert!(
                    value.ty().fixed_size().is_none_or(|size| size == length),
                    "T16: a value has the length of its type"
                );
            }
            (used, None)
        }
        Ok(Decoded::Need(least)) => {
            assert!(least > bytes.len(), "T16: a need goes beyond what is there");
            (0, None)
        }
        Err(error) => (0, Some(error)),
    };
    assert!(used <= bytes.len(), "T16: consumed <= given");
    assert!(decoder.is_valid(), "T16: the registry stays valid");
    let moved = before.saturating_add(u64::try_from(used).unwrap_or(u64::MAX));
    assert!(
        decoder.offset() == moved,
        "T16: the place is where the bytes end"
    );
    assert!(
        error.is_none() || decoder.error() == error,
        "T16: an error is kept"
    );
    used > 0
}

/// Anything given to a decoder that has ended with an error: the same error.
pub fn broken_stays_broken<const S: usize, const B: usize>(
    decoder: &mut Decoder<S, B>,
    bytes: &[u8],
) {
    let before = decoder.error();
    let again = decoder.decode(bytes).err();
    assert!(
        before.is_none() || (again == before && decoder.error() == before),
        "T16: broken stays broken"
    );
}

/// Definition at the front of bytes, of either generation: what it takes is there, and its name and
/// type lie within. True if there is one.
#[must_use]
pub fn definition_is_judged(version: Version, bytes: &[u8]) -> bool {
    let mut reader = Reader::new(version, bytes);
    let defined = if version.is_packed() {
        packed_definition(&mut reader)
    } else {
        unframed_definition(&mut reader)
    };
    let left = reader.rest().len();
    assert!(left <= bytes.len(), "T16: consumed <= given");
    let Ok(definition) = defined else {
        return false;
    };
    let within = definition.name.len() + definition.ty.bytes().len();
    assert!(
        within < bytes.len() - left,
        "T16: name and type lie behind an index"
    );
    assert!(definition.index >= 0x40, "T16: an index is no tag");
    assert!(
        left == 0 || !version.is_packed(),
        "T16: a definition fills its packet"
    );
    true
}

/// One more definition in any valid registry: it stays valid; what was defined is found, or as many
/// definitions as before. The byte `at` speaks for every byte of name and type. True if it is
/// taken.
#[must_use]
pub fn definition_is_kept<const S: usize, const B: usize>(
    registry: &mut Registry<S, B>,
    index: u32,
    name: &[u8],
    ty: &Type<'_>,
    at: usize,
) -> bool {
    let (before, defined) = (registry.len(), registry.define(index, name, ty));
    assert!(registry.is_valid(), "T16: the registry stays valid");
    if defined.is_err() {
        assert!(
            registry.len() == before,
            "T16: what is refused is not counted"
        );
        return false;
    }
    let Some(kept) = registry.get(index) else {
        panic!("T16: what is defined is found")
    };
    assert!(
        kept.name.len() == name.len() && kept.ty.bytes().len() == ty.bytes().len(),
        "T16: all of a definition"
    );
    assert!(
        at >= name.len() || kept.name[at] == name[at],
        "T16: a name is kept"
    );
    assert!(
        at >= ty.bytes().len() || kept.ty.bytes()[at] == ty.bytes()[at],
        "T16: a type is kept"
    );
    true
}

/// A sample as bytes and back: the same bytes, `LENGTH` of them.
pub fn sample_survives<T: Field, const LENGTH: usize>(version: Version, value: &T) {
    let bytes = written::<T, LENGTH>(version, value);
    let mut reader = Reader::new(version, &bytes);
    let Ok(read) = T::read(&mut reader) else {
        panic!("T16: what is encoded decodes")
    };
    assert!(reader.rest().is_empty(), "T16: consumed is all of a value");
    assert!(
        written::<T, LENGTH>(version, &read) == bytes,
        "T16: decode(encode(v)) = v, by its bits"
    );
}

/// Bytes of a sample, and back: the same bytes.
pub fn sample_is_canonical<T: Field, const LENGTH: usize>(version: Version, bytes: &[u8; LENGTH]) {
    let mut reader = Reader::new(version, bytes);
    let Ok(read) = T::read(&mut reader) else {
        panic!("T16: any bytes of its length are a value")
    };
    assert!(reader.rest().is_empty(), "T16: consumed is all of a value");
    assert!(
        written::<T, LENGTH>(version, &read) == *bytes,
        "T16: decode(b) = v => encode(v) = b"
    );
}

fn written<T: Field, const LENGTH: usize>(version: Version, value: &T) -> [u8; LENGTH] {
    let mut bytes = [0; LENGTH];
    let mut writer = Writer::new(version, &mut bytes);
    value.write(&mut writer);
    assert!(writer.finish() == Ok(LENGTH), "T16: a value has its length");
    bytes
}

/// One chunk behind what is held: a row of bytes, so that no cut changes what is decoded from it.
/// The byte `at` speaks for every byte.
pub fn chunk_is_collected<const C: usize>(before: &Collector<C>, chunk: &[u8], at: usize) {
    let mut after = before.clone();
    let taken = after.append(chunk);
    let (old, held) = (before.held(), after.held());
    assert!(taken <= chunk.len(), "T16: consumed <= given");
    assert!(after.is_valid(), "T16: the collector stays valid");
    assert!(
        taken == chunk.len() || held.len() == C,
        "T16: all of a chunk, or as much as there is room for"
    );
    assert!(held.len() == old.len() + taken, "T16: as many as taken");
    let row = if at < old.len() {
        old[at]
    } else {
        chunk.get(at - old.len()).copied().unwrap_or_default()
    };
    assert!(
        at >= held.len() || row == held[at],
        "T16: held is what was held, and what was taken"
    );
}

/// Bytes off the front: the others stay, in their order. The byte `at` speaks for every byte.
pub fn front_is_dropped<const C: usize>(before: &Collector<C>, count: usize, at: usize) {
    let mut after = before.clone();
    after.drop_front(count);
    let (old, left) = (before.held(), after.held());
    let gone = old.len().min(count);
    assert!(after.is_valid(), "T16: the collector stays valid");
    assert!(left.len() == old.len() - gone, "T16: as many are left");
    assert!(
        at >= left.len() || old[at + gone] == left[at],
        "T16: what is left is the end of the row"
    );
}
