//! A whole tick of the session, over its whole state: one-step induction. Valid, and any input, one
//! tick, valid, and the bounds.

use core::array;

use gantry_tau_core::control::axis::{Offsets, Reference};
use gantry_tau_core::control::message::{AxisFlags, AxisState, ClientMessage, Phase};
use gantry_tau_core::control::session::config::{AxisConfig, Config};
use gantry_tau_core::control::session::{
    Event, Input, LastWrite, Output, Session, Start, TickInput,
};
use gantry_tau_core::units::{Epoch, PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_core::verification::control::{
    Accepted, Action, Axis, AxisChannels, AxisCommand, Decision, Diagnostics, FsmInput, FsmState,
    Internals, Known, Order, Rules, carry_out, decide, nominal_accelerated, nominal_stepped, order,
};

use crate::properties::axis::{Bounded, Kind, Ramped};
use crate::properties::ingress;

/// A session whose last write is settled, and everything else that its step depends on.
#[derive(Clone, Debug)]
pub struct StepInput<const N: usize> {
    /// The session.
    pub session: Session<N>,
    /// Input from the machine.
    pub tick: TickInput<N>,
    /// The drives did not take the last references.
    pub refused: bool,
    /// Accepted events.
    pub accepted: Accepted<N>,
    /// Counts.
    pub diagnostics: Diagnostics,
}

impl<const N: usize> StepInput<N> {
    /// Settles the last write and classifies the events.
    #[must_use]
    pub fn after_events(session: &Session<N>, input: &Input<N>) -> Self {
        let mut session = *session;
        session.apply_write_result(&input.last_write);
        let (accepted, diagnostics) = session.classify(&input.events, &input.epochs);
        Self {
            session,
            tick: input.tick,
            refused: input.last_write != LastWrite::Accepted,
            accepted,
            diagnostics,
        }
    }

    /// Takes the step: the session after it, and its output.
    #[must_use]
    pub fn step(&self) -> (Session<N>, Output<N>) {
        let mut after = self.session;
        let output = after.step(&self.tick, self.refused, &self.accepted, &self.diagnostics);
        (after, output)
    }
}

/// Returns the complete input of the decision, and its rules, by their definition: what was
/// accepted, the cycle and the drives.
#[must_use]
pub fn decided_on<const N: usize>(input: &StepInput<N>) -> (FsmInput, Rules) {
    let StepInput {
        session,
        tick,
        refused,
        accepted,
        ..
    } = input;
    let parts = session.parts();
    let parameters = session.config().parameters();
    let cycles = tick.elapsed_cycles.max(1);
    let outage = tick.reading.is_none() || *refused;
    let fsm = FsmInput {
        stop: accepted.fsm.stop || tick.stop || outage,
        quit: tick.quit,
        rearm: tick.rearm,
        nominal_fault: (0..N)
            .any(|axis| has_stepped(input, axis) || has_accelerated(input, axis) == Some(true)),
        agitated: (0..N).any(|axis| parts.axes[axis].is_agitated(&parameters.axes[axis])),
        skipped: cycles - 1,
        all_zero: !parts.withheld
            && (0..N).all(|axis| parts.axes[axis].channels.offsets() == Offsets::ZERO),
        ..accepted.fsm
    };
    (
        fsm,
        Rules {
            handshake_ticks: parameters.handshake_ticks,
            budget: parameters.budget,
        },
    )
}

/// True if the nominal reference that was read of an axis is further from its last one than the
/// cycles allow.
fn has_stepped<const N: usize>(input: &StepInput<N>, axis: usize) -> bool {
    let config = &input.session.config().parameters().axes[axis];
    let last = input.session.parts().axes[axis].nominal;
    let cycles = input.tick.elapsed_cycles.max(1);
    // Core's own comparison: a second product of two unknowns is beyond the solver.
    input
        .tick
        .reading
        .as_ref()
        .is_some_and(|reading| nominal_stepped(last, reading.nominal[axis], config, cycles))
}

/// `None`: the nominal reference that was read of an axis did not accelerate more than its limit,
/// or is not judged. `Some`: it did, and whether that stops the machine.
fn has_accelerated<const N: usize>(input: &StepInput<N>, axis: usize) -> Option<bool> {
    let limit = input.session.config().parameters().axes[axis].nominal_accel?;
    let reading = input.tick.reading.as_ref()?;
    let last = &input.session.parts().axes[axis];
    // Core's own comparison, as above.
    let two_paced = input.session.parts().paced && is_paced(input);
    let is_beyond = two_paced && nominal_accelerated(last, reading.nominal[axis], limit);
    is_beyond.then_some(limit.is_fault)
}

/// True if the path is what moves the machine in this cycle, which is the next one.
fn is_paced<const N: usize>(input: &StepInput<N>) -> bool {
    let (tick, parts) = (&input.tick, input.session.parts());
    tick.elapsed_cycles <= 1 && tick.reading.is_some() && !parts.off_path
}

/// The doors of the decision: it sees what was accepted, the cycle and the drives, and nothing
/// else; and the order is what it says.
///
/// Composed as: `session_orders_what_is_decided`, `session_of_6_axes_orders_what_is_decided`.
pub fn order_is_of_the_decision<const N: usize>(input: &StepInput<N>) {
    let (tick, parts) = (&input.tick, input.session.parts());
    let (decision, complete, ordered) = ordered(input);
    let (fsm, _) = decided_on(input);
    assert!(complete == fsm, "T9: the decision sees what is known");
    let shadow = shadow_of(decision.next.phase, &fsm);
    let holds = tick.reading.is_none() || parts.off_path && fsm.nominal_fault;
    let nominal_flags = array::from_fn(|axis| {
        AxisFlags::default()
            .with(AxisFlags::NOMINAL_STEP, has_stepped(input, axis))
            .with(
                AxisFlags::NOMINAL_ACCEL,
                has_accelerated(input, axis).is_some(),
            )
    });
    let expected = Order {
        action: decision.action,
        obtains: decision.next.phase == Phase::Obtain,
        shadow,
        nominal_flags,
        paced: is_paced(input),
        holds,
    };
    assert!(ordered == expected, "T9: ordered is what is decided");
}

/// Returns core's decision, its input, and the order.
fn ordered<const N: usize>(input: &StepInput<N>) -> (Decision, FsmInput, Order<N>) {
    let (session, parts) = (&input.session, input.session.parts());
    let known = Known {
        withheld: parts.withheld,
        off_path: parts.off_path,
        paced: parts.paced,
        refused: input.refused,
    };
    order(
        session.config().parameters(),
        &parts.discrete,
        &parts.axes,
        known,
        &input.tick,
        &input.accepted,
    )
}

/// The decision of a whole step is that of [`decide`] on the completed input, and so is the order to
/// the axes.
///
/// Composed as: `session_decides_by_the_rules`, `session_of_6_axes_decides_by_the_rules`.
pub fn decides_by_the_rules<const N: usize>(input: &StepInput<N>) {
    let before = &input.session;
    let (fsm, rules) = decided_on(input);
    let expected = decide(&before.parts().discrete, &fsm, &rules);
    let (after, _) = input.step();
    assert!(
        after.parts().discrete == expected.next,
        "T9: decided by the rules"
    );
    let (decision, _, _) = ordered(input);
    assert!(decision == expected, "T9: ordered by the rules");
}

/// A step is its parts: the discrete state is that of the decision, the axes and the references are
/// what the axes made of the order, and what is withheld stays so.
///
/// Composed as: `session_step_is_its_parts`, `session_of_6_axes_step_is_its_parts`.
pub fn step_is_its_parts<const N: usize>(input: &StepInput<N>) {
    let StepInput {
        session: before,
        tick,
        accepted,
        ..
    } = input;
    let parameters = before.config().parameters();
    let (decision, _, ordered) = ordered(input);
    let mut axes = before.parts().axes;
    let (mut references, mut states) = ([NO_REFERENCE; N], [AxisState::default(); N]);
    carry_out(
        parameters,
        &mut axes,
        &ordered,
        tick,
        accepted,
        |index, axis, command| {
            references[index] = match command {
                Some((command, config)) => axis.act(&command, config, &mut states[index]),
                None => axis.held(&mut states[index]),
            };
        },
    );
    let (after, output) = input.step();
    let parts = after.parts();
    assert!(
        parts.discrete == decision.next,
        "T9: the session goes on as decided"
    );
    assert!(parts.axes == axes, "T1: the axes are what they became");
    assert!(
        output.references == references,
        "T3: the references are those of the axes"
    );
    let withheld = before.parts().withheld;
    assert!(
        parts.withheld == withheld && output.withheld == withheld,
        "T21: a step changes nothing of what is withheld"
    );
    assert!(
        (parts.off_path, parts.paced) == (ordered.holds, ordered.paced),
        "T21: off the path if the axes were held"
    );
}

/// A tick is its parts: the last write is settled, then the events are classified, then the step is
/// taken.
///
/// Composed as: `session_tick_is_its_parts`, `session_of_6_axes_tick_is_its_parts`.
pub fn tick_is_its_parts<const N: usize>(before: &Session<N>, input: &Input<N>) {
    let mut after = *before;
    let output = after.tick(input);
    let (expected, of_parts) = StepInput::after_events(before, input).step();
    let (one, other) = (after.parts(), expected.parts());
    assert!(
        one.discrete == other.discrete && one.axes == other.axes,
        "T12: a tick is its parts"
    );
    assert!(
        (one.withheld, one.off_path) == (other.withheld, other.off_path),
        "T12: a tick knows of the drives what its parts know"
    );
    assert!(
        output.references == of_parts.references && output.withheld == of_parts.withheld,
        "T12: the references of a tick are those of its step"
    );
}

/// A reference that every axis replaces.
const NO_REFERENCE: Reference = Reference {
    position: PositionNm(0),
    velocity_offset: VelocityUmS(0),
    torque_offset: TorquePermille(0),
};

/// State of an axis, the command to it, and its configuration, as they reach it.
type Reached = (Axis, Option<(AxisCommand, AxisConfig)>);

/// Every axis acts by itself: for any order, what reaches an axis is its own target, nominal
/// reference, measurements and configuration, and no other's; and the axis goes on as it acted. So
/// what is proved of an axis under any command holds for every axis of a session.
///
/// Composed as: `session_of_3_axes_acts_axis_by_axis`, `session_of_6_axes_acts_axis_by_axis`.
pub fn axes_act_by_themselves<const N: usize>(
    input: &StepInput<N>,
    order: &Order<N>,
    acted: &Axis,
) {
    let StepInput {
        session,
        tick,
        accepted,
        ..
    } = input;
    let parameters = session.config().parameters();
    let before = session.parts().axes;
    let mut after = before;
    let mut reached: [Option<Reached>; N] = [const { None }; N];
    carry_out(
        parameters,
        &mut after,
        order,
        tick,
        accepted,
        |index, axis, command| {
            let before = *axis;
            *axis = Axis {
                nominal: before.nominal,
                ..*acted
            };
            assert!(reached[index].is_none(), "T1: an axis acts once");
            reached[index] = Some((before, command.map(|(command, config)| (command, *config))));
        },
    );
    for axis in 0..N {
        let own = before[axis];
        let Some(reached) = &reached[axis] else {
            panic!("T1: every axis acts")
        };
        let held = (own.nominal, own.actual);
        let (nominal, actual) = tick.reading.map_or(held, |reading| {
            (reading.nominal[axis], reading.actual[axis])
        });
        let command = AxisCommand {
            action: order.action,
            obtains: order.obtains,
            shadow: order.shadow,
            target: accepted.targets[axis],
            nominal: if order.holds { own.nominal } else { nominal },
            nominal_flags: order.nominal_flags[axis],
            actual,
        };
        assert!(reached.0 == own, "T1: an axis acts from its own state");
        assert!(
            reached.1 == Some((command, parameters.axes[axis])),
            "T1: an axis acts on its own command"
        );
        assert!(
            after[axis]
                == Axis {
                    nominal: own.nominal,
                    ..*acted
                },
            "T1: an axis goes on as it acted"
        );
    }
}

/// One of any number of axes, which keeps its part of the invariant under any actions of the
/// others: of these the decision knows no more than that all axes are at zero, which this one then
/// is. With [`axes_act_by_themselves`] that is the invariant of every axis of a session.
///
/// Composed as: `session_axis_of_many_stays_valid`.
pub fn axis_of_many_stays_valid(
    axis: &Axis,
    config: &AxisConfig,
    (discrete, fsm, rules): (&FsmState, &FsmInput, &Rules),
    command: &AxisCommand,
) {
    let mut after = *axis;
    if !after.is_valid(discrete.phase, config) || (fsm.all_zero && !after.channels.is_zero()) {
        return;
    }
    let Decision { next, action, .. } = decide(discrete, fsm, rules);
    let command = AxisCommand {
        action,
        obtains: next.phase == Phase::Obtain,
        shadow: shadow_of(next.phase, fsm),
        ..*command
    };
    let _ = after.act(&command, config, &mut AxisState::default());
    assert!(
        after.is_valid(next.phase, config),
        "T6: an axis stays valid, whatever the others do"
    );
    if next.is_live() && !discrete.is_live() {
        assert!(
            after.channels.is_zero() && axis.channels.is_zero(),
            "T6: authority only at zero, on every axis"
        );
    }
}

/// Action of the shadow: fresh commands in Submit are followed, a miss holds; elsewhere it rests.
fn shadow_of(phase: Phase, fsm: &FsmInput) -> Option<Action> {
    match (phase, fsm.command) {
        (Phase::Submit, Some(_)) => Some(Action::Follow),
        (Phase::Submit, None) => Some(Action::Hold),
        _ => None,
    }
}

/// T1, T2, T3 of one channel of every axis.
pub fn channels_are_bounded<const N: usize>(input: &StepInput<N>, kind: Kind) {
    let (after, _) = input.step();
    let before = &input.session;
    for index in 0..N {
        let limits = &before.config().parameters().axes[index].limits;
        let old = &before.parts().axes[index].channels;
        let new = &after.parts().axes[index].channels;
        kind.check((old, new), limits, &Bounded);
    }
}

/// The invariant of every axis: channels and shadow within their limits, at rest where the phase
/// says so.
pub fn axes_stay_valid<const N: usize>(input: &StepInput<N>) {
    let (after, _) = input.step();
    for index in 0..N {
        let config = &after.config().parameters().axes[index];
        assert!(
            after.parts().axes[index].is_valid(after.phase(), config),
            "the invariant is kept"
        );
    }
}

/// T3: every drive's reference is inside the travel.
pub fn references_are_inside_travel<const N: usize>(input: &StepInput<N>) {
    let (after, output) = input.step();
    for index in 0..N {
        let travel = &after.config().parameters().axes[index].machine_travel;
        let reference = output.references[index].position;
        let inside = travel.lower <= reference && reference <= travel.upper;
        assert!(inside, "T3: the drive's reference is inside the travel");
    }
}

/// The rest of the invariant: the discrete state.
pub fn discrete_stays_valid<const N: usize>(input: &StepInput<N>) {
    let (after, output) = input.step();
    let ticks = after.config().parameters().handshake_ticks;
    assert!(
        after.parts().discrete.is_valid(ticks),
        "the discrete state stays valid"
    );
    assert!(output.state.phase == after.phase(), "the State says it");
}

/// T5: without a session, one channel of every axis moves by exactly `min(rho, |value|)` towards
/// zero, for any input.
pub fn channels_ramp<const N: usize>(input: &StepInput<N>, kind: Kind) {
    let before = &input.session;
    if !matches!(before.phase(), Phase::SafeDisconnect | Phase::Fault) {
        return;
    }
    let (after, _) = input.step();
    for index in 0..N {
        let limits = &before.config().parameters().axes[index].limits;
        let old = &before.parts().axes[index].channels;
        let new = &after.parts().axes[index].channels;
        kind.check((old, new), limits, &Ramped);
    }
}

/// T6: whoever is welcomed finds every channel of every axis at zero, before and after.
pub fn authority_needs_zero<const N: usize>(input: &StepInput<N>) {
    let before = &input.session;
    let (after, output) = input.step();
    let granted = output.welcome.is_some() || (after.is_live() && !before.is_live());
    if !granted {
        return;
    }
    for session in [before, &after] {
        for index in 0..N {
            let channels = &session.parts().axes[index].channels;
            assert!(channels.is_zero(), "T6: authority only at zero");
        }
    }
    assert!(
        output.welcome == after.owner() && after.phase() == Phase::Handshake,
        "T6: who is welcomed owns the session"
    );
}

/// T9: a step with the stop asserted, or on the way to the end, ends in Fault, and every channel
/// ramps.
pub fn stop_ends_in_fault<const N: usize>(input: &StepInput<N>) {
    let before = &input.session;
    if !input.tick.stop && !input.tick.quit {
        return;
    }
    let (after, output) = input.step();
    assert!(
        output.latched || !input.tick.stop,
        "T9: a stop at the machine is latched"
    );
    assert!(after.phase() == Phase::Fault, "T9: a stop ends in Fault");
    for index in 0..N {
        let limits = &before.config().parameters().axes[index].limits;
        let mut ramped = before.parts().axes[index].channels;
        ramped.act(Action::Ramp, &Offsets::ZERO, limits);
        let new = after.parts().axes[index].channels;
        assert!(new == ramped, "T9: every channel ramps");
    }
}

/// T9, over the lives of a server: as long as the stop is latched, the phase being Fault, no peer
/// is welcomed, and only a re-arm that was seen released ends it, at zero. That every tick in Fault
/// ramps is [`channels_ramp`]; a server that starts with the latch is in Fault
/// ([`starts_as_told`]).
pub fn latch_holds<const N: usize>(input: &StepInput<N>) {
    let before = &input.session;
    if before.phase() != Phase::Fault {
        return;
    }
    let (after, output) = input.step();
    assert!(
        output.welcome.is_none() && !after.is_live(),
        "T9: nobody is welcomed in Fault"
    );
    let rearmed = input.tick.rearm && before.parts().discrete.rearm_released;
    let at_zero = (0..N).all(|axis| before.parts().axes[axis].channels.is_zero());
    let may_leave =
        rearmed && at_zero && !input.tick.stop && !input.tick.quit && input.tick.reading.is_some();
    assert!(
        after.phase() == Phase::Fault || may_leave,
        "T9: only a re-arm leads out of Fault"
    );
    let holds = !before.parts().discrete.latched || output.latched;
    assert!(
        holds || after.phase() != Phase::Fault,
        "T9: only a re-arm releases the latch"
    );
}

/// The start of a server: it has the values in force at the drives, off the path until it meets it;
/// it is in Fault with a latched stop, and listens only at zero. Offsets beyond their limits refuse
/// it.
///
/// Composed as: `total_start`, `total_start_of_six`.
pub fn starts_as_told<const N: usize>(config: Config<N>, start: &Start<N>) {
    let axes = &config.parameters().axes;
    let within = (0..N).all(|axis| axes[axis].limits.admits(&start.in_force[axis].offsets));
    let Ok(session) = Session::new(config, start) else {
        assert!(!within, "T12: only offsets beyond their limits are refused");
        return;
    };
    assert!(within && session.is_valid(), "T12: a session starts valid");
    assert!(
        session.demanded() == start.in_force,
        "T21: a server starts with what is in force"
    );
    assert!(
        !session.parts().withheld,
        "T21: a server that starts may write"
    );
    assert!(session.parts().off_path, "T21: and waits for the path");
    let at_zero = (0..N).all(|axis| start.in_force[axis].offsets == Offsets::ZERO);
    let expected = match (start.stop_latched, at_zero) {
        (true, _) => Phase::Fault,
        (false, true) => Phase::Listening,
        (false, false) => Phase::SafeDisconnect,
    };
    assert!(
        session.phase() == expected,
        "T9: a latched stop outlives the server"
    );
    assert!(
        session.parts().discrete.latched == start.stop_latched,
        "T9: and is still latched"
    );
    assert!(
        !session.parts().discrete.rearm_released,
        "T9: a stuck re-arm leads nowhere"
    );
    assert!(
        session.epoch() == Epoch(0),
        "T23: a server begins before its first epoch"
    );
    assert!(are_at_rest(&session), "T2: a server starts at rest");
    assert!(
        Accepted::<N>::nothing().fsm == FsmInput::default(),
        "T22: without events nothing is accepted"
    );
}

/// True if no channel of any axis moves.
fn are_at_rest<const N: usize>(session: &Session<N>) -> bool {
    session.parts().axes.iter().all(|axis| {
        let AxisChannels {
            position,
            velocity,
            torque,
        } = axis.channels;
        (position.change(), velocity.change(), torque.change()) == (0, 0, 0)
    })
}

/// T7, for a whole tick: two inputs that are accepted alike lead to the same references and the
/// same discrete state.
pub fn counts_decide_nothing<const N: usize>(input: &StepInput<N>, diagnostics: &Diagnostics) {
    let diagnostics = diagnostics.clone();
    decide_alike(
        input,
        &StepInput {
            diagnostics,
            ..input.clone()
        },
    );
}

/// Two inputs lead to the same references, the same channels and the same discrete state.
fn decide_alike<const N: usize>(one: &StepInput<N>, other: &StepInput<N>) {
    let ((one, one_output), (other, other_output)) = (one.step(), other.step());
    assert!(
        one_output.references == other_output.references,
        "T7: the same references"
    );
    assert!(
        one.parts().discrete == other.parts().discrete,
        "T7: the same discrete state"
    );
    assert!(
        one.parts().axes == other.parts().axes,
        "T7: the same channels"
    );
}

/// T12: after a refused write a session is valid and over, and goes on at rest from the values in
/// force; without valid values nothing may be written, and no session is granted.
///
/// Composed as: `total_write`, `total_write_of_six`.
pub fn settles_any_write<const N: usize>(before: &Session<N>, last_write: &LastWrite<N>) {
    let mut after = *before;
    after.apply_write_result(last_write);
    assert!(after.is_valid(), "T12: the invariant is kept");
    let in_force = match last_write {
        LastWrite::Accepted => {
            assert!(after == *before, "T12: nothing to settle");
            return;
        }
        LastWrite::Refused { in_force } => Some(in_force),
        LastWrite::Unknown => None,
    };
    assert!(
        matches!(after.phase(), Phase::SafeDisconnect | Phase::Fault),
        "T12: the session is over"
    );
    let known = (0..N).all(|axis| {
        let limits = &before.config().parameters().axes[axis].limits;
        in_force.is_some_and(|in_force| limits.admits(&in_force[axis].offsets))
    });
    let kept = |session: &Session<N>| {
        let discrete = &session.parts().discrete;
        let FsmState {
            epoch,
            accepted,
            tick,
            owner,
            rearm_released,
            ..
        } = *discrete;
        (epoch, accepted, tick, owner, rearm_released)
    };
    assert!(
        kept(&after) == kept(before),
        "T23: a write changes no epoch, no sequence and no owner"
    );
    assert!(!known || are_at_rest(&after), "T2: goes on at rest");
    assert!(
        after.parts().withheld != known,
        "T12: withheld unless the values in force are known and valid"
    );
    for axis in 0..N {
        let (old, new) = (&before.parts().axes[axis], &after.parts().axes[axis]);
        match in_force {
            Some(in_force) if known => assert!(
                new.channels.offsets() == in_force[axis].offsets
                    && new.nominal == in_force[axis].nominal,
                "T12: goes on from the values in force"
            ),
            _ => assert!(new.channels == old.channels, "T12: keeps what it believes"),
        }
    }
}

/// Nothing is granted, and nothing may be written, until a read-back has said what is in force.
pub fn withheld_until_read_back<const N: usize>(input: &StepInput<N>) {
    if !input.session.parts().withheld {
        return;
    }
    let (after, output) = input.step();
    assert!(output.withheld, "nothing may be written");
    assert!(output.welcome.is_none(), "no session is granted");
    assert!(
        matches!(after.phase(), Phase::SafeDisconnect | Phase::Fault),
        "the server does not listen"
    );
}

/// Every property of a whole tick but T7's comparison of two inputs: T1 to T6 and T9.
pub fn step_is_right<const N: usize>(input: &StepInput<N>) {
    for kind in Kind::ALL {
        channels_are_bounded(input, kind);
        channels_ramp(input, kind);
    }
    axes_stay_valid(input);
    references_are_inside_travel(input);
    discrete_stays_valid(input);
    authority_needs_zero(input);
    stop_ends_in_fault(input);
    latch_holds(input);
    order_is_of_the_decision(input);
    decides_by_the_rules(input);
    step_is_its_parts(input);
    withheld_until_read_back(input);
    counts_decide_nothing(input, &Diagnostics::default());
}

/// Returns the input without what must not matter: events of non-owners outside Listening, the
/// owner's commands that are not fresh, and the sample of the force sensor.
#[must_use]
pub fn essential<const N: usize>(before: &Session<N>, input: &Input<N>) -> Input<N> {
    let mut session = *before;
    session.apply_write_result(&input.last_write);
    let classifier = ingress::classifier(&session, input.epochs.after(session.epoch()));
    let mut without = input.clone();
    without.tick.sensor = None;
    without.unauthentic = 0;
    without.events.retain(|(from, event)| {
        if session.owner() != Some(*from) {
            return session.phase() == Phase::Listening;
        }
        match event {
            Event::Message(ClientMessage::Command(command)) => {
                ingress::is_fresh(&classifier, command)
            }
            _ => true,
        }
    });
    without
}

/// T7, from the events on: an input without what does not come from the owner, or is not fresh,
/// leads to the same references, the same channels and the same discrete state.
pub fn same_outcome<const N: usize>(session: &Session<N>, input: &Input<N>, essential: &Input<N>) {
    decide_alike(
        &StepInput::after_events(session, input),
        &StepInput::after_events(session, essential),
    );
}
