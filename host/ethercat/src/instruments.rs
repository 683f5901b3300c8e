//! Instruments of a bus: devices that measure, and move nothing. They have a group and a frame of
//! their own, and what they do is never a fault of the drives.

pub(crate) mod beside_drives;
pub(crate) mod encoder;
pub(crate) mod force;
mod refusal;
mod setup;

use ethercrab::subdevice_group::{Op, PreOp};
use ethercrab::{AlStatusCode, Command, MainDevice, RegisterAddress, TxRxResponse};

use crate::discovery::{
    BusError, DevicePlace, ERROR, Found, Group, MAX_SUBDEVICES, Unplaced, al_status, code_of,
    first_refusal, locate,
};
use crate::pump::Pump;
use crate::wire::Wire;

pub use refusal::{InstrumentRefusal, NoReading};
pub(crate) use setup::MailboxSetup;

/// Cycles from SAFE-OP to OP at most.
const OPERATIONAL_CYCLES: u32 = 3_000;
/// Share of an instrument in the working counter: 1 for its inputs, 2 for its outputs.
const COUNTS_PER_INSTRUMENT: u16 = 3;
/// States of AL status and AL control, and the acknowledgement of an error.
const SAFE_OPERATIONAL: u8 = 4;
const OPERATIONAL: u8 = 8;
const ACKNOWLEDGE_IN_SAFE_OP: u16 = 0x14;

/// State of one instrument between cycles.
pub(crate) trait Instrument {
    /// Returns the outputs of every cycle; zeros stand behind them.
    fn outputs(&self) -> &[u8] {
        &[]
    }

    /// Takes the inputs of a cycle.
    fn take(&mut self, inputs: &[u8]);

    /// Takes note of a cycle without inputs.
    fn miss(&mut self, reason: NoReading);
}

/// Identity of an instrument at its place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Identity {
    pub(crate) place: DevicePlace,
    pub(crate) vendor: u32,
    pub(crate) product: u32,
}

/// Finds the device of an instrument, and compares its identity. Returns its station address and
/// its index in the group of all of them.
pub(crate) fn find(
    found: &[Found],
    wanted: &Identity,
    places: impl Iterator<Item = DevicePlace> + Clone,
) -> Result<(u16, usize), InstrumentRefusal> {
    let &Identity {
        place,
        vendor,
        product,
    } = wanted;
    let (device, index) = locate(found, place, places).map_err(|reason| match reason {
        Unplaced::Missing => InstrumentRefusal::Missing {
            place,
            found: found.len(),
        },
        Unplaced::Ambiguous => InstrumentRefusal::Ambiguous { place },
    })?;
    if (device.vendor, device.product) != (vendor, product) {
        return Err(InstrumentRefusal::Identity {
            place,
            vendor,
            product,
            found_vendor: device.vendor,
            found_product: device.product,
        });
    }
    Ok((device.station, index))
}

/// An instrument of a group.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Member<I> {
    /// Index in the group.
    pub(crate) index: usize,
    /// Configured station address.
    pub(crate) station: u16,
    pub(crate) instrument: I,
    /// State of the last answer; 0 of one that gave none.
    state: u8,
}

impl<I> Member<I> {
    pub(crate) const fn new((station, index): (u16, usize), instrument: I) -> Self {
        Self {
            index,
            station,
            instrument,
            state: 0,
        }
    }
}

/// Error of a group of instruments on its way to SAFE-OP or OP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum GroupError {
    /// One of them refuses; its place among the members.
    Member(usize, InstrumentRefusal),
    /// The bus as a whole failed.
    Bus(BusError),
}

/// Instruments of one kind, each in OP or led there.
pub(crate) struct Instruments<I> {
    group: Group<Op>,
    members: Vec<Member<I>>,
    /// Member that is led back to OP next.
    led: usize,
}

impl<I: Instrument> Instruments<I> {
    /// Takes instruments that are set up to SAFE-OP, and asks for OP.
    pub(crate) async fn start(
        main: &'static MainDevice<'static>,
        group: Group<PreOp>,
        members: Vec<Member<I>>,
    ) -> Result<Self, GroupError> {
        let bus = |step| move |error| GroupError::Bus(BusError::of(step)(error));
        let group = group.into_pre_op_pdi(main).await;
        let group = group.map_err(bus("mapping the process data of instruments"))?;
        for member in &members {
            if let Ok(subdevice) = group.subdevice(main, member.index) {
                let mut image = subdevice.outputs_raw_mut();
                for (place, byte) in image.iter_mut().zip(member.instrument.outputs()) {
                    *place = *byte;
                }
            }
        }
        let group = match group.into_safe_op(main).await {
            Ok(group) => group,
            Err(error) => {
                let stations = members.iter().map(|member| member.station);
                let refused = first_refusal(main, stations).await;
                return Err(refused.map_or(
                    bus("SAFE-OP of instruments")(error),
                    |(member, state, code)| {
                        let reason = InstrumentRefusal::NotOperational { state, code };
                        GroupError::Member(member, reason)
                    },
                ));
            }
        };
        // Outputs that are valid before OP is asked for.
        let first = group.tx_rx(main).await;
        first.map_err(bus("the first exchange with instruments"))?;
        let group = group.request_into_op(main).await;
        Ok(Self {
            group: group.map_err(bus("OP of instruments"))?,
            members,
            led: 0,
        })
    }

    /// Exchanges process data until all of them are in OP.
    pub(crate) fn come_into_operation<W: Wire>(
        &mut self,
        pump: &mut Pump<W>,
        main: &'static MainDevice<'static>,
        [cycle_us, answer_us]: [u64; 2],
    ) -> Result<(), GroupError> {
        for _ in 0..OPERATIONAL_CYCLES {
            let next_us = pump.wire.now_us().saturating_add(cycle_us);
            pump.rest_until(next_us, cycle_us);
            self.cycle(pump, main, answer_us);
            if self
                .members
                .iter()
                .all(|member| member.state == OPERATIONAL)
            {
                // What was read now is old when the first cycle comes.
                self.miss(NoReading::NoAnswer);
                return Ok(());
            }
        }
        let mut members = self.members.iter().enumerate();
        let Some((index, member)) = members.find(|(_, member)| member.state != OPERATIONAL) else {
            return Ok(());
        };
        let status = pump.run(al_status(main, member.station), answer_us.saturating_mul(4));
        let (status, code) = status.flatten().unwrap_or((0, 0));
        let reason = InstrumentRefusal::NotOperational {
            state: (status & 0x0F) as u8,
            code: AlStatusCode::from(code),
        };
        Err(GroupError::Member(index, reason))
    }

    /// Reads all of them once, within `limit_us`.
    pub(crate) fn cycle<W: Wire>(
        &mut self,
        pump: &mut Pump<W>,
        main: &'static MainDevice<'static>,
        limit_us: u64,
    ) {
        let end_us = pump.wire.now_us().saturating_add(limit_us);
        match pump.run(self.group.tx_rx(main), limit_us) {
            Some(Ok(answer)) => self.apply(main, &answer),
            _ => self.miss(NoReading::NoAnswer),
        }
        self.lead(pump, main, end_us);
    }

    /// Takes note of a cycle without a reading of any.
    pub(crate) fn miss(&mut self, reason: NoReading) {
        for member in &mut self.members {
            member.state = 0;
            member.instrument.miss(reason);
        }
    }

    fn apply<T>(
        &mut self,
        main: &'static MainDevice<'static>,
        answer: &TxRxResponse<MAX_SUBDEVICES, T>,
    ) {
        for member in &mut self.members {
            let state = answer.subdevice_states.get(member.index);
            member.state = state.map_or(0, |state| code_of(*state));
        }
        // Those that do not answer take no part, and all others do: else it is not known whose
        // inputs are old.
        let present = (self.members.iter())
            .filter(|member| matches!(member.state, SAFE_OPERATIONAL | OPERATIONAL))
            .count();
        let expected = COUNTS_PER_INSTRUMENT.saturating_mul(present as u16);
        let is_whole = answer.working_counter == expected;
        for member in &mut self.members {
            if member.state != OPERATIONAL {
                let state = member.state;
                member.instrument.miss(NoReading::State { state });
                continue;
            }
            match self.group.subdevice(main, member.index) {
                Ok(subdevice) if is_whole => member.instrument.take(&subdevice.inputs_raw()),
                _ => member.instrument.miss(NoReading::WorkingCounter),
            }
        }
    }

    /// Leads one in SAFE-OP back to OP, one per cycle: one whose frames did not come for the time
    /// of its watchdog. One that was restarted has no station address, and does not answer. What has
    /// no answer by `end_us` comes again in the next cycle.
    fn lead<W: Wire>(
        &mut self,
        pump: &mut Pump<W>,
        main: &'static MainDevice<'static>,
        end_us: u64,
    ) {
        let count = self.members.len().max(1);
        let mut next = (0..count).map(|step| (self.led + step) % count);
        let is_waiting = |at: &usize| {
            let member = self.members.get(*at);
            member.is_some_and(|member| member.state == SAFE_OPERATIONAL)
        };
        let Some(at) = next.find(is_waiting) else {
            return;
        };
        let Some(station) = self.members.get(at).map(|member| member.station) else {
            return;
        };
        self.led = at + 1;
        let left_us = end_us.saturating_sub(pump.wire.now_us());
        let Some(Some((status, _))) = pump.run(al_status(main, station), left_us) else {
            return;
        };
        let request = if status & ERROR != 0 {
            ACKNOWLEDGE_IN_SAFE_OP
        } else {
            OPERATIONAL.into()
        };
        let write = Command::fpwr(station, RegisterAddress::AlControl.into()).send(main, request);
        let left_us = end_us.saturating_sub(pump.wire.now_us());
        let _sent = pump.run(write, left_us);
    }

    /// Returns the instruments.
    pub(crate) fn each(&self) -> impl ExactSizeIterator<Item = &I> {
        self.members.iter().map(|member| &member.instrument)
    }
}

impl<I: std::fmt::Debug> std::fmt::Debug for Instruments<I> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Instruments")
            .field("members", &self.members)
            .finish_non_exhaustive()
    }
}
