//! All that decides and moves in a tick: the discrete state and every axis.
//!
//! [`advance`] is given no counter, no cause and no clock: that what only counts decides nothing (T7) is its signature.

use super::act::{Axis, AxisCommand, nominal_stepped};
use super::config::Parameters;
use super::fsm::{Action, Decision, FsmInput, FsmState, Rules, decide};
use super::ingress::Accepted;
use super::io::Cycle;
use crate::control::axis::Reference;
use crate::control::message::{AxisState, Phase};
use crate::zip::{each, zip};

/// What became of a tick.
pub(super) struct Step<const N: usize> {
    /// The next discrete state, and what led to it.
    pub(super) decision: Decision,
    /// What was decided on.
    pub(super) fsm: FsmInput,
    /// What the drives receive.
    pub(super) references: [Reference; N],
    /// What each axis did.
    pub(super) axes: [AxisState; N],
}

/// Decides, and lets every axis carry the decision out.
pub(super) fn advance<const N: usize>(
    parameters: &Parameters<N>,
    discrete: &mut FsmState,
    axes: &mut [Axis; N],
    cycle: &Cycle<N>,
    accepted: &Accepted<N>,
) -> Step<N> {
    let stepped = all_nominal_stepped(parameters, axes, cycle);
    let fsm = complete(accepted.fsm, axes, cycle, &stepped);
    let rules = Rules {
        handshake_ticks: parameters.handshake_ticks,
        budget: parameters.budget,
    };
    let decision = decide(discrete, &fsm, &rules);
    let shadow = shadow_action(decision.next.phase, fsm.command.is_some());
    let mut references = [Reference::default(); N];
    let mut states = [AxisState::default(); N];
    for index in 0..N {
        let command = || {
            Some(AxisCommand {
                action: decision.action,
                shadow,
                target: *accepted.targets.get(index)?,
                nominal: *cycle.nominal.get(index)?,
                nominal_stepped: *stepped.get(index)?,
                actual: *cycle.actual.get(index)?,
            })
        };
        // Every array has N elements.
        let (Some(command), Some(axis), Some(config), Some(reference), Some(state)) = (
            command(),
            axes.get_mut(index),
            parameters.axes.get(index),
            references.get_mut(index),
            states.get_mut(index),
        ) else {
            continue;
        };
        (*reference, *state) = axis.act(&command, config);
    }
    *discrete = decision.next;
    Step {
        decision,
        fsm,
        references,
        axes: states,
    }
}

/// Which axes' nominal references moved further than they may.
fn all_nominal_stepped<const N: usize>(
    parameters: &Parameters<N>,
    axes: &[Axis; N],
    cycle: &Cycle<N>,
) -> [bool; N] {
    let mut stepped = [false; N];
    for (index, (axis, config)) in zip(axes, &parameters.axes).enumerate() {
        if let (Some(stepped), Some(to)) = (stepped.get_mut(index), cycle.nominal.get(index)) {
            *stepped = nominal_stepped(axis.nominal, *to, config, cycle.cycles());
        }
    }
    stepped
}

/// What was accepted, and what the cycle itself has to say.
fn complete<const N: usize>(
    accepted: FsmInput,
    axes: &[Axis; N],
    cycle: &Cycle<N>,
    stepped: &[bool; N],
) -> FsmInput {
    FsmInput {
        stop: accepted.stop || cycle.stop,
        rearm: cycle.rearm,
        skipped: cycle.cycles().saturating_sub(1),
        all_zero: all_zero(axes),
        nominal_fault: each(stepped).any(|stepped| *stepped),
        ..accepted
    }
}

/// Whether every offset in force is zero.
pub(super) fn all_zero<const N: usize>(axes: &[Axis; N]) -> bool {
    let mut axes = each(axes);
    axes.all(|axis| axis.channels.is_zero())
}

/// The shadow follows fresh commands in Submit and holds over a miss; elsewhere it rests at zero.
const fn shadow_action(phase: Phase, fresh: bool) -> Option<Action> {
    match (phase, fresh) {
        (Phase::Submit, true) => Some(Action::Follow),
        (Phase::Submit, false) => Some(Action::Hold),
        _ => None,
    }
}
