//! Distributed clock of a controller: local time with a drift, the control loop that follows the
//! reference, and the pulses of SYNC0; ETG1000.4.

use super::memory::Memory;

/// Registers of the clock.
pub(super) const REGISTERS: std::ops::Range<u16> = 0x0900..0x0A00;
const PORT_0: u16 = 0x0900;
const PORT_1: u16 = 0x0904;
const SYSTEM_TIME: u16 = 0x0910;
const RECEIVE_TIME: u16 = 0x0918;
const OFFSET: u16 = 0x0920;
const DELAY: u16 = 0x0928;
const DIFFERENCE: u16 = 0x092C;
const SPEED_START: u16 = 0x0930;
const FILTER: u16 = 0x0934;
const ACTIVATION: u16 = 0x0981;
const ACTIVATION_STATUS: u16 = 0x0984;
const START_TIME: u16 = 0x0990;
const SYNC0_PERIOD: u16 = 0x09A0;
/// From the last pulse of SYNC0 in a cycle to the first one of the next, less a period of SYNC0.
const SYNC1_PERIOD: u16 = 0x09A4;
/// Ranges that a MainDevice writes: control loop, activation, start, periods, latches.
const WRITABLE: [std::ops::Range<u16>; 6] = [
    0x0920..0x092C,
    0x0930..0x0936,
    0x0980..0x0982,
    0x0990..0x0998,
    0x09A0..0x09A8,
    0x09A8..0x09AA,
];
/// Bits of 0981h: cyclic operation, and SYNC0.
const CYCLIC_SYNC0: u8 = 0x03;
/// Largest correction of the time by one write of the reference's time, ps.
const MAX_STEP_PS: i128 = 1_000_000;
/// Difference above which the loop learns no speed, ps.
const MAX_LEARNED_PS: i128 = 1_000_000_000;
/// Largest correction of the speed, parts per billion.
const MAX_LOOP_PPB: i64 = 3_000_000;

/// Setup of a distributed clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClockSetup {
    /// Drift against the time of the wire, parts per billion.
    pub drift_ppb: i32,
    /// Local time at power-on, ns.
    pub offset_ns: u64,
}

/// A distributed clock.
#[derive(Clone, Debug)]
pub(super) struct DistributedClock {
    setup: ClockSetup,
    /// Time of the wire, ns, at which the local time was `local_ps`.
    at_ns: u64,
    local_ps: i128,
    /// Correction of the speed by the control loop, parts per billion.
    loop_ppb: i64,
    /// Time of the wire of the last write of the reference's time.
    compared_ns: Option<u64>,
    /// Filtered difference to the reference, ps.
    difference_ps: i128,
    /// System time of the next pulse of SYNC0, ns.
    next_pulse_ns: Option<u64>,
    ignores_period: bool,
    /// System time that is read from now on.
    frozen_ns: Option<u64>,
}

impl DistributedClock {
    pub(super) fn new(setup: ClockSetup, now_ns: u64) -> Self {
        Self {
            setup,
            at_ns: now_ns,
            local_ps: i128::from(setup.offset_ns) * 1_000,
            loop_ppb: 0,
            compared_ns: None,
            difference_ps: 0,
            next_pulse_ns: None,
            ignores_period: false,
            frozen_ns: None,
        }
    }

    pub(super) const fn setup(&self) -> ClockSetup {
        self.setup
    }

    /// Changes the drift from now on.
    pub(super) fn set_drift(&mut self, now_ns: u64, drift_ppb: i32) {
        self.rebase(now_ns);
        self.setup.drift_ppb = drift_ppb;
    }

    /// Moves the local time by a jump, ns.
    pub(super) fn jump(&mut self, by_ns: i64) {
        self.local_ps += i128::from(by_ns) * 1_000;
    }

    /// Takes no write of SYNC0's period from now on.
    pub(super) const fn ignore_period(&mut self) {
        self.ignores_period = true;
    }

    /// Keeps the system time that is read from now on.
    pub(super) fn freeze(&mut self, memory: &Memory, now_ns: u64) {
        self.frozen_ns = Some(self.system_ns(memory, now_ns));
    }

    fn local_ps(&self, now_ns: u64) -> i128 {
        let passed_ns = i128::from(now_ns) - i128::from(self.at_ns);
        let speed_ppb = i128::from(self.setup.drift_ppb) + i128::from(self.loop_ppb);
        self.local_ps + passed_ns * 1_000 + passed_ns * speed_ppb / 1_000_000
    }

    fn rebase(&mut self, now_ns: u64) {
        (self.local_ps, self.at_ns) = (self.local_ps(now_ns), now_ns);
    }

    fn local_ns(&self, now_ns: u64) -> u64 {
        (self.local_ps(now_ns) / 1_000) as u64
    }

    /// Returns the system time: local time and offset, ns.
    pub(super) fn system_ns(&self, memory: &Memory, now_ns: u64) -> u64 {
        self.local_ns(now_ns).wrapping_add(memory.u64(OFFSET))
    }

    /// Writes the registers that change by themselves.
    pub(super) fn refresh(&self, memory: &mut Memory, now_ns: u64) {
        let system_ns = self
            .frozen_ns
            .unwrap_or_else(|| self.system_ns(memory, now_ns));
        memory.set(SYSTEM_TIME, &system_ns.to_le_bytes());
    }

    /// Takes a write of a MainDevice, at the time at which it passes here and that of its way back.
    /// False if no byte was taken.
    pub(super) fn write(
        &mut self,
        memory: &mut Memory,
        address: u16,
        data: &[u8],
        (now_ns, back_ns): (u64, u64),
    ) -> bool {
        let written = u32::from(address)..u32::from(address) + data.len() as u32;
        let has = |register: u16| written.contains(&u32::from(register));
        let mut taken = false;
        if has(PORT_0) {
            let [here, back] = [now_ns, back_ns].map(|at_ns| self.local_ns(at_ns));
            memory.set(PORT_0, &(here as u32).to_le_bytes());
            memory.set(PORT_1, &(back as u32).to_le_bytes());
            memory.set(RECEIVE_TIME, &here.to_le_bytes());
            taken = true;
        }
        if address == SYSTEM_TIME {
            self.compare(memory, data, now_ns);
            taken = true;
        }
        for (offset, byte) in (0_u16..).zip(data) {
            let at = address.saturating_add(offset);
            let is_period = (SYNC0_PERIOD..SYNC0_PERIOD + 4).contains(&at);
            if WRITABLE.iter().any(|range| range.contains(&at)) {
                taken = true;
                if !(is_period && self.ignores_period) {
                    memory.set(at, &[*byte]);
                }
            }
        }
        if has(SPEED_START) {
            self.rebase(now_ns);
            (self.loop_ppb, self.compared_ns, self.difference_ps) = (0, None, 0);
            memory.set(DIFFERENCE, &[0; 4]);
        }
        if has(ACTIVATION) {
            self.activate(memory, now_ns);
        }
        taken
    }

    /// Compares the time of the reference, and follows it: by a bounded step, and by its speed.
    fn compare(&mut self, memory: &mut Memory, data: &[u8], now_ns: u64) {
        let mut bytes = [0; 8];
        let known = data.len().min(8);
        if let (Some(place), Some(sent)) = (bytes.get_mut(..known), data.get(..known)) {
            place.copy_from_slice(sent);
        }
        let reference_ns = u64::from_le_bytes(bytes);
        let delay_ns = memory.u32(DELAY);
        self.rebase(now_ns);
        let own_ps = self.local_ps + i128::from(memory.u64(OFFSET) as i64) * 1_000;
        let ahead_ps = own_ps - (i128::from(reference_ns) + i128::from(delay_ns)) * 1_000;
        let depth = u32::from(memory.u8(FILTER).min(16));
        self.difference_ps += (ahead_ps - self.difference_ps) / (1 << depth);
        if let Some(before_ns) = self.compared_ns.filter(|_| ahead_ps.abs() < MAX_LEARNED_PS) {
            let passed_ns = i128::from(now_ns.saturating_sub(before_ns).max(1));
            // ps per ns are 10^6 ppb; an eighth at a time.
            let learned = ahead_ps * 1_000_000 / passed_ns / 8;
            let learned = learned.clamp(-1_000_000, 1_000_000) as i64;
            self.loop_ppb = (self.loop_ppb - learned).clamp(-MAX_LOOP_PPB, MAX_LOOP_PPB);
        }
        self.local_ps -= (ahead_ps / 2).clamp(-MAX_STEP_PS, MAX_STEP_PS);
        self.compared_ns = Some(now_ns);
        // Sign and magnitude: bit 31 for a local time behind that of the reference.
        let magnitude = (self.difference_ps.abs() / 1_000).min(0x7FFF_FFFF) as u32;
        let sign = if self.difference_ps < 0 { 1 << 31 } else { 0 };
        memory.set(DIFFERENCE, &(magnitude | sign).to_le_bytes());
    }

    /// Starts or ends the pulses. A start that is past never comes.
    fn activate(&mut self, memory: &mut Memory, now_ns: u64) {
        let activation = memory.u8(ACTIVATION);
        let start_ns = memory.u64(START_TIME);
        let is_active = activation & CYCLIC_SYNC0 == CYCLIC_SYNC0;
        let is_ahead = start_ns > self.system_ns(memory, now_ns);
        self.next_pulse_ns =
            (is_active && is_ahead && memory.u32(SYNC0_PERIOD) > 0).then_some(start_ns);
        let pending = u8::from(self.next_pulse_ns.is_some());
        memory.set(ACTIVATION_STATUS, &[pending]);
    }

    /// True if SYNC0 is set up.
    pub(super) const fn is_active(&self) -> bool {
        self.next_pulse_ns.is_some()
    }

    /// Takes the next pulse of SYNC0 that has come by now and begins a cycle: of several in a cycle
    /// the first.
    pub(super) fn take_pulse(&mut self, memory: &Memory, now_ns: u64) -> bool {
        let system_ns = self.system_ns(memory, now_ns);
        let Some(next_ns) = self.next_pulse_ns.filter(|next_ns| *next_ns <= system_ns) else {
            return false;
        };
        let cycle_ns = u64::from(memory.u32(SYNC0_PERIOD)) + u64::from(memory.u32(SYNC1_PERIOD));
        self.next_pulse_ns = Some(next_ns.saturating_add(cycle_ns));
        true
    }
}
