//! Any recorder in any valid state, one step.

use gantry_tau_core::control::session::recorder::{Entries, Entry, Recorder, Segment};
use gantry_tau_core::control::session::{Events, Input};

use super::kani;
use crate::properties::blackbox::{
    Numbered, input_is_copied, numbered_up_to, records_a_step, releases,
};

/// Any valid segment: any number of entries ever written, any number of them in use.
fn any_segment<const HALF: usize>() -> Option<Segment<u8, (), u8, HALF>> {
    let written: usize = kani::any();
    let mut entries = Entries::new();
    for index in 0..HALF {
        if index < written {
            let output = kani::any();
            assert!(
                entries.push(Entry { input: (), output }).is_ok(),
                "there is room"
            );
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

fn releases_any<const HALF: usize>() {
    let Some(mut recorder) = any_recorder::<HALF>() else {
        return;
    };
    kani::cover!(recorder.is_frozen(), "a frozen recorder");
    releases(&mut recorder, kani::any(), kani::any());
}

/// Any input with up to two events.
fn any_input() -> Input<1> {
    let mut input = Input {
        last_write: kani::any(),
        arrival_us: kani::any(),
        unauthentic: kani::any(),
        tick: kani::any(),
        epochs: kani::any(),
        events: Events::new(),
    };
    for _ in 0..2 {
        if kani::any() {
            assert!(input.events.push(kani::any()).is_ok(), "there is room");
        }
    }
    input
}

harnesses! {
    blackbox_of_1_records_a_step [minisat, unwind 5] { records_any_step::<1>(); }
    blackbox_of_2_records_a_step [minisat, unwind 5] { records_any_step::<2>(); }
    blackbox_of_3_records_a_step [minisat, unwind 5] { records_any_step::<3>(); }
    blackbox_of_3_is_released [minisat, unwind 5] { releases_any::<3>(); }
    blackbox_input_is_copied [minisat, unwind 4] {
        let (place, given) = (any_input(), any_input());
        kani::cover!(place.events.len() > given.events.len(), "fewer events than before");
        kani::cover!(place.events.len() < given.events.len(), "more events than before");
        input_is_copied(place, &given);
    }
}
