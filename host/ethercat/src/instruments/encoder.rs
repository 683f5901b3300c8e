//! A terminal that counts the edges of a gauge: its map, and the count since the start.
//!
//! Maps of EL5101, EL5101-0010 and EL5151 `[infosys el5101 10715105803, 10718449291; el515x
//! 1567650827]`: a status, the counter, a latch that is never used.

use super::{Identity, Instrument, InstrumentRefusal, MailboxSetup, NoReading};
use crate::discovery::DevicePlace;

/// Bits of a status of 16 bits: an open circuit, a synchronisation error, invalid inputs, and the
/// one that changes with each new value.
const OPEN_CIRCUIT: u16 = 1 << 6;
const SYNC_ERROR: u16 = 1 << 13;
const INVALID: u16 = 1 << 14;
const TOGGLE: u16 = 1 << 15;
/// Cycles with the same toggle bit after which a terminal counts as frozen.
const FROZEN_CYCLES: u32 = 3;
/// Cycles without a count after which a counter of 16 bits has lost its turns: half of them are
/// 16 mm at 0.5 µm, which no plunger goes in a tenth of a second by itself.
const MAX_GAP: u32 = 100;

/// PDO assignments of outputs and inputs.
const OUTPUTS: u16 = 0x1C12;
const INPUTS: u16 = 0x1C13;
/// PDOs of outputs and inputs, the best first: a counter of 32 bits of an EL5101, and the only ones
/// of an EL5101-0010 and an EL5151.
const PDOS: [[u16; 2]; 2] = [[0x1603, 0x1A04], [0x1600, 0x1A00]];
/// Objects by which the terminal's program runs: of its inputs, and of its outputs.
const SYNCHRONISATION: [u16; 2] = [0x1C33, 0x1C32];
/// From the object of a status to that of the settings; its sub-indices that switch the checks of
/// the wires on.
const TO_SETTINGS: u16 = 0x2000;
const WIRE_CHECKS: [u8; 2] = [0x0B, 0x0C];

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

    pub(crate) const fn identity(&self) -> Identity {
        Identity {
            place: self.place,
            vendor: self.vendor,
            product: self.product,
        }
    }
}

/// Inputs of a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CounterMap {
    /// Status of 16 bits, counter and latch of 32.
    Bits32,
    /// Status of 16 bits, counter and latch of 16.
    Bits16,
    /// Status of 8 bits, counter and latch of 16: old firmware. Its status says neither that a
    /// wire is open nor that a value is new, as far as it is documented.
    Old,
}

impl CounterMap {
    /// Returns the map of so many bits; `None` for another one.
    const fn of_bits(bits: u32) -> Option<Self> {
        match bits {
            80 => Some(Self::Bits32),
            48 => Some(Self::Bits16),
            40 => Some(Self::Old),
            _ => None,
        }
    }

    /// Returns status and counter of inputs, the counter sign-extended; `None` if they are too
    /// short.
    fn read(self, inputs: &[u8]) -> Option<(u16, i64)> {
        let status = match (self, inputs) {
            (Self::Old, _) => 0,
            (_, [low, high, ..]) => u16::from_le_bytes([*low, *high]),
            _ => return None,
        };
        let at = if self == Self::Old { 1 } else { 2 };
        let counter = match (self, inputs.get(at..)?) {
            (Self::Bits32, [a, b, c, d, ..]) => i32::from_le_bytes([*a, *b, *c, *d]).into(),
            (Self::Bits16 | Self::Old, [a, b, ..]) => i16::from_le_bytes([*a, *b]).into(),
            _ => return None,
        };
        Some((status, counter))
    }

    /// Returns the way from one counter to another, at most half of its turn.
    const fn way(self, from: i64, to: i64) -> i64 {
        let way = to.wrapping_sub(from);
        match self {
            Self::Bits32 => way as i32 as i64,
            Self::Bits16 | Self::Old => way as i16 as i64,
        }
    }
}

/// Count of a terminal since its first one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Counter {
    map: CounterMap,
    /// The toggle bit changes in each cycle.
    toggles: bool,
    /// Counter of the last count, and the way to it.
    last: Option<(i64, i64)>,
    toggle: Option<bool>,
    frozen_for: u32,
    without: u32,
    /// Count of this cycle.
    count: Result<i64, NoReading>,
}

impl Counter {
    /// A counter before its first cycle. `toggles` is false for a terminal that runs freely: its
    /// toggle bit may change twice between two frames.
    fn new(map: CounterMap, toggles: bool) -> Self {
        Self {
            map,
            toggles: toggles && map != CounterMap::Old,
            last: None,
            toggle: None,
            frozen_for: 0,
            without: 0,
            count: Err(NoReading::NoAnswer),
        }
    }

    /// Prepares a terminal in PRE-OP: chooses the widest counter that it has, and switches its wire
    /// checks on.
    pub(crate) async fn prepare(terminal: &MailboxSetup<'_>) -> Result<Self, InstrumentRefusal> {
        for [outputs, inputs] in PDOS {
            if terminal.object::<u8>(inputs, 0).await?.is_some() {
                terminal.assign(OUTPUTS, outputs).await?;
                terminal.assign(INPUTS, inputs).await?;
                break;
            }
        }
        let (status, bits) = terminal.assigned(INPUTS).await?;
        let expected = "a counter's are of 80, 48 or 40: status, counter and latch";
        let map = CounterMap::of_bits(bits).ok_or(InstrumentRefusal::Map { bits, expected })?;
        let settings = status.wrapping_add(TO_SETTINGS);
        for sub in WIRE_CHECKS {
            if map != CounterMap::Old && terminal.object::<u8>(settings, sub).await?.is_some() {
                terminal.write(settings, sub, 1_u8).await?;
            }
        }
        for object in SYNCHRONISATION {
            if let Some(kind) = terminal.object::<u16>(object, 1).await? {
                return Ok(Self::new(map, kind != 0));
            }
        }
        Ok(Self::new(map, true))
    }

    pub(crate) const fn map(&self) -> CounterMap {
        self.map
    }

    /// Count of the last cycle.
    pub(crate) const fn count(&self) -> Result<i64, NoReading> {
        self.count
    }

    /// True if a narrow counter may have turned meanwhile: what it counts from is not known any more.
    const fn has_lost_turns(&self) -> bool {
        let is_narrow = !matches!(self.map, CounterMap::Bits32);
        is_narrow && self.last.is_some() && self.without > MAX_GAP
    }
}

// No outputs but zeros: any bit of a control word would latch, set or reset the counter.
impl Instrument for Counter {
    fn take(&mut self, inputs: &[u8]) {
        let Some((status, counter)) = self.map.read(inputs) else {
            return self.miss(NoReading::WorkingCounter);
        };
        let toggle = status & TOGGLE != 0;
        let stands = self.toggles && self.toggle.replace(toggle) == Some(toggle);
        self.frozen_for = if stands {
            self.frozen_for.saturating_add(1)
        } else {
            0
        };
        let reasons = [
            (status & OPEN_CIRCUIT != 0, NoReading::OpenCircuit),
            (status & SYNC_ERROR != 0, NoReading::SyncError),
            (status & INVALID != 0, NoReading::Invalid),
            (self.frozen_for >= FROZEN_CYCLES, NoReading::Frozen),
            (self.has_lost_turns(), NoReading::LostTurns),
        ];
        if let Some((_, reason)) = reasons.into_iter().find(|(holds, _)| *holds) {
            return self.miss(reason);
        }
        let way = match self.last {
            None => 0,
            Some((before, way)) => way.saturating_add(self.map.way(before, counter)),
        };
        self.last = Some((counter, way));
        self.without = 0;
        self.count = Ok(way);
    }

    fn miss(&mut self, reason: NoReading) {
        self.without = self.without.saturating_add(1);
        self.count = Err(if self.has_lost_turns() {
            NoReading::LostTurns
        } else {
            reason
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wide(status: u16, counter: i32) -> Vec<u8> {
        let mut bytes = status.to_le_bytes().to_vec();
        bytes.extend(counter.to_le_bytes());
        bytes.extend([0; 4]);
        bytes
    }

    fn narrow(status: u16, counter: i16) -> Vec<u8> {
        let mut bytes = status.to_le_bytes().to_vec();
        bytes.extend(counter.to_le_bytes());
        bytes.extend([0; 2]);
        bytes
    }

    /// Counts of a sequence of inputs, each with a new toggle bit.
    fn counts(
        counter: &mut Counter,
        values: impl IntoIterator<Item = Vec<u8>>,
    ) -> Vec<Option<i64>> {
        let taken = (0_u16..).zip(values).map(|(cycle, mut bytes)| {
            if counter.map != CounterMap::Old {
                if let Some(high) = bytes.get_mut(1) {
                    *high |= ((cycle & 1) as u8) << 7;
                }
            }
            counter.take(&bytes);
            counter.count().ok()
        });
        taken.collect()
    }

    #[test]
    fn counts_begin_at_the_first_and_go_on_over_the_end_of_the_counter() {
        let mut counter = Counter::new(CounterMap::Bits32, true);
        let values = [i32::MAX - 1, i32::MAX, i32::MIN, i32::MIN + 5].map(|at| wide(0, at));
        assert_eq!(
            counts(&mut counter, values),
            [Some(0), Some(1), Some(2), Some(7)]
        );
        let mut counter = Counter::new(CounterMap::Bits16, true);
        let values = [-32_768, 32_767, 32_700, 0, -30_000, 10_000].map(|at| narrow(0, at));
        let expected = [0, -1, -68, -32_768, -62_768, -88_304].map(Some);
        assert_eq!(counts(&mut counter, values), expected);
    }

    #[test]
    fn old_maps_have_no_status_that_is_known() {
        let mut counter = Counter::new(CounterMap::Old, true);
        let values = [[0xFF, 7, 0, 0, 0], [0x00, 5, 0, 0, 0]].map(Vec::from);
        assert_eq!(counts(&mut counter, values), [Some(0), Some(-2)]);
    }

    #[test]
    fn each_bit_of_the_status_is_a_reason() {
        for (bit, reason) in [
            (OPEN_CIRCUIT, NoReading::OpenCircuit),
            (SYNC_ERROR, NoReading::SyncError),
            (INVALID, NoReading::Invalid),
        ] {
            let mut counter = Counter::new(CounterMap::Bits32, true);
            counter.take(&wide(0, 4));
            counter.take(&wide(bit | TOGGLE, 9));
            assert_eq!(counter.count(), Err(reason));
            // The way goes on from before.
            counter.take(&wide(0, 10));
            assert_eq!(counter.count(), Ok(6));
        }
        // Bits that say nothing about the counter: latches, set, overflow, inputs.
        let mut counter = Counter::new(CounterMap::Bits32, true);
        counter.take(&wide(!(OPEN_CIRCUIT | SYNC_ERROR | INVALID), 4));
        assert_eq!(counter.count(), Ok(0));
    }

    #[test]
    fn a_toggle_bit_that_stands_for_three_cycles_is_a_frozen_terminal() {
        let taken = |toggles| {
            let mut counter = Counter::new(CounterMap::Bits32, toggles);
            let counts = [0, 0, 0, 0, TOGGLE].map(|status| {
                counter.take(&wide(status, 1));
                counter.count()
            });
            counts.to_vec()
        };
        let frozen = [Ok(0), Ok(0), Ok(0), Err(NoReading::Frozen), Ok(0)];
        assert_eq!(taken(true), frozen);
        assert_eq!(taken(false), [Ok(0); 5], "it runs freely");
    }

    #[test]
    fn a_narrow_counter_loses_its_turns_in_a_gap() {
        for (map, gap, known) in [
            (CounterMap::Bits16, MAX_GAP, true),
            (CounterMap::Bits16, MAX_GAP + 1, false),
            (CounterMap::Bits32, 10 * MAX_GAP, true),
        ] {
            let bytes = if map == CounterMap::Bits32 {
                wide(0, 4)
            } else {
                narrow(0, 4)
            };
            let mut counter = Counter::new(map, false);
            for _ in 0..=2 * MAX_GAP {
                counter.miss(NoReading::NoAnswer);
            }
            counter.take(&bytes);
            assert_eq!(counter.count(), Ok(0), "before its first count it has none");
            (0..gap).for_each(|_| counter.miss(NoReading::NoAnswer));
            counter.take(&bytes);
            let expected = if known {
                Ok(0)
            } else {
                Err(NoReading::LostTurns)
            };
            assert_eq!(counter.count(), expected, "{map:?}, {gap}");
            counter.take(&bytes);
            assert_eq!(counter.count(), expected, "for good");
        }
    }

    #[test]
    fn inputs_that_are_too_short_are_none() {
        for map in [CounterMap::Bits32, CounterMap::Bits16, CounterMap::Old] {
            for length in 0..3 {
                let mut counter = Counter::new(map, true);
                counter.take(&vec![0; length]);
                assert_eq!(counter.count(), Err(NoReading::WorkingCounter));
            }
        }
    }
}
