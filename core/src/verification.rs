//! Internals for proofs, fuzzing and tests. Not part of the public interface: anything here may change in any version.

/// The rooms of a session's tick, of a client, and of a monitor.
pub mod control {
    pub use crate::control::client::dialogue::{Dialogue, Granted, Last, Stage};
    pub use crate::control::monitor::axis::AxisMonitor;
    pub use crate::control::monitor::trace::{Bounds, Breach, Motion, Trace};
    pub use crate::control::monitor::{Parts as MonitorParts, Seen};
    pub use crate::control::session::Parts;
    pub use crate::control::session::act::{Axis, AxisCommand, drive_reference, nominal_stepped};
    pub use crate::control::session::channels::AxisChannels;
    pub use crate::control::session::fsm::{
        Action, Decision, EndReason, FsmInput, FsmState, Rules, decide,
    };
    pub use crate::control::session::ingress::{Accepted, Classifier, Diagnostics, Verdict};

    use crate::control::client::Client;
    use crate::control::monitor::Monitor;
    use crate::control::session::config::Config;
    use crate::control::session::{Events, LastWrite, Output, Session, TickInput};
    use crate::control::wire::Deframer;
    use crate::units::EpochRange;

    /// Builds a client from its parts, if they satisfy the invariant.
    #[must_use]
    pub fn client_from_parts<const N: usize>(
        dialogue: Dialogue<N>,
        deframer: Deframer,
    ) -> Option<Client<N>> {
        Client::from_parts(dialogue, deframer)
    }

    /// Builds a monitor from its parts.
    #[must_use]
    pub const fn monitor_from_parts<const N: usize>(parts: MonitorParts<N>) -> Monitor<N> {
        Monitor::from_parts(parts)
    }

    /// Returns the parts of a monitor.
    #[must_use]
    pub const fn monitor_parts<const N: usize>(monitor: &Monitor<N>) -> &MonitorParts<N> {
        monitor.parts()
    }

    /// Builds a session from its parts, if they satisfy the invariant.
    #[must_use]
    pub fn from_parts<const N: usize>(config: Config<N>, parts: Parts<N>) -> Option<Session<N>> {
        Session::from_parts(config, parts)
    }

    /// Returns the parts of a session.
    #[must_use]
    pub const fn parts<const N: usize>(session: &Session<N>) -> &Parts<N> {
        session.parts()
    }

    /// First part of a tick: takes note of the fate of the last references.
    pub fn settle_write<const N: usize>(session: &mut Session<N>, last_write: &LastWrite<N>) {
        session.settle_write(last_write);
    }

    /// Second part of a tick: classifies the events.
    #[must_use]
    pub fn classify<const N: usize>(
        session: &Session<N>,
        events: &Events<N>,
        epochs: &EpochRange,
    ) -> (Accepted<N>, Diagnostics) {
        session.classify(events, epochs)
    }

    /// Third part of a tick: decides and acts.
    pub fn step<const N: usize>(
        session: &mut Session<N>,
        tick: &TickInput<N>,
        accepted: Accepted<N>,
        diagnostics: Diagnostics,
    ) -> Output<N> {
        session.step(tick, accepted, diagnostics)
    }
}
