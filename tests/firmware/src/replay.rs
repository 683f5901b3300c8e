//! Plays the recording `replay.in` of the emulator's working directory, one tick per interrupt. Writes `replay.out`, what became of
//! it, and `replay.laps`: of every tick the cycles of each part, and at the end the high-water
//! marks of the stack, that of the start and that of the ticks.

use core::mem::MaybeUninit;

use cortex_m::singleton;
use gantry_tau_core::control::endpoint::Turn;
use gantry_tau_core::control::message::{Capabilities, Phase};
use gantry_tau_core::units::PositionNm;

use crate::board::host::File;
use crate::board::timer::Ticks;
use crate::board::{clock, copy, stack};
use crate::machine::{AXES, MOTORS, Machine, Meter, Part, Parts};
use crate::reading::OF_OWNER;
use crate::recording::{self, Room, Sink, Source, Watch};

/// Plays; whether all went well.
pub(crate) fn run(ticks: Ticks) -> bool {
    if !copy::is_exact() {
        defmt::error!("memory is not copied as it should be");
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
    let Some(nominal) = recording::start(&mut recording) else {
        defmt::error!("the recording is broken");
        return false;
    };
    let (Some(machine), Some(room), Some(buffer)) = (
        machine(nominal),
        singleton!(: Room = [0; OF_OWNER]),
        singleton!(: [u8; BUFFER] = [0; BUFFER]),
    ) else {
        return false;
    };
    let mut out = Buffered {
        file: out,
        buffer,
        used: 0,
        written: true,
    };
    let mut watch = Laps {
        ticks,
        file: laps,
        since: 0,
        cycles: [0; 3],
        phase: Phase::Listening,
        written: true,
    };
    let to_start = stack::high_water();
    stack::forget();
    let played = recording::play(machine, room, &mut recording, &mut out, &mut watch).is_some();
    out.empty();
    watch.write(to_start);
    watch.write(stack::high_water());
    if !played {
        defmt::error!("the recording is broken");
    }
    played && out.written && watch.written
}

/// The machine at its place. Apart, because what it takes of the stack is given back before the first tick.
#[inline(never)]
fn machine(nominal: [PositionNm; AXES]) -> Option<&'static mut Machine> {
    let Ok(parts) = Parts::new(Capabilities::NONE, nominal) else {
        defmt::error!("core refuses the machine");
        return None;
    };
    let place = singleton!(: MaybeUninit<Machine> = MaybeUninit::uninit())?;
    Some(place.write(Machine::new(parts)))
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
    written: bool,
}

impl Buffered {
    fn empty(&mut self) {
        let bytes = self.buffer.get(..self.used).unwrap_or_default();
        self.written &= self.file.write_all(bytes);
        self.used = 0;
    }
}

impl Sink for Buffered {
    fn write(&mut self, bytes: &[u8]) {
        if self.used.saturating_add(bytes.len()) > BUFFER {
            self.empty();
        }
        // In two steps, so that the compiler knows the lengths are equal, and `copy_from_slice` links no panic.
        let rest = self.buffer.get_mut(self.used..).unwrap_or_default();
        match rest.get_mut(..bytes.len()) {
            Some(room) => {
                room.copy_from_slice(bytes);
                self.used = self.used.saturating_add(bytes.len());
            }
            None => self.written &= self.file.write_all(bytes),
        }
    }
}

/// Measures the parts of every tick, and logs what happens to the session.
struct Laps {
    ticks: Ticks,
    file: File,
    since: u32,
    cycles: [u32; 3],
    phase: Phase,
    written: bool,
}

impl Laps {
    fn write(&mut self, number: usize) {
        self.written &= self.file.write_all(&number.to_le_bytes());
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

impl Watch for Laps {
    fn wait(&mut self) {
        self.ticks.wait();
    }

    fn turned(&mut self, turn: &Turn<AXES, MOTORS>) {
        for cycles in core::mem::take(&mut self.cycles) {
            self.written &= self.file.write_all(&cycles.to_le_bytes());
        }
        let output = &turn.output;
        let tick = output.state.tick;
        if let Some(connection) = output.welcome {
            defmt::info!(
                "{}: {} is welcome, {}",
                tick,
                connection,
                output.state.epoch
            );
        }
        if let Some(cause) = output.ended {
            defmt::info!("{}: ended, {}, {}", tick, cause, output.state.counters);
        }
        if self.phase != output.state.phase {
            self.phase = output.state.phase;
            defmt::info!("{}: {}", tick, self.phase);
        }
    }
}
