//! Channel of black boxes out of the cycle, without a copy, an allocation, a lock or a wait: a full
//! box is swapped with an empty one. The queue carries pointers; the emptied boxes come back the
//! same way.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_core::control::session::{BlackBox, Entry};

use super::loops::{LoopsBox, LoopsWindow};
use super::{HALF, Window, is_end_by_anyone};

/// Full boxes that can wait for the receiver.
const SPARES: usize = 4;
/// Empty boxes that are kept for sessions that obtained: clients that come and go cannot use them
/// up.
const RESERVED: usize = 2;

/// The boxes of the session and of its position loops: some 390 kB at 3 axes, 600 kB at 6.
#[derive(Debug, Default)]
struct Recorded<const N: usize> {
    /// The session in it, or the one before a stop in it, has obtained since its Welcome. A window
    /// alone does not tell: it begins 64 ticks before the end.
    obtained: bool,
    session: BlackBox<N, HALF>,
    loops: LoopsBox<N>,
}

impl<const N: usize> Recorded<N> {
    /// Causes of the ends in the box.
    fn ends(&self) -> impl Iterator<Item = Cause> {
        self.session
            .entries()
            .filter_map(|entry: &Entry<N>| entry.output.ended)
    }

    /// True for a window that must not be lost, see [`Receiver::receive_judged`].
    fn is_of_value(&self) -> bool {
        self.obtained || self.ends().any(|cause| !is_end_by_anyone(cause))
    }
}

type Parcel<const N: usize> = Box<Recorded<N>>;

/// The cycle's end: the box that is being recorded, and the queue of full ones.
#[derive(Debug)]
pub struct Sender<const N: usize> {
    parcel: Parcel<N>,
    full: rtrb::Producer<Parcel<N>>,
    empty: rtrb::Consumer<Parcel<N>>,
    lost: Arc<AtomicU64>,
}

/// The other end.
#[derive(Debug)]
pub struct Receiver<const N: usize> {
    full: rtrb::Consumer<Parcel<N>>,
    empty: rtrb::Producer<Parcel<N>>,
    lost: Arc<AtomicU64>,
}

/// Creates both ends, and the empty boxes.
#[must_use]
pub fn channel<const N: usize>() -> (Sender<N>, Receiver<N>) {
    let (full, full_out) = rtrb::RingBuffer::new(SPARES);
    let (mut empty_in, empty) = rtrb::RingBuffer::new(SPARES);
    // As many boxes as places: no push fails, here or later.
    for _ in 0..SPARES {
        let _ = empty_in.push(Box::default());
    }
    let lost = Arc::new(AtomicU64::new(0));
    let sender = Sender {
        parcel: Box::default(),
        full,
        empty,
        lost: Arc::clone(&lost),
    };
    let receiver = Receiver {
        full: full_out,
        empty: empty_in,
        lost,
    };
    (sender, receiver)
}

impl<const N: usize> Sender<N> {
    /// Returns the box that is being recorded.
    pub fn black_box(&mut self) -> &mut BlackBox<N, HALF> {
        &mut self.parcel.session
    }

    /// Returns the box of the position loops. Every tick of the session must be a tick of it, or
    /// none.
    pub fn loops(&mut self) -> &mut LoopsBox<N> {
        &mut self.parcel.loops
    }

    /// Takes note of the phase of a tick: the session may obtain.
    pub fn see(&mut self, phase: Phase) {
        self.parcel.obtained |= phase == Phase::Obtain;
    }

    /// Sends a frozen box, after which recording goes on. Without an empty box it stays frozen
    /// until there is one.
    pub fn send_frozen(&mut self) {
        if self.parcel.session.is_frozen() {
            self.swap();
        }
    }

    /// Sends a box with an end in it, frozen or not. It cannot wait: without an empty box it is
    /// lost, and counted if it is of value.
    pub fn send_end(&mut self) {
        let has_end = self.parcel.ends().next().is_some();
        if has_end && !self.swap() && self.parcel.is_of_value() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Sends the end of the last session, which was kept until now, and begins a recording.
    pub fn begin(&mut self) {
        self.send_end();
        self.parcel.session.release();
        self.parcel.loops.release();
        self.parcel.obtained = false;
    }

    fn swap(&mut self) -> bool {
        if !self.parcel.is_of_value() && self.empty.slots() <= RESERVED {
            return false;
        }
        let Ok(empty) = self.empty.pop() else {
            return false;
        };
        let full = std::mem::replace(&mut self.parcel, empty);
        self.parcel.obtained = full.obtained;
        self.full.push(full).is_ok()
    }
}

impl<const N: usize> Receiver<N> {
    /// Returns the next window that was sent.
    pub fn receive(&mut self) -> Option<Window<N>> {
        self.receive_judged().map(|(window, _)| window)
    }

    /// Returns the next window that was sent, and whether it is of value: its session obtained, or
    /// was ended by a stop or a fault, after which only a hand at the machine lets the next client
    /// in. Of others any client can bring about as many as it likes. The box goes back empty.
    pub fn receive_judged(&mut self) -> Option<(Window<N>, bool)> {
        let mut parcel = self.full.pop().ok()?;
        let loops = LoopsWindow::of(&parcel.loops);
        let is_of_value = parcel.is_of_value();
        let window =
            Window::of(&parcel.session).map(|window| (Window { loops, ..window }, is_of_value));
        parcel.session.release();
        parcel.loops.release();
        // There is room, see `channel`; a cycle that has ended needs no boxes.
        let _ = self.empty.push(parcel);
        window
    }

    /// Returns the number of windows lost since the last call: they could not wait, and every box
    /// was full.
    pub fn take_lost(&mut self) -> u64 {
        self.lost.swap(0, Ordering::Relaxed)
    }
}
