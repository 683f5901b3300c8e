//! The chain as a wire in process, with the faults that a cable has.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::chain::{Chain, Process};
use crate::wire::{Wire, WireError};

/// Longest frame, bytes.
const MAX_FRAME: usize = 1_536;
/// Frames on their way back at most.
const FRAMES: usize = 8;

/// Faults of the next frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// Frames that are lost on the way out: no drive sees them.
    pub lost_out: u32,
    /// Frames that are lost on the way back: the drives have seen them.
    pub lost_back: u32,
    /// Delay of the answers, µs.
    pub delay_us: u64,
    /// Frames that this delay is for.
    pub delayed: u32,
    /// Number by which the working counter of the last datagrams' frame is too low, as a
    /// SubDevice's refusal would leave it.
    pub counter_less: u16,
}

/// A chain with what is on the cable: shared between a wire and whoever handles the drives.
#[derive(Debug)]
pub struct Bench<P> {
    /// The chain.
    pub chain: Chain<P>,
    /// Faults.
    pub faults: Faults,
    /// Frames to come that come back without the time of the reference.
    pub lost_times: u32,
    /// Time at which the cycle began that began last.
    cycle_ns: u64,
    answers: [(u64, usize, [u8; MAX_FRAME]); FRAMES],
}

/// A wire in process. Clones share one bench.
#[derive(Debug)]
pub struct EmulatedWire<P>(Arc<Mutex<Bench<P>>>);

impl<P> Clone for EmulatedWire<P> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<P: Process> EmulatedWire<P> {
    /// Connects a chain.
    pub fn new(chain: Chain<P>) -> Self {
        let bench = Bench {
            chain,
            faults: Faults::default(),
            lost_times: 0,
            cycle_ns: 0,
            answers: [(0, 0, [0; MAX_FRAME]); FRAMES],
        };
        Self(Arc::new(Mutex::new(bench)))
    }

    /// Returns the bench, to handle drives and faults between two cycles.
    pub fn bench(&self) -> MutexGuard<'_, Bench<P>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets time pass without a MainDevice, µs.
    pub fn idle(&self, us: u64) {
        let mut bench = self.bench();
        let until = bench.chain.now_ns() + us * 1_000;
        bench.chain.advance_to_ns(until);
        bench.cycle_ns = bench.cycle_ns.max(until);
    }
}

impl<P: Process> Bench<P> {
    /// Takes the number of faults of one kind down by one; true if there was one.
    const fn strikes(count: &mut u32) -> bool {
        let strikes = *count > 0;
        *count = count.saturating_sub(1);
        strikes
    }

    fn send(&mut self, frame: &[u8]) {
        if Self::strikes(&mut self.faults.lost_out) {
            return;
        }
        let mut room = [0; MAX_FRAME];
        let Some(passed) = room.get_mut(..frame.len()) else {
            return;
        };
        passed.copy_from_slice(frame);
        if !self.chain.pass(passed) || Self::strikes(&mut self.faults.lost_back) {
            return;
        }
        lower_counter(passed, self.faults.counter_less);
        // The first datagram of a frame with a time is FRMW.
        let has_time = passed.get(16) == Some(&14);
        if let (true, Some(time)) = (
            has_time && Self::strikes(&mut self.lost_times),
            passed.get_mut(26..34),
        ) {
            time.fill(0);
        }
        let delay_us = if Self::strikes(&mut self.faults.delayed) {
            self.faults.delay_us
        } else {
            0
        };
        let due_us = self.chain.now_us() + delay_us;
        if let Some(place) = self.answers.iter_mut().find(|(_, length, _)| *length == 0) {
            *place = (due_us, frame.len(), room);
        }
    }

    fn receive(&mut self, buffer: &mut [u8]) -> Option<usize> {
        let now_us = self.chain.now_us();
        let due = self
            .answers
            .iter_mut()
            .filter(|(due_us, length, _)| *length > 0 && *due_us <= now_us);
        let (_, length, bytes) = due.min_by_key(|(due_us, _, _)| *due_us)?;
        let taken = std::mem::take(length);
        buffer
            .get_mut(..taken)?
            .copy_from_slice(bytes.get(..taken)?);
        Some(taken)
    }
}

/// Takes the first working counter of a frame down.
fn lower_counter(frame: &mut [u8], by: u16) {
    let length = usize::from(frame.get(23).copied().unwrap_or(0) & 7) << 8
        | usize::from(frame.get(22).copied().unwrap_or(0));
    if let Some(place) = frame.get_mut(26 + length..28 + length) {
        let counter = place
            .first()
            .map_or(0, |low| u16::from(*low))
            .saturating_sub(by);
        place.copy_from_slice(&counter.to_le_bytes());
    }
}

impl<P: Process> Wire for EmulatedWire<P> {
    fn now_us(&self) -> u64 {
        self.bench().chain.now_us()
    }

    fn now_ns(&self) -> u64 {
        self.bench().chain.now_ns()
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), WireError> {
        self.bench().send(frame);
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8]) -> Option<usize> {
        self.bench().receive(buffer)
    }

    fn wait_until(&mut self, us: u64) {
        self.bench().chain.advance_to(us);
    }

    fn begin_cycles(&mut self, cycles: u64, cycle_us: u64) {
        let mut bench = self.bench();
        let passed_ns = cycles.saturating_mul(cycle_us).saturating_mul(1_000);
        bench.cycle_ns = bench.cycle_ns.saturating_add(passed_ns);
        let until = bench.cycle_ns;
        // Bring-up takes time of its own; cycles are counted on from there.
        bench.cycle_ns = until.max(bench.chain.now_ns());
        bench.chain.advance_to_ns(until);
    }

    fn makes_cycles(&self) -> bool {
        true
    }

    fn shift_cycles(&mut self, ns: i64) {
        let mut bench = self.bench();
        bench.cycle_ns = bench.cycle_ns.saturating_add_signed(ns);
    }
}
