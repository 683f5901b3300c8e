//! T11: contents of a black box.

use gantry_tau_core::control::session::recorder::Recorder;
use gantry_tau_core::control::session::{BlackBox, Input, Session};
use gantry_tau_core::units::Tick;

/// T11, the bookkeeping: the entries are ticks that follow each other without a gap, up to the
/// latest recorded one; the session they begin with is the one before the first; and there are
/// enough of them.
pub fn holds_the_end<const N: usize, const HALF: usize>(
    black_box: &BlackBox<N, HALF>,
    latest: Tick,
    recorded: usize,
) {
    let mut count = 0_usize;
    let mut last = black_box.before().map(Session::last_tick);
    for entry in black_box.entries() {
        let tick = entry.output.state.tick;
        assert!(
            last.map(|last| last.0 + 1) == Some(tick.0),
            "T11: no gap, from the session before the first on"
        );
        last = Some(tick);
        count += 1;
    }
    assert!(
        count == 0 || last == Some(latest),
        "T11: up to the latest tick"
    );
    assert!(
        count >= recorded.min(2 * HALF) && count <= 3 * HALF,
        "T11: at least 2 HALF ticks, where there were as many"
    );
}

/// A recorder of steps that are only numbered: the state is the number of the step before, an
/// output that of the step. What is recorded makes no difference to a [`Recorder`]: it is generic,
/// and so can only copy it.
pub type Numbered<const HALF: usize> = Recorder<u8, (), u8, HALF>;

/// Returns the number of entries if they are numbered one after the other from the state before
/// them on, up to `latest`.
#[must_use]
pub fn numbered_up_to<const HALF: usize>(recorder: &Numbered<HALF>, latest: u8) -> Option<usize> {
    let mut number = recorder.before().copied();
    let mut count = 0;
    for segment in recorder.segments() {
        let entries = segment.entries();
        if !entries.is_empty() && segment.before() != number.as_ref() {
            return None;
        }
        for index in 0..HALF {
            let Some(entry) = entries.get(index) else {
                break;
            };
            number = number.map(|number| number.wrapping_add(1));
            if number != Some(entry.output) {
                return None;
            }
            count += 1;
        }
    }
    (count == 0 || number == Some(latest)).then_some(count)
}

/// T11, one step: a valid recorder of numbered steps stays one; only what is older than `2 HALF`
/// steps is forgotten; recording goes on for `HALF` steps after an end, and what is frozen does not
/// change.
pub fn records_a_step<const HALF: usize>(recorder: &mut Numbered<HALF>, latest: u8, ends: bool) {
    let Some(count) = numbered_up_to(recorder, latest) else {
        return;
    };
    let (frozen, left) = (recorder.is_frozen(), recorder.left());
    let next = latest.wrapping_add(1);
    recorder.before_tick(&latest);
    recorder.after_tick(&(), &next, ends);
    assert!(recorder.is_valid(), "T11: the recorder stays valid");
    if frozen {
        assert!(recorder.is_frozen(), "T11: frozen until released");
        let kept = numbered_up_to(recorder, latest);
        assert!(kept == Some(count), "T11: what is frozen does not change");
        return;
    }
    let kept = numbered_up_to(recorder, next);
    assert!(
        kept == Some(count + 1) || (kept == Some(count + 1 - HALF) && count == 3 * HALF),
        "T11: no gap; only the oldest is forgotten, and only for want of room"
    );
    let expected = match left {
        Some(left) => Some(left - 1),
        None => ends.then_some(HALF),
    };
    assert!(
        recorder.left() == expected,
        "T11: HALF steps after the end, and no more"
    );
}

/// T11, released: a recorder is empty, and records as a new one does.
pub fn releases<const HALF: usize>(recorder: &mut Numbered<HALF>, next: u8, ends: bool) {
    recorder.release();
    assert!(
        recorder.is_valid() && !recorder.is_frozen(),
        "T11: released, it records"
    );
    let latest = next.wrapping_sub(1);
    assert!(
        numbered_up_to(recorder, latest) == Some(0),
        "T11: released, it holds no step"
    );
    assert!(
        recorder.before().is_none() && recorder.left().is_none(),
        "T11: released, it is empty"
    );
    recorder.before_tick(&latest);
    recorder.after_tick(&(), &next, ends);
    let begins = recorder.before() == Some(&latest) && numbered_up_to(recorder, next) == Some(1);
    assert!(
        begins,
        "T11: released, it begins with the state before the step"
    );
    assert!(
        recorder.left() == ends.then_some(HALF),
        "T11: released, it freezes again"
    );
}

/// T11: what is written over an older entry is what was given, for any earlier contents of the
/// place.
pub fn input_is_copied<const N: usize>(mut place: Input<N>, given: &Input<N>) {
    place.clone_from(given);
    assert!(
        place.tick == given.tick && place.epochs == given.epochs,
        "T11: the cycle is copied"
    );
    assert!(
        place.events.len() == given.events.len(),
        "T11: as many events"
    );
    for index in 0..given.events.len() {
        assert!(
            place.events.get(index) == given.events.get(index),
            "T11: every event is copied"
        );
    }
}
