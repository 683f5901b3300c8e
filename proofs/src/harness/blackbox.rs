//! Any recorder in any valid state, one step.

use gantry_tau_core::control::session::recorder::{Entries, Entry, Recorder, Segment};

use super::kani;
use crate::blackbox::{Numbered, numbered_up_to, records_a_step};

/// Any valid segment: any number of entries ever written, any number of them in use.
fn any_segment<const HALF: usize>() -> Option<Segment<u8, (), u8, HALF>> {
    let written: usize = kani::any();
    let mut entries = Entries::new();
    for index in 0..HALF {
        if index < written {
            let output = kani::any();
            assert!(entries.push(Entry { input: (), output }).is_ok(), "there is room");
        }
    }
    Segment::from_parts(kani::any(), entries, kani::any())
}

fn any_recorder<const HALF: usize>() -> Option<Numbered<HALF>> {
    let segments = [any_segment()?, any_segment()?, any_segment()?];
    Recorder::from_parts(segments, kani::any(), kani::any())
}

fn records_any_step<const HALF: usize>() {
    let Some(mut recorder) = any_recorder::<HALF>() else {
        return;
    };
    let latest = kani::any();
    let full = numbered_up_to(&recorder, latest) == Some(3 * HALF);
    let frozen = recorder.is_frozen();
    records_a_step(&mut recorder, latest, kani::any());
    kani::cover!(full & frozen, "a full recorder, frozen");
    kani::cover!(full & !frozen, "a full recorder");
}

harnesses! {
    blackbox_of_1_records_a_step [minisat, unwind 5] { records_any_step::<1>(); }
    blackbox_of_2_records_a_step [minisat, unwind 5] { records_any_step::<2>(); }
    blackbox_of_3_records_a_step [minisat, unwind 5] { records_any_step::<3>(); }
}
