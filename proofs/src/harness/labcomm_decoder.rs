//! T16: any bytes into any decoder. What it calls is replaced by any outcome; `labcomm` proves
//! these.

use gantry_tau_labcomm::verification::Extent;
use gantry_tau_labcomm::{
    Decoder, Definition, ErrorKind, MAX_NUMBER, Reader, Registry, Type, Version,
};

use super::kani;
use crate::properties::labcomm::{broken_stays_broken, decode_is_judged};

/// Any length that is at most this.
fn any_length(most: usize) -> usize {
    let length = kani::any();
    assume!(length <= most, length == most, "the longest");
    length
}

/// Number: any, of one to five bytes that are there, or any error. Stands in for its decoding,
/// which is proved.
#[allow(dead_code, reason = "named by functions that only Kani runs")]
fn any_number(_: Version, bytes: &[u8]) -> Result<(u32, usize), ErrorKind> {
    let taken: usize = kani::any();
    if (1..=MAX_NUMBER.min(bytes.len())).contains(&taken) {
        Ok((kani::any(), taken))
    } else {
        Err(kani::any())
    }
}

/// Number of bytes of a value: that of its type, or any that is there, or any error. Stands in for
/// the walk over a whole value, whose every step is proved.
#[allow(dead_code, reason = "named by functions that only Kani runs")]
fn any_value_len(ty: &Type<'_>, bytes: &[u8]) -> Result<usize, ErrorKind> {
    if let Some(size) = ty.fixed_size() {
        return if size <= bytes.len() {
            Ok(size)
        } else {
            Err(ErrorKind::Incomplete)
        };
    }
    if kani::any() {
        return Err(kani::any());
    }
    let length: usize = kani::any();
    if length <= bytes.len() {
        Ok(length)
    } else {
        Err(ErrorKind::Incomplete)
    }
}

/// Type of a definition in the stream: a byte. The decoder hands it on, and does not look into it.
#[allow(dead_code, reason = "named by functions that only Kani runs")]
fn one_byte(_: Version, bytes: &[u8]) -> Result<(Extent, usize), ErrorKind> {
    Ok((
        Extent {
            smallest: 1,
            fixed: true,
        },
        bytes.len(),
    ))
}

/// Definition in a stream: any that is there, or any error. Its name and type, which the decoder
/// hands on, are the same for all.
#[allow(dead_code, reason = "named by functions that only Kani runs")]
fn any_definition<'b>(reader: &mut Reader<'b>) -> Result<Definition<'b>, ErrorKind> {
    if kani::any() {
        return Err(kani::any());
    }
    reader.read_exact(kani::any())?;
    Ok(Definition {
        index: kani::any(),
        name: &[],
        ty: Type::whole(reader.version(), &[0x21])?,
    })
}

/// Definition: taken or not, and any valid registry behind it. Stands in for the registry, of which
/// this is proved.
#[allow(dead_code, reason = "named by functions that only Kani runs")]
fn any_define<const S: usize, const B: usize>(
    registry: &mut Registry<S, B>,
    _: u32,
    _: &[u8],
    _: &Type<'_>,
) -> Result<(), ErrorKind> {
    let after: Registry<S, B> = kani::any();
    if after.is_valid() {
        *registry = after;
    }
    if kani::any() {
        Ok(())
    } else {
        Err(kani::any())
    }
}

harnesses! {
    labcomm_broken_stays_broken [cadical, unwind 18, stub(gantry_tau_labcomm::number::decode, crate::harness::labcomm_decoder::any_number), stub(gantry_tau_labcomm::verification::scan, crate::harness::labcomm_decoder::one_byte), stub(gantry_tau_labcomm::value_len, crate::harness::labcomm_decoder::any_value_len), stub(gantry_tau_labcomm::Registry::define, crate::harness::labcomm_decoder::any_define), stub(gantry_tau_labcomm::verification::unframed_definition, crate::harness::labcomm_decoder::any_definition), stub(gantry_tau_labcomm::verification::packed_definition, crate::harness::labcomm_decoder::any_definition)] {
        let (mut decoder, bytes): (Decoder<2, 16>, [u8; 32]) = (kani::any(), kani::any());
        assume!(decoder.is_valid() && decoder.error().is_some(), decoder.registry().len() == 2, "a full registry");
        broken_stays_broken(&mut decoder, &bytes[..any_length(32)]);
    }
    labcomm_decode_is_total [cadical, unwind 18, stub(gantry_tau_labcomm::number::decode, crate::harness::labcomm_decoder::any_number), stub(gantry_tau_labcomm::verification::scan, crate::harness::labcomm_decoder::one_byte), stub(gantry_tau_labcomm::value_len, crate::harness::labcomm_decoder::any_value_len), stub(gantry_tau_labcomm::Registry::define, crate::harness::labcomm_decoder::any_define), stub(gantry_tau_labcomm::verification::unframed_definition, crate::harness::labcomm_decoder::any_definition), stub(gantry_tau_labcomm::verification::packed_definition, crate::harness::labcomm_decoder::any_definition)] {
        let (mut decoder, bytes): (Decoder<2, 16>, [u8; 32]) = (kani::any(), kani::any());
        assume!(decoder.is_valid(), decoder.registry().len() == 2, "a full registry");
        let is_event = decode_is_judged(&mut decoder, &bytes[..any_length(32)]);
        kani::cover!(is_event, "some bytes are an event");
    }
}
