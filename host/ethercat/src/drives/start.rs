//! From SAFE-OP to drives that follow their references.

use super::{Condition, Drives, Group};
use crate::cia402::{Input, Target};
use crate::fault::Fault;
use crate::instruments::NoReading;
use crate::steered_cycle::SteeredCycle;
use crate::wire::Wire;

/// Cycles for the cycle to come into phase with SYNC0.
const LOCK_CYCLES: u32 = 5_000;

impl<W: Wire, const M: usize> Drives<W, M> {
    /// Brings the drives to OP and enables them, at the references of `standing`, which gets their
    /// measurements. Blocks for some tenths of a second; the first [`cycle`](Self::cycle) must
    /// follow within the time of the watchdog. A drive in fault is left there: the condition is
    /// then [`Condition::Stopped`].
    pub fn start(&mut self, standing: impl FnMut(&[Input; M]) -> [Target; M]) {
        self.come_into_operation(standing);
        // What was read meanwhile is old when the first cycle comes.
        if let Some(instruments) = &mut self.instruments {
            instruments.miss(NoReading::NoAnswer);
        }
    }

    fn come_into_operation(&mut self, mut standing: impl FnMut(&[Input; M]) -> [Target; M]) {
        let first = standing(&self.inputs);
        // Outputs that are valid before OP is asked for.
        if let Err(fault) = self.exchange(&[0; M], &first) {
            self.condition = Condition::Stopped(fault);
            return;
        }
        if let Err(fault) = self.come_into_phase(&first) {
            self.condition = Condition::Stopped(fault);
            return;
        }
        if let Err(fault) = self.request_operational() {
            self.condition = Condition::Stopped(fault);
            return;
        }
        self.condition = Condition::Rearming { cycles: 0 };
        self.requested = [true; M];
        while matches!(self.condition, Condition::Rearming { .. }) {
            self.rest();
            let targets = standing(&self.inputs);
            let began_us = self.pump.wire.now_us();
            let _enabled = self.step_towards_operation(&targets, false);
            self.read_instruments(began_us);
            let fault = self.steer();
            if let (Some(fault), Condition::Rearming { .. }) = (fault, self.condition) {
                self.condition = Condition::Stopped(Fault::Clock(fault));
            }
        }
    }

    /// Waits for the next cycle, during a start or an end.
    pub(super) fn rest(&mut self) {
        let cycle_us = u64::from(self.settings.cycle_us);
        let wire = &mut self.pump.wire;
        let next_us = match &mut self.steered {
            None => wire.now_us().saturating_add(cycle_us),
            Some(steered) if wire.makes_cycles() => {
                wire.begin_cycles(1, cycle_us);
                return steered.begin_in_time(wire.now_ns());
            }
            Some(steered) => {
                let next_ns = steered.upcoming_ns(wire.now_ns());
                steered.begin_in_time(next_ns);
                next_ns.div_ceil(1_000)
            }
        };
        self.pump.rest_until(next_us, cycle_us);
    }

    /// Exchanges process data in SAFE-OP until the cycle is in phase with SYNC0.
    fn come_into_phase(&mut self, targets: &[Target; M]) -> Result<(), Fault> {
        let mut is_aligned = false;
        let mut exchanged = Ok(());
        for _ in 0..LOCK_CYCLES {
            if self.steered.is_none() {
                return Ok(());
            }
            self.rest();
            let began_us = self.pump.wire.now_us();
            // A lost frame is a sample less.
            exchanged = self.exchange(&[0; M], targets);
            self.read_instruments(began_us);
            // The first shift is a whole one: nothing follows SYNC0 yet.
            let steered = self.steered.as_mut().filter(|_| !is_aligned);
            if let Some(shift_ns) = steered.and_then(SteeredCycle::align) {
                self.pump.wire.shift_cycles(shift_ns);
                is_aligned = true;
            }
            match self.steer() {
                Some(fault) => return Err(Fault::Clock(fault)),
                None if self.is_locked() == Some(true) => return Ok(()),
                None => {}
            }
        }
        // Without an answer it is the bus that is at fault, and not the phase.
        exchanged.and(Err(Fault::NotInPhase))
    }

    fn request_operational(&mut self) -> Result<(), Fault> {
        let Group::SafeOp(group) = std::mem::replace(&mut self.group, Group::Lost) else {
            return Err(Fault::NotStarted);
        };
        // Each request is a frame of its own.
        let limit_us = u64::from(self.settings.answer_us) * (M as u64 + 1) * 4;
        match self.pump.run(group.request_into_op(self.main), limit_us) {
            Some(Ok(group)) => {
                self.group = Group::Op(group);
                Ok(())
            }
            _ => Err(Fault::NoAnswer),
        }
    }
}
