//! A bus of emulated drives, and a server's cycles on it.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use gantry_tau_ethercat::emulation::{Chain, DriveSetup, EmulatedWire, Identity, Kinematic};
use gantry_tau_ethercat::{
    Condition, DevicePlace, DriveConfig, Drives, Fault, Input, Offset, Settings, Target, Wire as _,
};

pub(crate) const VENDOR: u32 = 0x0000_0A11;
pub(crate) const CYCLE_US: u64 = 1_000;
pub(crate) type Wire = EmulatedWire<Kinematic>;

/// Setup of drive `index`: alias 1001 and so on, product 1 and so on, somewhere in the travel.
pub(crate) fn setup(index: u32) -> DriveSetup {
    DriveSetup {
        identity: Identity {
            vendor: VENDOR,
            product: 1 + index,
            revision: 1,
            serial: 100 + index,
        },
        alias: 1_001 + index as u16,
        position: 10_000 * index as i32 - 5_000,
        missing: Vec::new(),
        software_limits: (-20_000_000, 20_000_000),
        encoder: (1 << 20, 1),
        following_error: (20_000, 10),
        quick_stop: 100_000_000,
        has_watchdog: true,
        watchdog_is_writable: true,
    }
}

pub(crate) fn config(index: u32) -> DriveConfig {
    DriveConfig {
        place: DevicePlace::Alias(1_001 + index as u16),
        vendor: VENDOR,
        product: 1 + index,
        serial: None,
        counts_per_turn: Some(1 << 20),
        travel: (-10_000_000, 10_000_000),
        needs_velocity_offset: true,
        needs_torque_offset: true,
    }
}

pub(crate) const SETTINGS: Settings = Settings {
    cycle_us: CYCLE_US as u32,
    watchdog_cycles: 5,
    answer_us: 500,
};

pub(crate) fn configs<const M: usize>() -> [DriveConfig; M] {
    std::array::from_fn(|index| config(index as u32))
}

pub(crate) fn wire(setups: &[DriveSetup]) -> Wire {
    EmulatedWire::new(Chain::new(setups, Kinematic))
}

pub(crate) fn setups(count: u32) -> Vec<DriveSetup> {
    (0..count).map(setup).collect()
}

/// A wire that loses frames on their way back.
#[derive(Clone)]
pub(crate) struct Lossy {
    wire: Wire,
    /// Frames that have come back.
    frames: Arc<AtomicU64>,
    /// One of so many is lost; 0: none.
    one_of: Arc<AtomicU64>,
    /// The number of the first of those that are lost, all of them.
    from: Arc<AtomicU64>,
}

impl Lossy {
    pub(crate) fn new(wire: Wire, one_of: u64) -> Self {
        let [frames, from, one_of] = [0, u64::MAX, one_of].map(AtomicU64::new).map(Arc::new);
        Self {
            wire,
            frames,
            one_of,
            from,
        }
    }

    /// Loses one of so many frames from now on.
    pub(crate) fn lose(&self, one_of: u64) {
        self.one_of.store(one_of, Ordering::Relaxed);
    }

    /// Loses all frames but the next ones.
    pub(crate) fn pass(&self, frames: u64) {
        let next = self.frames.load(Ordering::Relaxed) + frames;
        self.from.store(next, Ordering::Relaxed);
    }
}

impl gantry_tau_ethercat::Wire for Lossy {
    fn now_us(&self) -> u64 {
        self.wire.now_us()
    }

    fn now_ns(&self) -> u64 {
        self.wire.now_ns()
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), gantry_tau_ethercat::WireError> {
        self.wire.send(frame)
    }

    fn receive(&mut self, buffer: &mut [u8]) -> Option<usize> {
        let length = self.wire.receive(buffer)?;
        let frame = self.frames.fetch_add(1, Ordering::Relaxed);
        let one_of = self.one_of.load(Ordering::Relaxed);
        let is_one = one_of > 0 && frame % one_of == one_of - 1;
        (!is_one && frame < self.from.load(Ordering::Relaxed)).then_some(length)
    }

    fn wait_until(&mut self, us: u64) {
        self.wire.wait_until(us);
    }

    fn begin_cycles(&mut self, cycles: u64, cycle_us: u64) {
        self.wire.begin_cycles(cycles, cycle_us);
    }

    fn makes_cycles(&self) -> bool {
        self.wire.makes_cycles()
    }

    fn shift_cycles(&mut self, ns: i64) {
        self.wire.shift_cycles(ns);
    }
}

/// References of motors that stand, with their offsets.
pub(crate) fn standing<const M: usize>(inputs: &[Input; M], offsets: &[Offset; M]) -> [Target; M] {
    std::array::from_fn(|motor| Target {
        position: inputs[motor].position - offsets[motor].position,
        offset: offsets[motor],
    })
}

/// A server that follows its commands.
pub(crate) struct Server<const M: usize> {
    pub(crate) wire: Wire,
    pub(crate) drives: Drives<Wire, M>,
    pub(crate) targets: [Target; M],
}

impl<const M: usize> Server<M> {
    pub(crate) fn on(wire: &Wire) -> Self {
        let mut drives = Drives::bring_up(wire.clone(), &configs(), SETTINGS).unwrap();
        let offsets = drives.initial().map(|initial| initial.offset);
        drives.start(|inputs| standing(inputs, &offsets));
        let targets = standing(drives.inputs(), &offsets);
        Self {
            wire: wire.clone(),
            drives,
            targets,
        }
    }

    pub(crate) fn running() -> Self {
        let server = Self::on(&wire(&setups(M as u32)));
        assert_eq!(server.drives.condition(), Condition::Running);
        server.forget_steps();
        server
    }

    /// A cycle with the targets as they are.
    pub(crate) fn cycle(&mut self) -> Result<(), Fault> {
        self.wire.clone().begin_cycles(1, CYCLE_US);
        if self.drives.condition() != Condition::Running {
            let offsets = self.targets.map(|target| target.offset);
            self.targets = standing(self.drives.inputs(), &offsets);
        }
        self.drives.cycle(&self.targets)
    }

    /// Cycles until one fails; panics after `limit`.
    pub(crate) fn until_fault(&mut self, limit: u32) -> (u32, Fault) {
        for cycle in 0..limit {
            if let Err(fault) = self.cycle() {
                return (cycle, fault);
            }
        }
        panic!("no fault in {limit} cycles");
    }

    /// Cycles until one succeeds; panics after `limit`.
    pub(crate) fn until_running(&mut self, limit: u32) -> u32 {
        let mut last = Ok(());
        for cycle in 0..limit {
            last = self.cycle();
            if last.is_ok() {
                return cycle;
            }
        }
        panic!("not running after {limit} cycles: {last:?}");
    }

    pub(crate) fn forget_steps(&self) {
        self.wire.bench().chain.drives_mut().for_each(|drive| {
            drive.take_largest_step();
        });
    }

    /// Largest step of any drive's own reference since the last call, counts.
    pub(crate) fn largest_step(&self) -> i64 {
        self.wire
            .bench()
            .chain
            .drives_mut()
            .map(|drive| drive.take_largest_step())
            .max()
            .unwrap()
    }
}
