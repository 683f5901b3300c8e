//! One step: completes the input of the decision, decides, and lets every axis carry the decision
//! out.
//!
//! [`step`] receives no counter, no cause and no clock: diagnostics cannot decide anything (T7).

use super::act::{Axis, AxisCommand, nominal_accelerated, nominal_stepped};
use super::config::{AxisConfig, Parameters};
use super::fsm::{Action, Decision, FsmInput, FsmState, Rules, decide};
use super::ingress::Accepted;
use super::io::TickInput;
use crate::control::axis::{Actual, Reference};
use crate::control::message::{AxisFlags, AxisState, Phase};
use crate::units::PositionNm;
use crate::zip::{each, zip};

/// Result of a step.
pub(super) struct Step {
    /// The decision.
    pub(super) decision: Decision,
    /// Complete input of the decision.
    pub(super) fsm: FsmInput,
    /// The axes were held at the nominal references in force.
    pub(super) off_path: bool,
    /// The axes moved along the path, on time.
    pub(super) paced: bool,
}

/// Outcome of a step at the axes.
pub(super) struct Outcome<'a, const N: usize> {
    /// References of the axes.
    pub(super) references: &'a mut [Reference; N],
    /// States of the axes.
    pub(super) states: &'a mut [AxisState; N],
}

/// Knowledge of the drives.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    /// The values in force are unknown.
    pub withheld: bool,
    /// The nominal references in force need not be those of the path.
    pub off_path: bool,
    /// In the last tick the axes moved along the path, on time.
    pub paced: bool,
    /// The references of the last tick were not taken.
    pub refused: bool,
}

/// Decides, and lets every axis carry the decision out.
pub(super) fn step<const N: usize>(
    parameters: &Parameters<N>,
    discrete: &mut FsmState,
    axes: &mut [Axis; N],
    known: Known,
    tick: &TickInput<N>,
    accepted: &Accepted<N>,
    outcome: Outcome<'_, N>,
) -> Step {
    let (decision, fsm, order) = order(parameters, discrete, axes, known, tick, accepted);
    carry_out(
        parameters,
        axes,
        &order,
        tick,
        accepted,
        |index, axis, command| {
            if let (Some(reference), Some(state)) = (
                outcome.references.get_mut(index),
                outcome.states.get_mut(index),
            ) {
                *reference = match command {
                    Some((command, config)) => axis.act(&command, config, state),
                    None => axis.held(state),
                };
            }
        },
    );
    *discrete = decision.next;
    Step {
        decision,
        fsm,
        off_path: order.holds,
        paced: order.paced,
    }
}

/// Order of a tick to all axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Order<const N: usize> {
    /// Action of the channels in force.
    pub action: Action,
    /// The tick is one of Obtain.
    pub obtains: bool,
    /// Action of the shadows; `None`: they rest at zero.
    pub shadow: Option<Action>,
    /// Flags of the nominal reference of each axis.
    pub nominal_flags: [AxisFlags; N],
    /// The axes move along the path, on time.
    pub paced: bool,
    /// The nominal references in force stand.
    pub holds: bool,
}

/// Completes the input of the decision, decides, and makes the order of the decision.
pub fn order<const N: usize>(
    parameters: &Parameters<N>,
    discrete: &FsmState,
    axes: &[Axis; N],
    known: Known,
    tick: &TickInput<N>,
    accepted: &Accepted<N>,
) -> (Decision, FsmInput, Order<N>) {
    // From what was held to the path is no way along it.
    let paced = tick.cycles() == 1 && tick.reading.is_some() && !known.off_path;
    let (nominal_flags, nominal_fault) =
        judge_nominal(parameters, axes, tick, known.paced && paced);
    // Unknown values in force do not count as zero.
    let zero = all_zero(axes) && !known.withheld;
    let agitated = is_agitated(parameters, axes);
    let fsm = complete(accepted.fsm, known, zero, agitated, tick, nominal_fault);
    // All axes together: some of them moved and some not could be a pose that the machine does not
    // have.
    let holds = tick.reading.is_none() || known.off_path && fsm.nominal_fault;
    let rules = Rules {
        handshake_ticks: parameters.handshake_ticks,
        budget: parameters.budget,
    };
    let decision = decide(discrete, &fsm, &rules);
    let shadow = shadow_action(decision.next.phase, fsm.command.is_some());
    (
        decision,
        fsm,
        Order {
            action: decision.action,
            obtains: decision.next.phase == Phase::Obtain,
            shadow,
            nominal_flags,
            paced,
            holds,
        },
    )
}

/// Lets every axis `act` on an order with its own target, nominal reference, measurements and
/// configuration.
///
/// It knows nothing of what an axis does, so what is proved of one axis holds for each of them.
pub fn carry_out<const N: usize>(
    parameters: &Parameters<N>,
    axes: &mut [Axis; N],
    order: &Order<N>,
    tick: &TickInput<N>,
    accepted: &Accepted<N>,
    mut act: impl FnMut(usize, &mut Axis, Option<(AxisCommand, &AxisConfig)>),
) {
    for index in 0..N {
        if let Some(axis) = axes.get_mut(index) {
            // Never `None`: every array has N elements. The compiler cannot see it.
            let command =
                command(index, axis, order, tick, accepted).zip(parameters.axes.get(index));
            act(index, axis, command);
        }
    }
}

/// Command of the tick to the axis at `index`.
#[inline]
fn command<const N: usize>(
    index: usize,
    axis: &Axis,
    order: &Order<N>,
    tick: &TickInput<N>,
    accepted: &Accepted<N>,
) -> Option<AxisCommand> {
    let (nominal, actual) = reading(index, axis, tick, order.holds)?;
    Some(AxisCommand {
        action: order.action,
        obtains: order.obtains,
        shadow: order.shadow,
        target: *accepted.targets.get(index)?,
        nominal,
        nominal_flags: *order.nominal_flags.get(index)?,
        actual,
    })
}

/// Returns the nominal reference and the measurements that an axis acts on: what was read, or its
/// last ones.
#[inline]
fn reading<const N: usize>(
    index: usize,
    axis: &Axis,
    tick: &TickInput<N>,
    holds: bool,
) -> Option<(PositionNm, Actual)> {
    let Some(reading) = &tick.reading else {
        return Some((axis.nominal, axis.actual));
    };
    let nominal = if holds {
        axis.nominal
    } else {
        *reading.nominal.get(index)?
    };
    Some((nominal, *reading.actual.get(index)?))
}

/// Flags of the nominal references that were read, and whether one of them stops the machine. Their
/// second differences are looked at if two ticks were paced.
fn judge_nominal<const N: usize>(
    parameters: &Parameters<N>,
    axes: &[Axis; N],
    tick: &TickInput<N>,
    two_paced: bool,
) -> ([AxisFlags; N], bool) {
    let (mut all_flags, mut is_fault) = ([AxisFlags::default(); N], false);
    let Some(reading) = &tick.reading else {
        return (all_flags, is_fault);
    };
    let cycles = tick.cycles();
    for index in 0..N {
        // Every array has N elements.
        if let (Some(flags), Some(axis), Some(to), Some(config)) = (
            all_flags.get_mut(index),
            axes.get(index),
            reading.nominal.get(index),
            parameters.axes.get(index),
        ) {
            if nominal_stepped(axis.nominal, *to, config, cycles) {
                *flags = flags.with(AxisFlags::NOMINAL_STEP, true);
                is_fault = true;
            }
            if let Some(limit) = config.nominal_accel {
                if two_paced && nominal_accelerated(axis, *to, limit) {
                    *flags = flags.with(AxisFlags::NOMINAL_ACCEL, true);
                    is_fault |= limit.is_fault;
                }
            }
        }
    }
    (all_flags, is_fault)
}

/// The only constructor of a complete input: accepted events, and the tick's own.
fn complete<const N: usize>(
    accepted: FsmInput,
    known: Known,
    all_zero: bool,
    agitated: bool,
    tick: &TickInput<N>,
    nominal_fault: bool,
) -> FsmInput {
    // Somebody must look at a machine that was not read, or did not take its references.
    let outage = tick.reading.is_none() || known.refused;
    FsmInput {
        stop: accepted.stop || tick.stop || outage,
        quit: tick.quit,
        rearm: tick.rearm,
        skipped: tick.cycles().saturating_sub(1),
        all_zero,
        agitated,
        nominal_fault,
        ..accepted
    }
}

/// True if every offset in force is zero.
pub(super) fn all_zero<const N: usize>(axes: &[Axis; N]) -> bool {
    each(axes).all(|axis| axis.channels.is_zero())
}

/// True if the agitation of an axis is beyond its budget.
fn is_agitated<const N: usize>(parameters: &Parameters<N>, axes: &[Axis; N]) -> bool {
    zip(axes, &parameters.axes).any(|(axis, config)| axis.is_agitated(config))
}

/// Action of the shadow: it follows fresh commands in Submit and holds over a miss; elsewhere it
/// rests at zero.
const fn shadow_action(phase: Phase, fresh: bool) -> Option<Action> {
    match (phase, fresh) {
        (Phase::Submit, true) => Some(Action::Follow),
        (Phase::Submit, false) => Some(Action::Hold),
        _ => None,
    }
}
