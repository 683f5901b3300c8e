//! Rooms of a session's tick, of a client, and of a monitor.

#[cfg(feature = "keyed")]
pub mod keyed;

pub use crate::control::client::dialogue::{Dialogue, Granted, Last, Stage};
pub use crate::control::client::guard::Guard;
pub use crate::control::endpoint::slot::Slot;
pub use crate::control::monitor::axis::AxisMonitor;
pub use crate::control::monitor::trace::{Bounds, Breach, Motion, Trace};
pub use crate::control::monitor::{Parts as MonitorParts, Seen};
pub use crate::control::session::Parts;
pub use crate::control::session::act::{
    Axis, AxisCommand, drive_reference, nominal_accelerated, nominal_stepped,
};
pub use crate::control::session::channels::AxisChannels;
pub use crate::control::session::fsm::{
    Action, Decision, EndReason, FsmInput, FsmState, Rules, decide,
};
pub use crate::control::session::ingress::{Accepted, Classifier, Diagnostics, Verdict};
pub use crate::control::session::step::{Known, Order, carry_out, order};
pub use crate::control::wire::frame::checksum;

use crate::control::client::Client;
use crate::control::endpoint::{Endpoint, Write};
use crate::control::monitor::Monitor;
use crate::control::session::config::Config;
use crate::control::session::{Connection, Event, Events, LastWrite, Output, Session, TickInput};
use crate::units::EpochRange;

/// The state of a session, and the three parts of its tick.
pub trait Internals<const N: usize>: Sized {
    /// Builds a session from its parts, if they satisfy the invariant.
    fn from_parts(config: Config<N>, parts: Parts<N>) -> Option<Self>;
    /// Returns the parts of a session.
    fn parts(&self) -> &Parts<N>;
    /// First part of a tick: takes note of the fate of the last references.
    fn apply_write_result(&mut self, last_write: &LastWrite<N>);
    /// Second part of a tick: classifies the events.
    fn classify(&self, events: &Events<N>, epochs: &EpochRange) -> (Accepted<N>, Diagnostics);
    /// Third part of a tick: decides and acts; the references of the last tick were `refused`.
    fn step(
        &mut self,
        tick: &TickInput<N>,
        refused: bool,
        events: &Accepted<N>,
        counts: &Diagnostics,
    ) -> Output<N>;
}

impl<const N: usize> Internals<N> for Session<N> {
    fn from_parts(config: Config<N>, parts: Parts<N>) -> Option<Self> {
        Self::from_parts(config, parts)
    }

    fn parts(&self) -> &Parts<N> {
        self.parts()
    }

    fn apply_write_result(&mut self, last_write: &LastWrite<N>) {
        self.apply_write_result(last_write);
    }

    fn classify(&self, events: &Events<N>, epochs: &EpochRange) -> (Accepted<N>, Diagnostics) {
        let (mut accepted, mut diagnostics) = (
            Accepted::nothing(),
            Diagnostics::after(&self.parts().counters),
        );
        self.classify(events, epochs, &mut accepted, &mut diagnostics);
        (accepted, diagnostics)
    }

    fn step(
        &mut self,
        tick: &TickInput<N>,
        refused: bool,
        events: &Accepted<N>,
        counts: &Diagnostics,
    ) -> Output<N> {
        self.step(tick, refused, events, counts)
    }
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

/// Returns the events that wait for the coming tick of an endpoint.
#[must_use]
pub fn inbox<const N: usize>(endpoint: &Endpoint<N>) -> &[(Connection, Event<N>)] {
    endpoint.inbox()
}

/// Returns an output without references and answers, the State of a server that has not run.
#[must_use]
pub fn no_output<const N: usize>() -> Output<N> {
    Output::nothing()
}

/// Returns what an endpoint returns of a tick with this output.
pub const fn pending<'a, const N: usize>(
    session: &'a Session<N>,
    output: &'a mut Output<N>,
    last_write: &'a mut LastWrite<N>,
    is_told: &'a mut bool,
) -> Write<'a, N> {
    Write::of(session, output, last_write, is_told)
}

/// True if a connection has its place in an endpoint.
#[must_use]
pub fn is_open<const N: usize>(endpoint: &Endpoint<N>, connection: Connection) -> bool {
    endpoint.is_open(connection)
}

/// Builds a client, between two frames, from its parts.
#[must_use]
pub const fn client_from_parts<const N: usize>(dialogue: Dialogue<N>, guard: Guard) -> Client<N> {
    Client::from_parts(dialogue, guard)
}

/// Returns the state machine of a client.
#[must_use]
pub const fn dialogue_of<const N: usize>(client: &Client<N>) -> &Dialogue<N> {
    client.dialogue()
}
