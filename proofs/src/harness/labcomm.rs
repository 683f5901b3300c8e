//! T16: any number, any bytes as a type, a step of a walk from any place, any bytes into any decoder, any sample of the thesis, any chunk.

use gantry_tau_labcomm::samples::{Data, ForceSensor};
use gantry_tau_labcomm::verification::Extent;
use gantry_tau_labcomm::{Collector, Decoder, ErrorKind, MAX_NUMBER, MAX_VALUE, Type, Version};

use super::kani;
use crate::labcomm::{
    chunk_is_collected, decode_is_judged, front_is_dropped, number_is_canonical, number_survives, sample_is_canonical,
    sample_survives, scan_advances, walk_advances,
};

/// Any length that is at most this.
fn any_length(most: usize) -> usize {
    let length = kani::any();
    assume!(length <= most, length == most, "the longest");
    length
}

/// Number of bytes of a value: that of its type, or any that is there, or any error. Stands in for the walk over a whole value, whose every
/// step is proved.
#[allow(dead_code, reason = "named by functions that only Kani runs")]
fn any_value_len(ty: &Type<'_>, bytes: &[u8]) -> Result<usize, ErrorKind> {
    if let Some(size) = ty.fixed_size() {
        return if size <= bytes.len() { Ok(size) } else { Err(ErrorKind::Incomplete) };
    }
    if kani::any() {
        return Err(kani::any());
    }
    let length: usize = kani::any();
    if length <= bytes.len() { Ok(length) } else { Err(ErrorKind::Incomplete) }
}

/// Number: any, of one to five bytes that are there, or any error. Stands in for its decoding, which is proved.
#[allow(dead_code, reason = "named by functions that only Kani runs")]
fn any_number(_: Version, bytes: &[u8]) -> Result<(u32, usize), ErrorKind> {
    let taken: usize = kani::any();
    if (1..=MAX_NUMBER.min(bytes.len())).contains(&taken) { Ok((kani::any(), taken)) } else { Err(kani::any()) }
}

/// Check of a type: any type of any length that is there, or any error. Stands in for the steps of the check, each of which is proved.
#[allow(dead_code, reason = "named by functions that only Kani runs")]
fn any_scan(_: Version, bytes: &[u8]) -> Result<(Extent, usize), ErrorKind> {
    if kani::any() {
        return Err(kani::any());
    }
    let (extent, length): (Extent, usize) = (kani::any(), kani::any());
    if length <= bytes.len() && extent.smallest <= MAX_VALUE {
        Ok((extent, length))
    } else {
        Err(ErrorKind::Incomplete)
    }
}

/// Any valid collector of 8 bytes.
fn any_collector() -> Collector<8> {
    let collector: Collector<8> = kani::any();
    assume!(collector.is_valid(), collector.held().len() == 8, "a full collector");
    collector
}

harnesses! {
    labcomm_number_survives [minisat, unwind 7] { number_survives(kani::any(), kani::any()); }
    labcomm_number_is_canonical [minisat, unwind 7] {
        let bytes: [u8; 6] = kani::any();
        let is_number = number_is_canonical(kani::any(), &bytes[..any_length(6)]);
        kani::cover!(is_number, "some bytes are one");
    }
    labcomm_type_is_total [cadical, unwind 18, stub(gantry_tau_labcomm::number::decode, crate::harness::labcomm::any_number)] {
        let bytes: [u8; 8] = kani::any();
        let stepped = scan_advances(kani::any(), &bytes[..any_length(8)], kani::any());
        kani::cover!(stepped, "some places have a step");
    }
    labcomm_walk_advances [cadical, unwind 18, stub(gantry_tau_labcomm::number::decode, crate::harness::labcomm::any_number), stub(gantry_tau_labcomm::verification::scan, crate::harness::labcomm::any_scan)] {
        let (bytes, value): ([u8; 8], [u8; 16]) = (kani::any(), kani::any());
        let ty = Type::whole(kani::any(), &bytes);
        assume!(ty.is_ok(), true, "some bytes are a type");
        if let Ok(ty) = ty {
            let stepped = walk_advances(&ty, &value[..any_length(16)], kani::any());
            kani::cover!(stepped, "some places have a step");
        }
    }
    labcomm_decode_is_total [cadical, unwind 18, stub(gantry_tau_labcomm::number::decode, crate::harness::labcomm::any_number), stub(gantry_tau_labcomm::verification::scan, crate::harness::labcomm::any_scan), stub(gantry_tau_labcomm::value_len, crate::harness::labcomm::any_value_len)] {
        let mut decoder: Decoder<2, 16> = kani::any();
        assume!(decoder.is_valid(), decoder.registry().len() == 2, "a full registry");
        let bytes: [u8; 16] = kani::any();
        let is_event = decode_is_judged(&mut decoder, &bytes[..any_length(16)]);
        kani::cover!(is_event, "some bytes are an event");
    }
    labcomm_thesis_samples_survive [minisat, unwind 26] {
        sample_survives::<Data, 12>(kani::any(), &Data(kani::any()));
        let bits: [u32; 6] = kani::any();
        sample_survives::<ForceSensor, 24>(kani::any(), &ForceSensor(bits.map(f32::from_bits)));
    }
    labcomm_thesis_samples_are_canonical [minisat, unwind 26] {
        sample_is_canonical::<Data, 12>(kani::any(), &kani::any());
        sample_is_canonical::<ForceSensor, 24>(kani::any(), &kani::any());
    }
    labcomm_chunk_is_collected [minisat, unwind 10] {
        let chunk: [u8; 4] = kani::any();
        chunk_is_collected(&any_collector(), &chunk[..any_length(4)], kani::any());
    }
    labcomm_front_is_dropped [minisat, unwind 10] { front_is_dropped(&any_collector(), kani::any(), kani::any()); }
}
