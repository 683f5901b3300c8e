//! A tick and its parts: any session in any valid state, any fate of the last write, at most one event.
//! Classification, order and axis are unknown functions of what reaches them.

use core::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

use gantry_tau_core::control::message::AxisFlags;
use gantry_tau_core::control::session::config::Parameters;
use gantry_tau_core::control::session::{Connection, Event, Events, Input, Session, TickInput};
use gantry_tau_core::units::{Epoch, PositionNm};
use gantry_tau_core::verification::control::{
    Accepted, Action, Axis, Classifier, Decision, Diagnostics, FsmInput, FsmState, Known, Order,
    Rules,
};

use super::kani;
use crate::properties::session;
use crate::stand_in;

/// The number of what reaches an order that it depends on, and the axis of it.
static NUMBER: AtomicUsize = AtomicUsize::new(0);
static AXIS: AtomicUsize = AtomicUsize::new(0);
/// Orders that were given.
static ORDERS: AtomicU32 = AtomicU32::new(0);

/// [`stand_in::classify`] with a lifetime that counts as a parameter, as it does in the method: Kani
/// compares their numbers.
#[cfg_attr(
    not(kani),
    allow(dead_code, reason = "Kani puts it in the place of the method")
)]
fn classify<'a, const N: usize>(
    classifier: &Classifier<'a, N>,
    connection: Connection,
    event: &Event<N>,
    accepted: &mut Accepted<N>,
    diagnostics: &mut Diagnostics,
) where
    'a: 'a,
{
    stand_in::classify(classifier, connection, event, accepted, diagnostics);
}

/// Order of a tick: an unknown function of what reaches it.
#[cfg_attr(
    not(kani),
    allow(dead_code, reason = "Kani puts it in the place of core's")
)]
fn order<const N: usize>(
    parameters: &Parameters<N>,
    discrete: &FsmState,
    axes: &[Axis; N],
    known: Known,
    tick: &TickInput<N>,
    accepted: &Accepted<N>,
) -> (Decision, FsmInput, Order<N>) {
    ORDERS.fetch_add(1, Ordering::Relaxed);
    let number = reaching(axes, known, tick, accepted);
    let rules = Rules {
        handshake_ticks: parameters.handshake_ticks,
        budget: parameters.budget,
    };
    let mut decision = stand_in::decide(discrete, &accepted.fsm, &rules);
    decision.next.epoch = Epoch(decision.next.epoch.0 ^ number);
    let order = Order {
        action: decision.action,
        obtains: number & 1 == 1,
        shadow: (number & 2 == 2).then_some(Action::Follow),
        nominal_flags: [AxisFlags::default(); N],
        paced: number & 4 == 4,
        holds: number & 8 == 8,
    };
    (decision, accepted.fsm, order)
}

/// The chosen one of the numbers that reach an order and that [`stand_in::decide`] and
/// [`stand_in::act`] do not have.
fn reaching<const N: usize>(
    axes: &[Axis; N],
    known: Known,
    tick: &TickInput<N>,
    accepted: &Accepted<N>,
) -> u64 {
    let axis = AXIS.load(Ordering::Relaxed);
    let nominal = tick.reading.map(|reading| reading.nominal);
    let flags = [
        known.withheld,
        known.off_path,
        known.paced,
        known.refused,
        tick.stop,
        tick.quit,
        tick.rearm,
        tick.reading.is_some(),
    ];
    let flags = flags
        .into_iter()
        .fold(0, |all, flag| all << 1 | u64::from(flag));
    let bits = |nominal: PositionNm| u64::from_ne_bytes(nominal.0.to_ne_bytes());
    let numbers = [
        flags,
        tick.elapsed_cycles.into(),
        nominal
            .and_then(|nominal| nominal.get(axis).copied())
            .map_or(0, bits),
        axes.get(axis).map_or(0, |axis| bits(axis.nominal)),
        axes.get(axis).map_or(0, |axis| axis.agitation.0.into()),
        accepted.fsm.skipped.into(),
    ];
    let number = NUMBER.load(Ordering::Relaxed);
    numbers.get(number).copied().unwrap_or(0)
}

/// Any input of a tick with these events.
fn any_tick<const N: usize>(events: Events<N>) -> Input<N> {
    Input {
        tick: kani::any(),
        last_write: kani::any(),
        arrival_us: kani::any(),
        unauthentic: kani::any(),
        epochs: kani::any(),
        events,
    }
}

/// Checks a tick of any session, which orders once. Each number of events by itself, so that it is one
/// that the solver knows.
fn check<const N: usize>(before: &Session<N>) {
    stand_in::choose_bit(kani::any());
    stand_in::choose_argument(kani::any(), kani::any());
    NUMBER.store(kani::any(), Ordering::Relaxed);
    AXIS.store(kani::any(), Ordering::Relaxed);
    let mut events = Events::new();
    if kani::any() {
        session::tick_is_its_parts(before, &any_tick(events));
        kani::cover!(true, "no event");
    } else {
        assert!(events.push(kani::any()).is_ok(), "there is room");
        session::tick_is_its_parts(before, &any_tick(events));
        kani::cover!(true, "an event");
    }
    assert!(
        ORDERS.load(Ordering::Relaxed) == 2,
        "T12: a tick orders once, and so do its parts"
    );
}

harnesses! {
    session_tick_is_its_parts [minisat, unwind 18, stub(gantry_tau_core::verification::control::order, order), stub(gantry_tau_core::verification::control::Axis::act, crate::stand_in::act), stub(gantry_tau_core::verification::control::Classifier::classify, classify)] { check(&kani::any::<Session<3>>()); }
    session_of_6_axes_tick_is_its_parts [minisat, unwind 18, stub(gantry_tau_core::verification::control::order, order), stub(gantry_tau_core::verification::control::Axis::act, crate::stand_in::act), stub(gantry_tau_core::verification::control::Classifier::classify, classify)] { check(&kani::any::<Session<6>>()); }
}
