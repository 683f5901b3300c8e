//! How much is taken in between two ticks: bounded, so that nobody can make a tick long. What has come beyond waits where it is.

use gantry_tau_core::control::session::fsm::Connection;

/// Most bytes of the owner of the session: three Commands of six axes. A client that sends one Command per State, and goes on after
/// one was lost, never has more of them waiting.
pub(crate) const OF_OWNER: usize = 300;
/// Most bytes of all others together: a whole frame of six axes.
pub(crate) const OF_OTHERS: usize = 128;

/// What has been taken in since the last tick.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Reading {
    of_owner: usize,
    of_others: usize,
    accepted: bool,
}

impl Reading {
    /// Whether a connection may be taken in: one per tick.
    pub(crate) fn accept(&mut self) -> bool {
        !core::mem::replace(&mut self.accepted, true)
    }

    /// How many bytes may still be read of a connection.
    pub(crate) fn left(&self, connection: Connection, owner: Option<Connection>) -> usize {
        if owner == Some(connection) {
            OF_OWNER.saturating_sub(self.of_owner)
        } else {
            OF_OTHERS.saturating_sub(self.of_others)
        }
    }

    /// So many bytes of a connection were read.
    pub(crate) fn note(&mut self, connection: Connection, owner: Option<Connection>, bytes: usize) {
        let sum = if owner == Some(connection) {
            &mut self.of_owner
        } else {
            &mut self.of_others
        };
        *sum = sum.saturating_add(bytes);
    }
}
