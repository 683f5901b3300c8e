//! What the link says about itself: one line of `name=value` words per event, and a summary at the end.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::endpoint::Turn;
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::units::{OffsetNm, TorquePermille, VelocityUmS};

use super::audit::{Audit, Broken};
use crate::board::stack;
use crate::machine::{AXES, MOTORS};

/// No offsets.
const NOTHING: [Offsets; AXES] = [Offsets {
    position: OffsetNm(0),
    velocity: VelocityUmS(0),
    torque: TorquePermille(0),
}; AXES];

/// What has happened so far.
pub(super) struct Journal {
    /// Sessions to serve.
    sessions: u32,
    /// Sessions whose offsets are back at zero.
    ended: u32,
    phase: Phase,
    /// Ticks served.
    ticks: u64,
    /// Ticks of each session in Submit and in Obtain.
    submit_ticks: u32,
    obtain_ticks: u32,
    /// Offsets after the tick before.
    offsets: [Offsets; AXES],
    /// Position offsets from which the ramp began, nm.
    ramp_from_nm: [i32; AXES],
    /// Ticks in which the ramp moved something.
    ramp_ticks: u32,
    refused: u32,
}

impl Journal {
    pub(super) const fn new(sessions: u32) -> Self {
        Self {
            sessions,
            ended: 0,
            phase: Phase::Listening,
            ticks: 0,
            submit_ticks: 0,
            obtain_ticks: 0,
            offsets: NOTHING,
            ramp_from_nm: [0; AXES],
            ramp_ticks: 0,
            refused: 0,
        }
    }

    /// The machine is at home and may be connected to.
    pub(super) fn listening(&self, port: u16, turn: &Turn<AXES, MOTORS>) {
        let tick = turn.output.state.tick.0;
        defmt::info!("link listening={=u16} tick={=u64}", port, tick);
    }

    /// Whether as many sessions as asked for have ended.
    pub(super) const fn is_complete(&self) -> bool {
        self.ended >= self.sessions
    }

    /// One tick.
    pub(super) fn note(&mut self, turn: &Turn<AXES, MOTORS>, checked: Result<(), Broken>) {
        let state = &turn.output.state;
        let tick = state.tick.0;
        self.ticks = self.ticks.saturating_add(1);
        if let Err(broken) = checked {
            defmt::error!("link tick={=u64} broken={}", tick, broken);
        }
        for (_, refusal) in &turn.output.refusals {
            self.refused = self.refused.saturating_add(1);
            defmt::info!("link tick={=u64} refused={}", tick, refusal);
        }
        self.count(turn);
        if state.phase != self.phase {
            defmt::info!(
                "link tick={=u64} phase={} cause={}",
                tick,
                state.phase,
                state.cause
            );
            if state.phase == Phase::Listening {
                self.end_session(turn);
            }
            self.phase = state.phase;
        }
    }

    fn count(&mut self, turn: &Turn<AXES, MOTORS>) {
        let state = &turn.output.state;
        let offsets = state.axes.map(|axis| axis.offsets);
        if turn.output.welcome.is_some() {
            (self.submit_ticks, self.obtain_ticks, self.ramp_ticks) = (0, 0, 0);
        }
        if turn.output.ended.is_some() {
            self.ramp_from_nm = self.offsets.map(|offsets| offsets.position.0);
        }
        let moved = offsets != self.offsets;
        self.offsets = offsets;
        let counted = match state.phase {
            Phase::Submit => &mut self.submit_ticks,
            Phase::Obtain => &mut self.obtain_ticks,
            Phase::SafeDisconnect if moved => &mut self.ramp_ticks,
            _ => return,
        };
        *counted = counted.saturating_add(1);
    }

    /// The offsets of a session are back at zero.
    fn end_session(&mut self, turn: &Turn<AXES, MOTORS>) {
        self.ended = self.ended.saturating_add(1);
        let state = &turn.output.state;
        defmt::info!(
            "link session={=u64} cause={} submit_ticks={=u32} obtain_ticks={=u32} ramp_ticks={=u32} ramp_from_nm={}",
            state.epoch.0,
            state.cause,
            self.submit_ticks,
            self.obtain_ticks,
            self.ramp_ticks,
            self.ramp_from_nm
        );
        let counters = &state.counters;
        defmt::info!(
            "link counters={=u64} received={=u32} missed={=u32} late={=u32} duplicate={=u32} stale={=u32} malformed={=u32} out_of_range={=u32} clamped={=u32} strangers={=u32} longest_miss_run={=u16}",
            state.epoch.0,
            counters.received,
            counters.missed,
            counters.late,
            counters.duplicate,
            counters.stale,
            counters.malformed,
            counters.out_of_range,
            counters.clamped,
            counters.strangers,
            counters.longest_miss_run
        );
    }

    /// The end of the run.
    pub(super) fn close(&self, now_ms: u32, audit: &Audit) {
        defmt::info!(
            "link ticks={=u64} ms={=u32} sessions={=u32} refused={=u32} broken_ticks={=u32}",
            self.ticks,
            now_ms,
            self.ended,
            self.refused,
            audit.broken_ticks
        );
        defmt::info!("link stack_bytes={=usize}", stack::high_water());
        defmt::info!("link largest_offset_nm={}", audit.largest_offset_nm);
        defmt::info!("link largest_reference_nm={}", audit.largest_reference_nm);
    }
}
