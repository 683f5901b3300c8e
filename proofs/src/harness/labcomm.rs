//! T16: any number, any bytes as a type or definition, a step of a walk from any place, any sample
//! of the thesis, any chunk.

use gantry_tau_labcomm::samples::{Data, ForceSensor};
use gantry_tau_labcomm::verification::Extent;
use gantry_tau_labcomm::{
    Collector, ErrorKind, MAX_NUMBER, MAX_VALUE, Reader, Registry, Type, Version,
};

use super::kani;
use crate::properties::labcomm::{
    chunk_is_collected, definition_is_judged, definition_is_kept, front_is_dropped,
    number_is_canonical, number_survives, product_is_bounded, sample_is_canonical, sample_survives,
    scan_advances, sizes_are_taken, walk_advances,
};

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

/// Check of a type: any type of any length that is there, or any error. Stands in for the steps of
/// the check, each of which is proved.
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

/// Product: any within what [`product_is_bounded`] says. Stands in for the multiplication.
#[allow(dead_code, reason = "named by functions that only Kani runs")]
fn any_product(one: u32, other: u32) -> Option<u32> {
    if one == 0 || other == 0 {
        return Some(0);
    }
    let product: u32 = kani::any();
    (product >= one && product >= other && product <= MAX_VALUE).then_some(product)
}

/// Sizes of an array: any that are there, of any number of elements, or any error. Stands in for
/// the loop over them, which is proved.
#[allow(dead_code, reason = "named by functions that only Kani runs")]
fn any_elements(
    _: u32,
    ty: &mut Reader<'_>,
    value: &mut Reader<'_>,
) -> Result<Option<u32>, ErrorKind> {
    if kani::any() {
        return Err(kani::any());
    }
    ty.read_exact(kani::any())?;
    value.read_exact(kani::any())?;
    Ok(Some(kani::any()).filter(|count| *count <= MAX_VALUE))
}

/// Any valid collector of 8 bytes.
fn any_collector() -> Collector<8> {
    let collector: Collector<8> = kani::any();
    assume!(
        collector.is_valid(),
        collector.held().len() == 8,
        "a full collector"
    );
    collector
}

harnesses! {
    labcomm_number_survives [minisat, unwind 7] { number_survives(kani::any(), kani::any()); }
    labcomm_number_is_canonical [minisat, unwind 7] {
        let bytes: [u8; 6] = kani::any();
        let is_number = number_is_canonical(kani::any(), &bytes[..any_length(6)]);
        kani::cover!(is_number, "some bytes are one");
    }
    labcomm_product_is_bounded [minisat] { product_is_bounded(kani::any(), kani::any()); }
    labcomm_type_is_total [cadical, unwind 18, stub(gantry_tau_labcomm::number::decode, crate::harness::labcomm::any_number), stub(gantry_tau_labcomm::verification::product, crate::harness::labcomm::any_product)] {
        let bytes: [u8; 24] = kani::any();
        let stepped = scan_advances(kani::any(), &bytes[..any_length(24)], kani::any());
        kani::cover!(stepped, "some places have a step");
    }
    labcomm_sizes_are_taken [cadical, unwind 14, stub(gantry_tau_labcomm::number::decode, crate::harness::labcomm::any_number), stub(gantry_tau_labcomm::verification::product, crate::harness::labcomm::any_product)] {
        let (bytes, value): ([u8; 12], [u8; 16]) = (kani::any(), kani::any());
        let (ty, value) = (&bytes[..any_length(12)], &value[..any_length(16)]);
        let is_array = sizes_are_taken(kani::any(), kani::any(), ty, value);
        kani::cover!(is_array, "some sizes are an array's");
    }
    labcomm_walk_advances [cadical, unwind 18, stub(gantry_tau_labcomm::number::decode, crate::harness::labcomm::any_number), stub(gantry_tau_labcomm::verification::product, crate::harness::labcomm::any_product), stub(gantry_tau_labcomm::verification::elements, crate::harness::labcomm::any_elements), stub(gantry_tau_labcomm::verification::scan, crate::harness::labcomm::any_scan)] {
        let (bytes, value): ([u8; 12], [u8; 16]) = (kani::any(), kani::any());
        let ty = Type::whole(kani::any(), &bytes);
        assume!(ty.is_ok(), true, "some bytes are a type");
        if let Ok(ty) = ty {
            let stepped = walk_advances(&ty, &value[..any_length(16)], kani::any());
            kani::cover!(stepped, "some places have a step");
        }
    }
    labcomm_definition_is_kept [cadical, unwind 9, stub(gantry_tau_labcomm::verification::scan, crate::harness::labcomm::any_scan)] {
        let (mut registry, name, bytes): (Registry<2, 8>, [u8; 4], [u8; 4]) = (kani::any(), kani::any(), kani::any());
        assume!(registry.is_valid(), registry.len() == 2, "a full registry");
        let (ty, length) = (Type::whole(registry.version(), &bytes[..any_length(4)]), any_length(4));
        assume!(ty.is_ok(), true, "some bytes are a type");
        if let Ok(ty) = ty {
            let is_taken = definition_is_kept(&mut registry, kani::any(), &name[..length], &ty, kani::any());
            kani::cover!(is_taken, "some definitions are taken");
        }
    }
    labcomm_definition_is_judged [cadical, unwind 3, stub(gantry_tau_labcomm::number::decode, crate::harness::labcomm::any_number), stub(gantry_tau_labcomm::verification::scan, crate::harness::labcomm::any_scan)] {
        let bytes: [u8; 32] = kani::any();
        let is_definition = definition_is_judged(kani::any(), &bytes[..any_length(32)]);
        kani::cover!(is_definition, "some bytes are a definition");
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
