//! Source of the server's ticks: the clock, or the client's answers.

use std::sync::atomic::Ordering;

use gantry_tau_core::control::message::Phase;

use super::cycle::{Cycle, OperatorInputs};
use super::{Controls, ServerError};
use crate::plant::Plant;
use crate::realtime::{CycleTimer, now_ns, sleep_until_ns, wait_readable_until_ns};
use crate::record::TickRecord;

/// Length of a cycle, ns.
const PERIOD_NS: u64 = 1_000_000;
/// Lock-step: silence that counts as a miss, ns.
const SILENCE_NS: u64 = 1_000_000_000;
/// Lock-step: silence that counts as a tick of the handshake, ns; a thousand of them end the
/// handshake.
const HANDSHAKE_SILENCE_NS: u64 = 10_000_000;
/// Lock-step: longest wait between two polls of the sockets, ns.
const POLL_NS: u64 = 500_000;
/// Ticks in a row without an accepted write, or at zero with a latch that cannot be stored, after
/// which a server that is to end gives up.
const QUIT_PATIENCE: u32 = 2_000;
/// Frames of the owner per tick that are timed; further ones wait for the deadline.
const ENOUGH_FRAMES: u8 = 4;

/// Source of the ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TickSource {
    /// A tick per millisecond of the machine's clock; an answer is due before the next.
    RealTime,
    /// A tick per answer: time is counted in ticks, and the server waits for its client. Without a
    /// session, about a tick per millisecond.
    Lockstep,
}

/// Sets up the calling thread: real-time priority for ticks of the clock, then no privileges.
pub(super) fn set_up_thread(ticks: TickSource) {
    if ticks == TickSource::RealTime {
        if let Err(denied) = crate::realtime::raise_priority() {
            tracing::warn!("cycle thread: no {}: {}", denied.privilege, denied.reason);
        }
    }
    if let Err(error) = gantry_tau_system::privileges::give_up(&[]) {
        tracing::warn!("cycle thread: its privileges cannot be given up: {error}");
    }
}

/// Runs cycles until quit is requested and the drives have taken references without offsets.
///
/// # Errors
/// [`ServerError::StillInForce`]: quit is requested, and the machine has taken nothing for two
/// seconds. [`ServerError::StopNotStored`]: nor has the disk taken the latch, with zero in force.
pub(super) fn run<const N: usize, const M: usize, P: Plant<N, M>>(
    mut cycle: Cycle<N, M, P>,
    ticks: TickSource,
    controls: &Controls,
    mut rows: rtrb::Producer<TickRecord<N>>,
) -> Result<(), ServerError> {
    let mut timer = match cycle.first_deadline_ns() {
        Some(deadline_ns) => CycleTimer::starting_at(PERIOD_NS, deadline_ns),
        None => CycleTimer::starting_now(PERIOD_NS),
    };
    let mut state_left_ns = now_ns();
    let mut unfinished = 0;
    loop {
        let elapsed = match ticks {
            TickSource::RealTime => {
                watch_owner(&mut cycle, timer.deadline_ns(), state_left_ns);
                timer.wait()
            }
            TickSource::Lockstep => {
                wait_for_answer(&mut cycle, controls, state_left_ns);
                1
            }
        };
        cycle.receive();
        let quit = controls.quit.load(Ordering::Relaxed);
        let operator = OperatorInputs {
            stop: controls.take_stop(),
            quit,
            rearm: controls.take_rearm(cycle.phase()),
        };
        let row = cycle.step(elapsed, operator);
        timer.shift(cycle.deadline_shift_ns());
        state_left_ns = now_ns();
        if rows.push(row).is_err() {
            controls.dropped_rows.fetch_add(1, Ordering::Relaxed);
        }
        if cycle.may_end(quit) {
            cycle.send_end();
            return Ok(());
        }
        unfinished = if cycle.write_failed() || quit && cycle.is_at_zero() {
            unfinished + 1
        } else {
            0
        };
        if quit && unfinished >= QUIT_PATIENCE {
            cycle.send_end();
            return Err(if cycle.write_failed() {
                ServerError::still_in_force(cycle.in_force())
            } else {
                ServerError::StopNotStored
            });
        }
    }
}

/// Receives the owner's frames on arrival, which measures the round trip; the tick itself waits for
/// the clock.
fn watch_owner<const N: usize, const M: usize, P: Plant<N, M>>(
    cycle: &mut Cycle<N, M, P>,
    deadline_ns: u64,
    state_left_ns: u64,
) {
    let mut frames = 0;
    while frames < ENOUGH_FRAMES {
        let Some(socket) = cycle.owner_socket() else {
            return;
        };
        if !wait_readable_until_ns(socket, deadline_ns) {
            return;
        }
        let seen = cycle.receive_owner();
        if seen <= frames {
            // A part of a frame, a closed stream or another peer's datagram: left for the deadline.
            return;
        }
        frames = seen;
        note_round_trip(cycle, state_left_ns);
    }
}

/// Waits until the owner of a running session has answered the last State or has ended the session,
/// its connection is known to be silent, or the silence has lasted long enough to be a miss.
fn wait_for_answer<const N: usize, const M: usize, P: Plant<N, M>>(
    cycle: &mut Cycle<N, M, P>,
    controls: &Controls,
    state_left_ns: u64,
) {
    let silence_ns = match cycle.phase() {
        Phase::Submit | Phase::Obtain => SILENCE_NS,
        Phase::Handshake => HANDSHAKE_SILENCE_NS,
        Phase::Listening | Phase::SafeDisconnect | Phase::Fault => {
            return sleep_until_ns(state_left_ns.saturating_add(PERIOD_NS));
        }
    };
    let give_up_ns = state_left_ns.saturating_add(silence_ns);
    loop {
        cycle.receive();
        if cycle.owner_has_answered() {
            return note_round_trip(cycle, state_left_ns);
        }
        let waived = controls.is_urgent() || controls.link_silent.load(Ordering::Relaxed);
        let now = now_ns();
        if waived || now >= give_up_ns {
            return;
        }
        let poll = give_up_ns.min(now.saturating_add(POLL_NS));
        match cycle.owner_socket() {
            Some(socket) => {
                let _readable = wait_readable_until_ns(socket, poll);
            }
            None => return,
        }
    }
}

fn note_round_trip<const N: usize, const M: usize, P: Plant<N, M>>(
    cycle: &mut Cycle<N, M, P>,
    state_left_ns: u64,
) {
    let passed_us = now_ns().saturating_sub(state_left_ns) / 1_000;
    cycle.note_round_trip(u32::try_from(passed_us).unwrap_or(u32::MAX));
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use gantry_tau_core::{
        Actual, AxisConfig, Config, EpochRange, InForce, LimitValues, Limits, MotorMap, Parameters,
        PositionNm, Reference, Travel,
    };

    use super::*;
    use crate::plant::{PlantError, Reading};
    use crate::realtime::MAX_SHIFT_NS;
    use crate::server::Server;
    use crate::state::StopLatch;

    /// Elapsed cycles and time of every `read`.
    type Reads = Arc<Mutex<Vec<(u64, u64)>>>;

    /// A machine on a bus with a clock that is slower than this computer's.
    struct Steered {
        in_force: [InForce; 1],
        first_ns: u64,
        reads: Reads,
    }

    impl Plant<1, 1> for Steered {
        type Error = PlantError;

        fn first_deadline_ns(&mut self) -> Option<u64> {
            // That of the start is of no cycle.
            self.reads.lock().unwrap().clear();
            Some(self.first_ns)
        }

        fn deadline_shift_ns(&mut self) -> i64 {
            // More than is granted.
            10 * MAX_SHIFT_NS
        }

        fn in_force(&mut self) -> Result<[InForce; 1], PlantError> {
            Ok(self.in_force)
        }

        fn read(&mut self, elapsed: u64) -> Result<Reading<1>, PlantError> {
            self.reads.lock().unwrap().push((elapsed, now_ns()));
            Ok(Reading::of_axes([PositionNm(0)], [Actual::ZERO]))
        }

        fn write(&mut self, _: &[Reference; 1], parts: &[InForce; 1]) -> Result<(), PlantError> {
            self.in_force = *parts;
            Ok(())
        }
    }

    /// No cycle begins before the time that the machine's shifts give it. (One that ignores them
    /// begins 1 us earlier from cycle to cycle; how late a cycle is does not matter.)
    #[test]
    fn cycles_begin_where_the_machine_wants_them() {
        let values = LimitValues {
            max: 2_000_000,
            step: 5_000,
            accel: 10_000,
            ramp: 100,
        };
        let limits = Limits::new(values).unwrap();
        let axis = AxisConfig::position_only(limits, Travel::around_zero(1_000_000_000), 2_000_000);
        let reads = Reads::default();
        let machine = Steered {
            in_force: [InForce::at(PositionNm(0))],
            first_ns: now_ns() + 50_000_000,
            reads: Arc::clone(&reads),
        };
        let first_ns = machine.first_ns;
        let cycle = Cycle::new(
            Config::new(Parameters::thesis([axis])).unwrap(),
            MotorMap::new([0]).unwrap(),
            machine,
            EpochRange::VOLATILE,
            StopLatch::volatile(),
            std::net::SocketAddr::from(([127, 0, 0, 1], 0)),
        )
        .unwrap();
        let (server, _records) = Server::spawn(cycle, TickSource::RealTime).unwrap();
        while reads.lock().unwrap().len() < 400 {
            std::thread::yield_now();
        }
        server.quit().unwrap();
        let mut cycles = 0;
        for (number, &(elapsed, at_ns)) in (0_u64..).zip(reads.lock().unwrap().iter()) {
            cycles += elapsed;
            let begin_ns = first_ns + (cycles - 1) * PERIOD_NS + number * 1_000;
            assert!(
                at_ns >= begin_ns,
                "cycle {number}: {} ns early",
                begin_ns - at_ns
            );
        }
    }
}
