//! Budget of bytes and connections between two ticks, so that no peer can make a tick long. The
//! rest waits in its socket.

use gantry_tau_core::control::session::Connection;

/// Bytes of the owner of the session per tick: three Commands of six axes. A client that sends one
/// Command per State, and goes on after one was lost, never has more waiting.
pub(crate) const OWNER_BYTES: usize = 300;
/// Bytes of all other connections together per tick: one frame of six axes.
pub(crate) const NON_OWNER_BYTES: usize = 128;

/// Bytes read and connections accepted since the last tick.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct IngressBudget {
    owner: usize,
    non_owners: usize,
    accepted: bool,
}

impl IngressBudget {
    /// Takes one new connection. True if it is the first of this tick.
    pub(crate) fn accept(&mut self) -> bool {
        !core::mem::replace(&mut self.accepted, true)
    }

    /// Returns the bytes that may still be read of a connection.
    pub(crate) fn left(&self, connection: Connection, owner: Option<Connection>) -> usize {
        if owner == Some(connection) {
            OWNER_BYTES.saturating_sub(self.owner)
        } else {
            NON_OWNER_BYTES.saturating_sub(self.non_owners)
        }
    }

    /// Counts bytes that were read of a connection.
    pub(crate) fn count(
        &mut self,
        connection: Connection,
        owner: Option<Connection>,
        bytes: usize,
    ) {
        let sum = if owner == Some(connection) {
            &mut self.owner
        } else {
            &mut self.non_owners
        };
        *sum = sum.saturating_add(bytes);
    }
}
