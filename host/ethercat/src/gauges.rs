//! Length gauges on terminals that count edges `[T 4.2.6, 4.2.7]`: a bus of their own, read once per
//! cycle.

use std::panic::{AssertUnwindSafe, catch_unwind};

use ethercrab::{Command, MainDevice, RegisterAddress};

use crate::discovery::{BusError, Found, Role, discover};
use crate::instruments::encoder::Counter;
use crate::instruments::encoder::{CounterMap, GaugeConfig};
use crate::instruments::{GroupError, Instruments, MailboxSetup, Member, find};
use crate::instruments::{InstrumentRefusal, NoReading};
use crate::main_device::main_device;
use crate::pump::Pump;
use crate::wire::Wire;

/// Time for a bring-up, s.
const BRING_UP_S: u32 = 60;
/// AL control: the request of INIT.
const INIT: u16 = 0x01;

/// Error of a bring-up of gauges.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GaugesError {
    /// The bus as a whole failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// A terminal cannot be used.
    #[error("{reason}")]
    Gauge {
        /// Index of its gauge.
        gauge: usize,
        /// The reason.
        reason: InstrumentRefusal,
    },
}

impl From<GroupError> for GaugesError {
    fn from(error: GroupError) -> Self {
        match error {
            GroupError::Member(gauge, reason) => Self::Gauge { gauge, reason },
            GroupError::Bus(error) => Self::Bus(error),
        }
    }
}

/// Gauges of a bus, in OP.
///
/// One [`cycle`](Self::cycle) sends one frame and waits for its answer; it neither allocates nor
/// locks. Outputs are zero always: no terminal latches, sets or resets its counter.
#[derive(Debug)]
pub struct Gauges<W: Wire> {
    pump: Pump<W>,
    main: &'static MainDevice<'static>,
    terminals: Instruments<Counter>,
    answer_us: u64,
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
            return Err(BusError::Unhandled.into());
        };
        let limit_us = u64::from(BRING_UP_S) * 1_000_000;
        // ethercrab asserts that no emergency message stands between a request and its answer.
        let outcome = catch_unwind(AssertUnwindSafe(|| {
            pump.run(bring_up(main, gauges), limit_us)
        }));
        let outcome = outcome.map_err(|_| BusError::Unhandled)?;
        let mut terminals = outcome.ok_or(BusError::Overdue {
            seconds: BRING_UP_S,
        })??;
        let times_us = [cycle_us, answer_us].map(u64::from);
        terminals.come_into_operation(&mut pump, main, times_us)?;
        Ok(Self {
            pump,
            main,
            terminals,
            answer_us: answer_us.into(),
        })
    }

    /// Reads all gauges once.
    pub fn cycle(&mut self) {
        self.terminals
            .cycle(&mut self.pump, self.main, self.answer_us);
    }

    /// Returns the counts of the last cycle, from the first count of each gauge on.
    pub fn counts(&self) -> impl ExactSizeIterator<Item = Result<i64, NoReading>> {
        self.terminals.each().map(Counter::count)
    }

    /// Returns what each terminal's inputs hold.
    pub fn maps(&self) -> impl ExactSizeIterator<Item = CounterMap> {
        self.terminals.each().map(Counter::map)
    }

    /// Returns the wire.
    pub const fn wire_mut(&mut self) -> &mut W {
        &mut self.pump.wire
    }
}

/// Takes the terminals to SAFE-OP, and asks for OP.
async fn bring_up(
    main: &'static MainDevice<'static>,
    gauges: &[GaugeConfig],
) -> Result<Instruments<Counter>, GaugesError> {
    let places = gauges.iter().map(|gauge| gauge.place);
    let role = |here: &Found| {
        if places.clone().any(|place| here.is_at(place)) {
            Role::Instrument
        } else {
            Role::Other
        }
    };
    let (groups, found) = discover(main, || 0, role).await?;
    let mut members = Vec::new();
    for (gauge, config) in gauges.iter().enumerate() {
        let refused = |reason| GaugesError::Gauge { gauge, reason };
        let at = find(&found, &config.identity(), places.clone()).map_err(refused)?;
        let subdevice = groups.instruments.subdevice(main, at.1);
        let subdevice = subdevice.map_err(|error| {
            let step = "looking for the terminal";
            refused(InstrumentRefusal::Exchange { step, error })
        })?;
        let counter = Counter::prepare(&MailboxSetup(&subdevice))
            .await
            .map_err(refused)?;
        members.push(Member::new(at, counter));
    }
    Ok(Instruments::start(main, groups.instruments, members).await?)
}

impl<W: Wire> Drop for Gauges<W> {
    fn drop(&mut self) {
        let init = Command::bwr(RegisterAddress::AlControl.into())
            .ignore_wkc()
            .send(self.main, INIT);
        let _sent = self.pump.run(init, self.answer_us);
    }
}
