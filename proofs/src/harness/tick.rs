//! A tick and its parts: any session, any fate of the last write, at most one event, each of the parts an
//! unknown function of what reaches it. And its events: at most two, the classification of one of them
//! an unknown function.

use core::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

use gantry_tau_core::control::session::{
    Connection, Event, Events, Input, LastWrite, Output, Session, TickInput,
};
use gantry_tau_core::units::{EpochRange, PositionNm};
use gantry_tau_core::verification::control::{
    Accepted, Classifier, Diagnostics, Internals, Parts, no_output,
};

use super::kani;
use crate::properties::{session, tick};
use crate::stand_in;

/// The number that each function depends on, of a session and of its other arguments; and the axis of
/// all of them. Each chosen apart: what one passes on, the next must be able to look at.
static OF_WRITE: AtomicUsize = AtomicUsize::new(0);
static OF_EVENTS: AtomicUsize = AtomicUsize::new(0);
static OF_STEP: AtomicUsize = AtomicUsize::new(0);
static AXIS: AtomicUsize = AtomicUsize::new(0);
/// Calls of [`apply_write_result`], [`classify`] and [`step`].
static SETTLEMENTS: AtomicU32 = AtomicU32::new(0);
static CLASSIFICATIONS: AtomicU32 = AtomicU32::new(0);
static STEPS: AtomicU32 = AtomicU32::new(0);

/// Settlement of the last write: the state after it is an unknown function of what reaches it.
#[cfg_attr(
    not(kani),
    allow(dead_code, reason = "Kani puts it in the place of core's")
)]
fn apply_write_result<const N: usize>(session: &mut Session<N>, last_write: &LastWrite<N>) {
    SETTLEMENTS.fetch_add(1, Ordering::Relaxed);
    let axis = AXIS.load(Ordering::Relaxed);
    let nominal = match last_write {
        LastWrite::Refused { in_force } => in_force.get(axis).map(|in_force| in_force.nominal),
        LastWrite::Accepted | LastWrite::Unknown => None,
    };
    let number = one_of(
        session,
        &[
            u64::from(*last_write == LastWrite::Accepted),
            u64::from(*last_write == LastWrite::Unknown),
            nominal.map_or(0, bits),
        ],
        &OF_WRITE,
    );
    become_of(session, number);
}

/// Classification of the events of a tick: what has been skipped is an unknown function of what
/// reaches it.
#[cfg_attr(
    not(kani),
    allow(dead_code, reason = "Kani puts it in the place of core's")
)]
fn classify<const N: usize>(
    session: &Session<N>,
    events: &Events<N>,
    epochs: &EpochRange,
    accepted: &mut Accepted<N>,
    _: &mut Diagnostics,
) {
    CLASSIFICATIONS.fetch_add(1, Ordering::Relaxed);
    let next = epochs.after(session.parts().discrete.epoch);
    let number = one_of(
        session,
        &[
            u64::from(accepted.fsm.skipped),
            events.first().map_or(0, |(from, _)| from.0),
            u64::from(events.is_empty()),
            next.map_or(0, |next| next.0),
            u64::from(next.is_none()),
        ],
        &OF_EVENTS,
    );
    accepted.fsm.skipped = u32::try_from((number ^ number >> 32) & 0xFFFF_FFFF).unwrap_or(0);
}

/// Classification of an event: the bit of [`stand_in::classify`] after those of the events before it. Its
/// lifetime counts as a parameter, as it does in the method: Kani compares their numbers.
#[cfg_attr(
    not(kani),
    allow(dead_code, reason = "Kani puts it in the place of the method")
)]
fn classify_one<'a, const N: usize>(
    classifier: &Classifier<'a, N>,
    connection: Connection,
    event: &Event<N>,
    accepted: &mut Accepted<N>,
    diagnostics: &mut Diagnostics,
) where
    'a: 'a,
{
    stand_in::classify(classifier, connection, event, accepted, diagnostics);
    let before = accepted.fsm.skipped << 1;
    accepted.fsm.skipped = before | u32::from(accepted.fsm.goodbye);
}

/// Step: the state after it, the references and whether they are withheld are an unknown function of
/// what reaches it.
#[cfg_attr(
    not(kani),
    allow(dead_code, reason = "Kani puts it in the place of core's")
)]
fn step<const N: usize>(
    session: &mut Session<N>,
    tick: &TickInput<N>,
    refused: bool,
    accepted: &Accepted<N>,
    _: &Diagnostics,
) -> Output<N> {
    STEPS.fetch_add(1, Ordering::Relaxed);
    let axis = AXIS.load(Ordering::Relaxed);
    let nominal = tick
        .reading
        .and_then(|reading| reading.nominal.get(axis).copied());
    let flags = [
        refused,
        tick.stop,
        tick.quit,
        tick.rearm,
        tick.reading.is_some(),
    ];
    let number = one_of(
        session,
        &[
            flags
                .into_iter()
                .fold(0, |all, flag| all << 1 | u64::from(flag)),
            tick.elapsed_cycles.into(),
            nominal.map_or(0, bits),
            accepted.fsm.skipped.into(),
        ],
        &OF_STEP,
    );
    let mut output = no_output();
    output.withheld = number & 1 == 1;
    for reference in &mut output.references {
        reference.position = position(number);
    }
    become_of(session, number);
    output
}

/// Puts a number in the place of the nominal reference of the chosen axis and of what is known of the
/// drives.
fn become_of<const N: usize>(session: &mut Session<N>, number: u64) {
    let mut parts = *session.parts();
    parts.withheld = number & 1 == 1;
    parts.off_path = number & 2 == 2;
    if let Some(axis) = parts.axes.get_mut(AXIS.load(Ordering::Relaxed)) {
        axis.nominal = position(number);
    }
    if let Some(after) = Session::from_parts(*session.config(), parts) {
        *session = after;
    }
}

/// Every session counts as valid: what is checked holds of any.
#[cfg_attr(
    not(kani),
    allow(dead_code, reason = "Kani puts it in the place of core's")
)]
const fn is_valid<const N: usize>(_: &Session<N>) -> bool {
    true
}

/// The chosen one of the numbers of a session and of these.
fn one_of<const N: usize>(session: &Session<N>, others: &[u64], place: &AtomicUsize) -> u64 {
    let Parts {
        withheld,
        off_path,
        paced,
        discrete,
        axes,
        in_force,
        ..
    } = session.parts();
    let axis = axes.get(AXIS.load(Ordering::Relaxed));
    let in_force = in_force.get(AXIS.load(Ordering::Relaxed));
    let flags = [*withheld, *off_path, *paced];
    let of_session = [
        flags
            .into_iter()
            .fold(0, |all, flag| all << 1 | u64::from(flag)),
        discrete.tick.0,
        discrete.epoch.0,
        axis.map_or(0, |axis| bits(axis.nominal)),
        axis.map_or(0, |axis| axis.agitation.0.into()),
        in_force.map_or(0, |axis| bits(axis.nominal)),
    ];
    let place = place.load(Ordering::Relaxed);
    let chosen = match place.checked_sub(of_session.len()) {
        None => of_session.get(place),
        Some(place) => others.get(place),
    };
    chosen.copied().unwrap_or(0)
}

const fn position(number: u64) -> PositionNm {
    PositionNm(i64::from_ne_bytes(number.to_ne_bytes()))
}

const fn bits(nominal: PositionNm) -> u64 {
    u64::from_ne_bytes(nominal.0.to_ne_bytes())
}

/// Checks a tick of any session, which does each of its parts once.
fn check<const N: usize>(before: &Session<N>) {
    for chosen in [&OF_WRITE, &OF_EVENTS, &OF_STEP, &AXIS] {
        chosen.store(kani::any(), Ordering::Relaxed);
    }
    let mut events = Events::new();
    if kani::any() {
        assert!(events.push(kani::any()).is_ok(), "there is room");
    }
    let input = Input {
        tick: kani::any(),
        last_write: kani::any(),
        arrival_us: kani::any(),
        unauthentic: kani::any(),
        epochs: kani::any(),
        events,
    };
    session::tick_is_its_parts(before, &input);
    for calls in [&SETTLEMENTS, &CLASSIFICATIONS, &STEPS] {
        assert!(
            calls.load(Ordering::Relaxed) == 2,
            "T12: a tick does each of its parts once, and so do they"
        );
    }
    kani::cover!(input.events.is_empty(), "no event");
    kani::cover!(!input.events.is_empty(), "an event");
}

/// Checks the events of a tick of any session, each number of them by itself.
fn check_events<const N: usize>(session: &Session<N>) {
    stand_in::choose_bit(kani::any());
    let epochs = kani::any();
    let mut events = Events::new();
    tick::classifies_one_by_one(session, &events, &epochs);
    for _ in 0..2 {
        assert!(events.push(kani::any()).is_ok(), "there is room");
        tick::classifies_one_by_one(session, &events, &epochs);
    }
}

harnesses! {
    session_tick_is_its_parts [minisat, unwind 18, stub(gantry_tau_core::control::session::Session::apply_write_result, apply_write_result), stub(gantry_tau_core::control::session::Session::classify, classify), stub(gantry_tau_core::control::session::Session::step, step), stub(gantry_tau_core::control::session::Session::is_valid, is_valid)] { check(&kani::any::<Session<3>>()); }
    session_of_6_axes_tick_is_its_parts [minisat, unwind 18, stub(gantry_tau_core::control::session::Session::apply_write_result, apply_write_result), stub(gantry_tau_core::control::session::Session::classify, classify), stub(gantry_tau_core::control::session::Session::step, step), stub(gantry_tau_core::control::session::Session::is_valid, is_valid)] { check(&kani::any::<Session<6>>()); }
    session_classifies_one_by_one [minisat, unwind 5, stub(gantry_tau_core::verification::control::Classifier::classify, classify_one)] { check_events(&kani::any::<Session<3>>()); }
}
