//! T21, the drive's theorem: what is in force at the drives never jumps, for any events between
//! them and the server.
//!
//! The drives keep the last references that they took. In a tick any of this may happen: the
//! machine is not read; the last references were not taken; they cannot be read back; nothing
//! reaches the network, or anything. One tick is one step of an induction over all runs: it begins
//! with any values in force and any valid session that has them, or will receive them, and ends
//! with the same.

use gantry_tau_core::control::axis::{InForce, Offsets};
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::control::session::config::AxisConfig;
use gantry_tau_core::control::session::{LastWrite, Output, Session, TickInput};
use gantry_tau_core::verification::control::{
    Accepted, Diagnostics, Internals, drive_reference, nominal_stepped,
};

use crate::properties::axis::Kind;
use crate::properties::session::StepInput;

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
    /// Fate of the last references, as the server is told.
    pub last_write: LastWrite<N>,
    /// Input of the tick.
    pub tick: TickInput<N>,
    /// Accepted events.
    pub accepted: Accepted<N>,
}

impl<const N: usize> Before<N> {
    /// Server and drives that belong together: after references that were taken, the drives have
    /// what the server demanded. After others they may have anything, `found`, which a read-back
    /// tells.
    #[must_use]
    pub fn new(
        session: Session<N>,
        found: [InForce; N],
        fate: Fate,
        tick: TickInput<N>,
        accepted: Accepted<N>,
    ) -> Self {
        let fate = if session.parts().withheld && fate == Fate::Taken {
            Fate::Unread
        } else {
            fate
        };
        let (drives, last_write) = match fate {
            Fate::Taken => (session.demanded(), LastWrite::Accepted),
            Fate::Refused => (found, LastWrite::Refused { in_force: found }),
            Fate::Unread => (found, LastWrite::Unknown),
        };
        Self {
            session,
            drives,
            last_write,
            tick,
            accepted,
        }
    }

    /// Runs the tick: the session when its write is settled, the session after it, and its output.
    fn run(&self) -> (Session<N>, Session<N>, Output<N>) {
        let mut settled = self.session;
        settled.apply_write_result(&self.last_write);
        let diagnostics = Diagnostics::default();
        let input = StepInput {
            session: settled,
            tick: self.tick,
            refused: self.last_write != LastWrite::Accepted,
            accepted: self.accepted,
            diagnostics,
        };
        let (after, output) = input.step();
        (settled, after, output)
    }

    fn config(&self, axis: usize) -> &AxisConfig {
        &self.session.config().parameters().axes[axis]
    }
}

/// T21: nothing is written while the values in force are unknown or beyond their limits.
pub fn unknown_is_not_written<const N: usize>(before: &Before<N>) {
    let (_, _, output) = before.run();
    let known = before.last_write != LastWrite::Unknown
        && (0..N).all(|axis| {
            before
                .config(axis)
                .limits
                .admits(&before.drives[axis].offsets)
        });
    assert!(
        known || output.withheld,
        "T21: nothing is written while it is unknown what is in force"
    );
}

/// T21: a session is granted only while every offset in force at the drives is zero.
pub fn granted_at_zero_in_force<const N: usize>(before: &Before<N>) {
    let (_, _, output) = before.run();
    let at_zero = (0..N).all(|axis| before.drives[axis].offsets == Offsets::ZERO);
    assert!(
        at_zero || output.welcome.is_none(),
        "T21: granted only at zero in force"
    );
}

/// T21: what is written changes an offset at the drive by at most its `S`.
pub fn offset_changes_by_a_step<const N: usize>(before: &Before<N>, kind: Kind) {
    let (_, after, output) = before.run();
    if output.withheld {
        return;
    }
    let demanded = after.demanded();
    for axis in 0..N {
        let limits = &before.config(axis).limits;
        let (from, to) = (&before.drives[axis].offsets, &demanded[axis].offsets);
        let (change, step) = match kind {
            Kind::Position => (
                to.position.0.abs_diff(from.position.0),
                limits.position.step(),
            ),
            Kind::Velocity => (
                to.velocity.0.abs_diff(from.velocity.0),
                limits.velocity.step(),
            ),
            Kind::Torque => (
                to.torque.0.abs_diff(from.torque.0).into(),
                limits.torque.step(),
            ),
        };
        assert!(
            change <= step.unsigned_abs(),
            "T21: an offset at the drive changes by at most S"
        );
    }
}

/// T21: a nominal reference that is further from the one in force than its limit is not written
/// after a start, a refused write or a failed read; otherwise it is a fault.
pub fn path_is_waited_for<const N: usize>(before: &Before<N>) {
    let (settled, after, output) = before.run();
    if output.withheld {
        return;
    }
    let waits = settled.parts().off_path || before.tick.reading.is_none();
    let demanded = after.demanded();
    for axis in 0..N {
        let (from, to) = (before.drives[axis].nominal, demanded[axis].nominal);
        // Core's own comparison: a second product of two unknowns is beyond the solver.
        let is_far = nominal_stepped(from, to, before.config(axis), before.tick.cycles());
        let is_fault = after.phase() == Phase::Fault && !waits;
        assert!(
            !is_far || is_fault,
            "T21: a nominal reference that is far away waits, or is a fault"
        );
    }
}

/// T21: what is written is what the server takes for demanded: nominal plus offset, clamped to the
/// travel. So by [`crate::properties::axis::reference_moves_no_further`] the reference changes by at most the
/// changes of nominal and offset.
pub fn demanded_is_written<const N: usize>(before: &Before<N>) {
    let (_, after, output) = before.run();
    let demanded = after.demanded();
    for axis in 0..N {
        let InForce { nominal, offsets } = demanded[axis];
        let (reference, _) =
            drive_reference(nominal, &offsets, &before.config(axis).machine_travel);
        assert!(
            output.references[axis] == reference,
            "T21: what is written is what is demanded"
        );
    }
}

/// T21, all of it.
pub fn nothing_jumps<const N: usize>(before: &Before<N>) {
    unknown_is_not_written(before);
    granted_at_zero_in_force(before);
    for kind in Kind::ALL {
        offset_changes_by_a_step(before, kind);
    }
    path_is_waited_for(before);
    demanded_is_written(before);
}
