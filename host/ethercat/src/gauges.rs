//! Length gauges on terminals that count edges `[T 4.2.6, 4.2.7]`: a bus of their own, read once per
//! cycle.

mod bring_up;
mod error;
mod terminal;

use std::panic::{AssertUnwindSafe, catch_unwind};

use ethercrab::subdevice_group::Op;
use ethercrab::{AlStatusCode, Command, MainDevice, RegisterAddress, TxRxResponse};

use crate::discovery::{DevicePlace, ERROR, Group, MAX_SUBDEVICES, al_status, code_of};
use crate::main_device::main_device;
use crate::pump::Pump;
use crate::wire::Wire;

use bring_up::{Ready, bring_up};
pub use error::{GaugeRefusal, GaugesError, NoCount};
use terminal::Counter;
pub use terminal::CounterMap;

/// Time for a bring-up, s, and cycles from SAFE-OP to OP.
const BRING_UP_S: u32 = 60;
const OPERATIONAL_CYCLES: u32 = 3_000;
/// Share of a terminal in the working counter: 1 for its inputs, 2 for its outputs.
const COUNTS_PER_TERMINAL: u16 = 3;
/// States of AL status and AL control, and the acknowledgement of an error.
const INIT: u16 = 0x01;
const SAFE_OPERATIONAL: u8 = 4;
const OPERATIONAL: u8 = 8;
const ACKNOWLEDGE_IN_SAFE_OP: u16 = 0x14;

/// Expectations of one gauge's terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GaugeConfig {
    /// Place.
    pub place: DevicePlace,
    /// Vendor.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
}

impl GaugeConfig {
    /// Vendor of the terminals whose maps are known here.
    pub const BECKHOFF: u32 = 0x0000_0002;
}

/// A terminal that was brought up.
#[derive(Clone, Copy, Debug)]
struct Terminal {
    /// Index in the group.
    index: usize,
    station: u16,
    counter: Counter,
    /// State of the last answer; 0 of a terminal that gave none.
    state: u8,
}

/// Gauges of a bus, in OP.
///
/// One [`cycle`](Self::cycle) sends one frame and waits for its answer; it neither allocates nor
/// locks. Outputs are zero always: no terminal latches, sets or resets its counter.
pub struct Gauges<W: Wire> {
    pump: Pump<W>,
    main: &'static MainDevice<'static>,
    group: Group<Op>,
    terminals: Vec<Terminal>,
    /// Terminal that is led back to OP next.
    led: usize,
    answer_us: u32,
}

impl<W: Wire> Gauges<W> {
    /// Brings the terminals of these gauges to OP, and leaves all other devices in PRE-OP. Blocks
    /// for some seconds. `answer_us` is the longest wait for the answer of a cycle, µs. Memory of
    /// about 20 KiB per call is kept to the end of the process.
    ///
    /// # Errors
    /// [`GaugesError`], with the gauge that it concerns.
    pub fn bring_up(
        wire: W,
        gauges: &[GaugeConfig],
        cycle_us: u32,
        answer_us: u32,
    ) -> Result<Self, GaugesError> {
        // Longer than a cycle waits, so that none sends twice.
        let patience_us = answer_us.saturating_add(200);
        let Some((mut pump, main)) = main_device(wire, patience_us) else {
            return Err(GaugesError::Unhandled);
        };
        let limit_us = u64::from(BRING_UP_S) * 1_000_000;
        // ethercrab asserts that no emergency message stands between a request and its answer.
        let outcome = catch_unwind(AssertUnwindSafe(|| {
            pump.run(bring_up(main, gauges), limit_us)
        }));
        let outcome = outcome.map_err(|_| GaugesError::Unhandled)?;
        let Ready { group, terminals } = outcome.ok_or(GaugesError::Overdue {
            seconds: BRING_UP_S,
        })??;
        let mut gauges = Self {
            pump,
            main,
            group,
            terminals,
            led: 0,
            answer_us,
        };
        gauges.come_into_operation(cycle_us)?;
        Ok(gauges)
    }

    /// Exchanges process data until all terminals are in OP.
    fn come_into_operation(&mut self, cycle_us: u32) -> Result<(), GaugesError> {
        for _ in 0..OPERATIONAL_CYCLES {
            let next_us = self.pump.wire.now_us().saturating_add(cycle_us.into());
            self.pump.rest_until(next_us, cycle_us.into());
            self.cycle();
            if self.terminals.iter().all(|one| one.state == OPERATIONAL) {
                // Counts begin now.
                return Ok(());
            }
        }
        let mut waits = self.terminals.iter().enumerate();
        let waiting = waits.find(|(_, terminal)| terminal.state != OPERATIONAL);
        let Some((gauge, station)) = waiting.map(|(gauge, terminal)| (gauge, terminal.station))
        else {
            return Ok(());
        };
        let limit_us = u64::from(self.answer_us) * 4;
        let status = self.pump.run(al_status(self.main, station), limit_us);
        let (status, code) = status.flatten().unwrap_or((0, 0));
        let reason = GaugeRefusal::NotOperational {
            state: (status & 0x0F) as u8,
            code: AlStatusCode::from(code),
        };
        Err(GaugesError::Gauge { gauge, reason })
    }

    /// Reads all gauges once.
    pub fn cycle(&mut self) {
        let limit_us = u64::from(self.answer_us);
        let answer = self.pump.run(self.group.tx_rx(self.main), limit_us);
        match answer {
            Some(Ok(answer)) => self.apply(&answer),
            _ => self.terminals.iter_mut().for_each(|terminal| {
                terminal.state = 0;
                terminal.counter.miss(NoCount::NoAnswer);
            }),
        }
        self.lead();
    }

    fn apply<T>(&mut self, answer: &TxRxResponse<MAX_SUBDEVICES, T>) {
        for terminal in &mut self.terminals {
            let state = answer.subdevice_states.get(terminal.index);
            terminal.state = state.map_or(0, |state| code_of(*state));
        }
        // Those that do not answer take no part, and all others do: else it is not known whose
        // inputs are old.
        let present = (self.terminals.iter())
            .filter(|terminal| matches!(terminal.state, SAFE_OPERATIONAL | OPERATIONAL))
            .count();
        let expected = COUNTS_PER_TERMINAL.saturating_mul(present as u16);
        let is_whole = answer.working_counter == expected;
        for terminal in &mut self.terminals {
            if terminal.state != OPERATIONAL {
                let state = terminal.state;
                terminal.counter.miss(NoCount::State { state });
                continue;
            }
            match self.group.subdevice(self.main, terminal.index) {
                Ok(subdevice) if is_whole => terminal.counter.take(&subdevice.inputs_raw()),
                _ => terminal.counter.miss(NoCount::WorkingCounter),
            }
        }
    }

    /// Leads a terminal in SAFE-OP back to OP, one per cycle: one whose frames did not come for the
    /// time of its watchdog keeps its counter. One that was restarted has no station address, and
    /// does not answer.
    fn lead(&mut self) {
        let count = self.terminals.len();
        let next = (0..count)
            .map(|step| (self.led + step) % count.max(1))
            .find(|at| {
                let terminal = self.terminals.get(*at);
                terminal.is_some_and(|terminal| terminal.state == SAFE_OPERATIONAL)
            });
        let Some(terminal) = next.and_then(|at| self.terminals.get(at)) else {
            return;
        };
        let (main, station) = (self.main, terminal.station);
        self.led = next.map_or(0, |at| at + 1);
        let limit_us = u64::from(self.answer_us);
        let Some(Some((status, _))) = self.pump.run(al_status(main, station), limit_us) else {
            return;
        };
        let request = if status & ERROR != 0 {
            ACKNOWLEDGE_IN_SAFE_OP
        } else {
            OPERATIONAL.into()
        };
        let write = Command::fpwr(station, RegisterAddress::AlControl.into()).send(main, request);
        let _sent = self.pump.run(write, limit_us);
    }

    /// Returns the counts of the last cycle, from the first count of each gauge on.
    pub fn counts(&self) -> impl ExactSizeIterator<Item = Result<i64, NoCount>> {
        (self.terminals.iter()).map(|terminal| terminal.counter.count())
    }

    /// Returns what each terminal's inputs hold.
    pub fn maps(&self) -> impl ExactSizeIterator<Item = CounterMap> {
        (self.terminals.iter()).map(|terminal| terminal.counter.map())
    }

    /// Returns the wire.
    pub const fn wire_mut(&mut self) -> &mut W {
        &mut self.pump.wire
    }
}

impl<W: Wire> Drop for Gauges<W> {
    fn drop(&mut self) {
        let init = Command::bwr(RegisterAddress::AlControl.into())
            .ignore_wkc()
            .send(self.main, INIT);
        let _sent = self.pump.run(init, u64::from(self.answer_us));
    }
}

impl<W: Wire> std::fmt::Debug for Gauges<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Gauges")
            .field("terminals", &self.terminals)
            .finish_non_exhaustive()
    }
}
