//! Playback of the recording `replay.in` of the emulator's working directory, one cycle per
//! interrupt.
//!
//! Writes the outcome to `replay.out`. Writes to `replay.laps` the clock cycles of each part of
//! every cycle, and at the end the high-water marks of the stack: of the start, and of the cycles.

use core::mem::MaybeUninit;

use cortex_m::singleton;
use gantry_tau_core::control::message::Capabilities;
use gantry_tau_core::control::session::{Connection, Output};
use gantry_tau_core::units::PositionNm;

use crate::board::host::File;
use crate::board::timer::Ticks;
use crate::board::{clock, copy, stack};
use crate::keys;
use crate::machine::{AXES, ControlCycle, Machine, Meter, Part, Parts};
use crate::recording::{self, Observer, Room, Sink, Source};

/// Plays. Returns true if all went well; logs the reason otherwise.
pub(crate) fn run(ticks: Ticks) -> bool {
    if !copy::is_exact() {
        defmt::error!("memory is not copied exactly");
        return false;
    }
    let (Some(mut recording), Some(out), Some(laps)) = (
        File::open(c"replay.in"),
        File::create(c"replay.out"),
        File::create(c"replay.laps"),
    ) else {
        defmt::error!("a file of the replay cannot be opened");
        return false;
    };
    let (Some(room), Some(buffer)) = (
        singleton!(: Room = Room::EMPTY),
        singleton!(: [u8; BUFFER] = [0; BUFFER]),
    ) else {
        return false;
    };
    let Some(nominal) = recording::start(room, &mut recording) else {
        defmt::error!("the recording is invalid");
        return false;
    };
    let Some(machine) = machine(nominal) else {
        return false;
    };
    let mut out = Buffered {
        file: out,
        buffer,
        used: 0,
        is_written: true,
    };
    let mut laps = Laps {
        ticks,
        file: laps,
        since: 0,
        cycles: [0; 3],
        is_written: true,
    };
    let to_start = stack::high_water();
    stack::forget();
    let played = recording::play(machine, room, &mut recording, &mut out, &mut laps).is_some();
    out.flush();
    laps.write(to_start);
    laps.write(stack::high_water());
    if !played {
        defmt::error!("the recording is invalid");
    }
    played && out.is_written && laps.is_written
}

/// Puts the machine into its place. Not inlined, so that its stack is free again before the first
/// cycle.
#[inline(never)]
fn machine(nominal: [PositionNm; AXES]) -> Option<&'static mut Machine> {
    let cycle =
        ControlCycle::write(singleton!(: MaybeUninit<ControlCycle> = MaybeUninit::uninit())?);
    let Ok(parts) = cycle.and_then(|cycle| Parts::new(cycle, Capabilities::NONE, nominal)) else {
        defmt::error!("core refuses the machine");
        return None;
    };
    let place = singleton!(: MaybeUninit<Machine> = MaybeUninit::uninit())?;
    Some(place.write(Machine::new(parts, keys::server)))
}

impl Source for File {
    fn read(&mut self, bytes: &mut [u8]) -> bool {
        self.read_exact(bytes)
    }
}

/// Bytes that are written at once.
const BUFFER: usize = 4_096;

/// A file, written seldom: every call of the emulator costs it milliseconds.
struct Buffered {
    file: File,
    buffer: &'static mut [u8; BUFFER],
    used: usize,
    is_written: bool,
}

impl Buffered {
    fn flush(&mut self) {
        let bytes = self.buffer.get(..self.used).unwrap_or_default();
        self.is_written &= self.file.write_all(bytes);
        self.used = 0;
    }
}

impl Sink for Buffered {
    fn write(&mut self, bytes: &[u8]) {
        if self.used.saturating_add(bytes.len()) > BUFFER {
            self.flush();
        }
        // In two steps, so that the compiler knows the lengths are equal, and `copy_from_slice`
        // links no panic.
        let rest = self.buffer.get_mut(self.used..).unwrap_or_default();
        match rest.get_mut(..bytes.len()) {
            Some(room) => {
                room.copy_from_slice(bytes);
                self.used = self.used.saturating_add(bytes.len());
            }
            None => self.is_written &= self.file.write_all(bytes),
        }
    }
}

/// Measures the parts of every cycle.
struct Laps {
    ticks: Ticks,
    file: File,
    since: u32,
    cycles: [u32; 3],
    is_written: bool,
}

impl Laps {
    fn write(&mut self, number: usize) {
        self.is_written &= self.file.write_all(&number.to_le_bytes());
    }
}

impl Meter for Laps {
    #[inline(always)]
    fn begin(&mut self) {
        self.since = clock::now();
    }

    #[inline(always)]
    fn end(&mut self, part: Part) {
        let cycles = clock::now().wrapping_sub(self.since);
        let [feed, floats, tick] = &mut self.cycles;
        let sum = match part {
            Part::Feed => feed,
            Part::Floats => floats,
            Part::Tick => tick,
        };
        *sum = sum.saturating_add(cycles);
    }
}

impl Observer for Laps {
    fn wait(&mut self) {
        self.ticks.wait();
    }

    fn ticked(&mut self, _: Option<&Output<AXES>>, _: &[Connection]) {
        for cycles in core::mem::take(&mut self.cycles) {
            self.is_written &= self.file.write_all(&cycles.to_le_bytes());
        }
    }
}
