//! Black boxes: the last ticks before the end of a session, and those after it.
//!
//! The cycle records into a frozen-on-demand [`BlackBox`] and sends it out through the
//! [`swap_channel`]; what writes files is in the crate `gantry-tau-record`.

pub mod loops;
pub mod swap_channel;

use gantry_tau_core::control::message::Cause;
use gantry_tau_core::control::session::{BlackBox, Entry, Session};
use gantry_tau_core::units::{Epoch, Tick};

use loops::LoopsWindow;

/// Half of a black box, in ticks: at least so many remain before and after a cause.
pub const HALF: usize = 64;

/// Consecutive ticks, and the session before them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Window<const N: usize> {
    /// Session before the oldest tick.
    pub before: Session<N>,
    /// Ticks, oldest first; at least one.
    pub entries: Vec<Entry<N>>,
    /// The same ticks of the server's position loops, if it has any. A file of its own has them.
    pub loops: Option<LoopsWindow<N>>,
}

/// The end of a session, or a stop, in a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct End {
    /// Index of its entry in the window.
    pub index: usize,
    /// Tick.
    pub tick: Tick,
    /// Epoch of the session.
    pub epoch: Epoch,
    /// Cause; `None` in a window without an end.
    pub cause: Option<Cause>,
}

impl<const N: usize> Window<N> {
    /// Copies the content of a black box; `None` if it is empty.
    #[must_use]
    pub fn of<const HALF: usize>(black_box: &BlackBox<N, HALF>) -> Option<Self> {
        let before = *black_box.before()?;
        let entries: Vec<_> = black_box.entries().cloned().collect();
        (!entries.is_empty()).then_some(Self {
            before,
            entries,
            loops: None,
        })
    }

    /// Returns the first end in the window, which froze the box; its last entry if there is none.
    #[must_use]
    pub fn end(&self) -> End {
        let mut outputs = self.entries.iter().map(|entry| &entry.output);
        let ended = outputs.position(|output| output.ended.is_some());
        let index = ended.unwrap_or(self.entries.len().saturating_sub(1));
        let output = self.entries.get(index).map(|entry| &entry.output);
        End {
            index,
            tick: output.map_or(self.before.last_tick(), |output| output.state.tick),
            epoch: output.map_or(self.before.epoch(), |output| output.state.epoch),
            cause: output.and_then(|output| output.ended),
        }
    }

    /// Returns the name of a file of this window: epoch, tick and cause; of the stops, `Quit` is
    /// one that latches nothing.
    #[must_use]
    pub fn file_name(&self) -> String {
        let end = self.end();
        let is_latched = self
            .entries
            .get(end.index)
            .is_some_and(|entry| entry.output.latched);
        let cause = match end.cause {
            Some(Cause::Stop) if !is_latched => "Quit",
            cause => cause.map_or("NoEnd", Cause::name),
        };
        format!("epoch-{}-tick-{}-{cause}.jsonl", end.epoch.0, end.tick.0)
    }
}

/// True for an end after which the next client is let in without a hand at the machine: any client
/// can bring about as many as it likes.
const fn is_end_by_anyone(cause: Cause) -> bool {
    !matches!(cause, Cause::Stop | Cause::Nominal | Cause::Restart)
}
