//! Gets black boxes out of the cycle without a copy, an allocation, a lock or a wait: a full box is swapped with an empty one.
//!
//! A swap moves two boxes (360 kB each at 3 axes, 540 kB at 6; 30 to 90 µs measured) once per end, after the tick has written its
//! references and its State, and when no session is running or the newest has just been granted. What then travels through the
//! queue is a pointer, and the emptied boxes come back the same way. A copy would cost the cycle no less, and 400 kB of queue more.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use gantry_tau_core::control::session::BlackBox;

use super::Window;
use crate::server::HALF;

/// Boxes that can be under way. Each waits for the disk, never the cycle for it.
const SPARES: usize = 4;

type Parcel<const N: usize> = Box<BlackBox<N, HALF>>;

/// The cycle's end.
#[derive(Debug)]
pub struct Handover<const N: usize> {
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

/// Both ends, and the empty boxes.
#[must_use]
pub fn channel<const N: usize>() -> (Handover<N>, Receiver<N>) {
    let (full, full_out) = rtrb::RingBuffer::new(SPARES);
    let (mut empty_in, empty) = rtrb::RingBuffer::new(SPARES);
    // As many boxes as places: no push fails, here or later.
    for _ in 0..SPARES {
        let _ = empty_in.push(Box::default());
    }
    let lost = Arc::new(AtomicU64::new(0));
    let handover = Handover {
        full,
        empty,
        lost: Arc::clone(&lost),
    };
    let receiver = Receiver {
        full: full_out,
        empty: empty_in,
        lost,
    };
    (handover, receiver)
}

impl<const N: usize> Handover<N> {
    /// Takes the contents of a black box, which is empty then. Without an empty one to swap with, it stays as it is.
    pub fn take(&mut self, black_box: &mut BlackBox<N, HALF>) -> bool {
        let Ok(mut parcel) = self.empty.pop() else {
            return false;
        };
        std::mem::swap(&mut *parcel, black_box);
        self.full.push(parcel).is_ok()
    }

    /// As [`Self::take`], for a box that cannot stay: if it is not taken, it is counted as lost.
    pub fn take_now(&mut self, black_box: &mut BlackBox<N, HALF>) {
        if !self.take(black_box) {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl<const N: usize> Receiver<N> {
    /// The next window that has been handed over. Its box goes back empty.
    pub fn receive(&mut self) -> Option<Window<N>> {
        loop {
            let mut parcel = self.full.pop().ok()?;
            let window = Window::of(&parcel);
            parcel.release();
            // There is room, see `channel`; a cycle that has ended needs no boxes.
            let _ = self.empty.push(parcel);
            if window.is_some() {
                return window;
            }
        }
    }

    /// Windows that could not wait and found every box under way, since this was asked last.
    pub fn take_lost(&mut self) -> u64 {
        self.lost.swap(0, Ordering::Relaxed)
    }
}
