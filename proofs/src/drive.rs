//! T21, the drive's theorem: what is in force at the drives never jumps, whatever happens between them and the server.
//!
//! The drives keep the last references that they took. In a tick any of this may happen: the machine is not read; the last references were
//! not taken; they cannot be read back; nothing reaches the network, or anything. One tick is one step of an induction over all runs:
//! it begins with any values in force and any valid session that has them, or will be told them, and ends with the same.

use gantry_tau_core::control::axis::InForce;
use gantry_tau_core::control::message::{AxisLimits, Phase};
use gantry_tau_core::control::session::config::{AxisConfig, MAX_POSITION_NM};
use gantry_tau_core::control::session::{LastWrite, Output, Session, TickInput};
use gantry_tau_core::verification::control::{Accepted, Internals, drive_reference};

use crate::session::StepInput;

/// Fate of the last references, as the drives know it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Fate {
    /// The drives took them.
    Taken,
    /// They did not, and say what they have.
    Refused,
    /// They did not, and cannot be read back.
    Unread,
}

/// Server and drives before a tick.
#[derive(Clone, Debug)]
pub struct Before<const N: usize> {
    /// The server.
    pub session: Session<N>,
    /// Values in force at the drives.
    pub drives: [InForce; N],
    /// Input of the tick; `last_write` tells the fate.
    pub tick: TickInput<N>,
    /// Accepted events.
    pub accepted: Accepted<N>,
}

impl<const N: usize> Before<N> {
    /// Server and drives that belong together: after references that were taken, the drives have what the server demanded. After others
    /// they may have anything, `found`, which a read-back tells.
    #[must_use]
    pub fn new(
        session: Session<N>,
        found: [InForce; N],
        fate: Fate,
        tick: TickInput<N>,
        accepted: Accepted<N>,
    ) -> Self {
        let fate = if session.parts().withheld && fate == Fate::Taken { Fate::Unread } else { fate };
        let (drives, last_write) = match fate {
            Fate::Taken => (session.demanded(), LastWrite::Accepted),
            Fate::Refused => (found, LastWrite::Refused { in_force: found }),
            Fate::Unread => (found, LastWrite::Unknown),
        };
        Self { session, drives, tick: TickInput { last_write, ..tick }, accepted }
    }

    /// Runs the tick: the session when its write is settled, the session after it, and its output.
    fn run(&self) -> (Session<N>, Session<N>, Output<N>) {
        let mut settled = self.session;
        settled.settle_write(&self.tick.last_write);
        let input =
            StepInput { session: settled, tick: self.tick, accepted: self.accepted, diagnostics: Default::default() };
        let (after, output) = input.step();
        (settled, after, output)
    }
}

/// T21, one tick:
/// - nothing is written while the values in force are unknown or beyond their limits;
/// - what is written changes each offset at the drive by at most its `S`;
/// - and the position reference by at most the change of the nominal reference plus `S`, where a nominal reference that is further from
///   the one in force than its limit is not written after a start, a refused write or a failed read, and otherwise is a fault;
/// - a session is granted only at zero in force;
/// - and what the server then takes for demanded is what was written.
pub fn nothing_jumps<const N: usize>(before: &Before<N>) {
    let (settled, after, output) = before.run();
    let axes = &before.session.config().parameters().axes;
    let known = before.tick.last_write != LastWrite::Unknown
        && (0..N).all(|axis| axes[axis].limits.admits(&before.drives[axis].offsets));
    if !known {
        assert!(output.withheld, "T21: nothing is written while it is unknown what is in force");
    }
    assert!(
        output.welcome.is_none() || (0..N).all(|axis| is_zero(&before.drives[axis])),
        "T21: granted only at zero in force"
    );
    if output.withheld {
        return;
    }
    let off_path = settled.parts().off_path || before.tick.reading.is_none();
    for axis in 0..N {
        let (from, to) = (&before.drives[axis], &after.demanded()[axis]);
        offsets_change_by_a_step(from, to, &axes[axis].limits);
        let nominal_nm = u128::from(from.nominal.0.abs_diff(to.nominal.0));
        let limit_nm = u128::from(axes[axis].nominal_step_nm) * u128::from(before.tick.cycles());
        let faulted = after.phase() == Phase::Fault && !off_path;
        assert!(nominal_nm <= limit_nm || faulted, "T21: a nominal reference that is far away waits, or is a fault");
        reference_is_what_is_demanded(to, &output, axis, &axes[axis]);
        reference_changes_by_a_step(from, to, &axes[axis]);
    }
}

fn is_zero(axis: &InForce) -> bool {
    axis.offsets == Default::default()
}

/// Each offset at the drive changes by at most its `S`.
fn offsets_change_by_a_step(from: &InForce, to: &InForce, limits: &AxisLimits) {
    let (from, to) = (&from.offsets, &to.offsets);
    let position = to.position.0.abs_diff(from.position.0) <= limits.position.step().unsigned_abs();
    let velocity = to.velocity.0.abs_diff(from.velocity.0) <= limits.velocity.step().unsigned_abs();
    let torque = u32::from(to.torque.0.abs_diff(from.torque.0)) <= limits.torque.step().unsigned_abs();
    assert!(position, "T21: the position offset changes by at most S");
    assert!(velocity, "T21: the velocity offset changes by at most S");
    assert!(torque, "T21: the torque offset changes by at most S");
}

/// What is written is nominal plus offset, clamped to the travel.
fn reference_is_what_is_demanded<const N: usize>(to: &InForce, output: &Output<N>, axis: usize, config: &AxisConfig) {
    let (reference, _) = drive_reference(to.nominal, &to.offsets, &config.machine_travel);
    assert!(output.references[axis] == reference, "T21: what is written is what is demanded");
}

/// The position reference changes by at most the change of the nominal reference plus `S`, for `|nominal| <= 2^61` nm.
fn reference_changes_by_a_step(from: &InForce, to: &InForce, config: &AxisConfig) {
    let representable = |axis: &InForce| axis.nominal.0.unsigned_abs() <= MAX_POSITION_NM.unsigned_abs();
    if !representable(from) || !representable(to) {
        return;
    }
    let reference = |axis: &InForce| drive_reference(axis.nominal, &axis.offsets, &config.machine_travel).0.position.0;
    let moved = reference(to).abs_diff(reference(from));
    let allowed = to.nominal.0.abs_diff(from.nominal.0) + u64::from(config.limits.position.step().unsigned_abs());
    assert!(moved <= allowed, "T21: the reference changes by at most the change of the nominal one plus S");
}
