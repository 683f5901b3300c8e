//! An exchange with the drives of nine motors. The chain that answers is a wire's other end: what
//! it does is left out.

use std::hint::black_box;
use std::sync::atomic::{AtomicBool, Ordering};

use gantry_tau_ethercat::emulation::{Chain, DriveSetup, EmulatedWire, Identity, Kinematic};
use gantry_tau_ethercat::{
    DevicePlace, DriveConfig, Drives, Offset, Settings, Target, Wire, WireError,
};

use super::measured;

/// The call is being counted.
static IS_COUNTED: AtomicBool = AtomicBool::new(false);

/// Leaves out what a call does. Callgrind begins or ends to collect with every function of such a
/// name: within the one that is counted it ends.
#[inline(never)]
fn unmeasured<R>(call: impl FnOnce() -> R) -> R {
    call()
}

fn aside<R>(call: impl FnOnce() -> R) -> R {
    if IS_COUNTED.load(Ordering::Relaxed) {
        unmeasured(call)
    } else {
        call()
    }
}

/// The emulated wire, whose time costs nothing.
struct Aside(EmulatedWire<Kinematic>);

impl Wire for Aside {
    fn now_us(&self) -> u64 {
        aside(|| self.0.now_us())
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), WireError> {
        aside(|| self.0.send(frame))
    }

    fn receive(&mut self, buffer: &mut [u8]) -> Option<usize> {
        aside(|| self.0.receive(buffer))
    }

    fn wait_until(&mut self, us: u64) {
        aside(|| self.0.wait_until(us));
    }

    fn begin_cycles(&mut self, cycles: u64, cycle_us: u64) {
        aside(|| self.0.begin_cycles(cycles, cycle_us));
    }
}

fn setup(index: u16) -> DriveSetup {
    DriveSetup {
        identity: Identity {
            vendor: 1,
            product: 1,
            revision: 1,
            serial: index.into(),
        },
        alias: 0,
        position: 0,
        missing: vec![],
        software_limits: (0, 0),
        encoder: (1 << 20, 1),
        following_error: (20_000, 10),
        quick_stop: 100_000_000,
        has_watchdog: true,
        watchdog_is_writable: true,
    }
}

fn config(index: u16) -> DriveConfig {
    DriveConfig {
        place: DevicePlace::Position(index),
        vendor: 1,
        product: 1,
        serial: None,
        counts_per_turn: None,
        travel: (-1_000_000, 1_000_000),
        needs_velocity_offset: true,
        needs_torque_offset: true,
    }
}

/// References out, one frame, measurements in, compared and judged.
pub(super) fn exchange() {
    let setups: Vec<DriveSetup> = (0..9).map(setup).collect();
    let mut wire = EmulatedWire::new(Chain::new(&setups, Kinematic));
    let settings = Settings {
        cycle_us: 1_000,
        watchdog_cycles: 5,
        answer_us: 500,
    };
    let configs = [0, 1, 2, 3, 4, 5, 6, 7, 8].map(config);
    let mut drives = Drives::bring_up(Aside(wire.clone()), &configs, settings).unwrap();
    drives.start(|_| [Target::default(); 9]);
    for position in 0..10 {
        wire.begin_cycles(1, 1_000);
        drives
            .cycle(
                &[Target {
                    position,
                    ..Target::default()
                }; 9],
            )
            .unwrap();
    }
    wire.begin_cycles(1, 1_000);
    let offset = Offset {
        position: 10,
        ..Offset::default()
    };
    let targets = black_box(
        [Target {
            position: 10,
            offset,
        }; 9],
    );
    IS_COUNTED.store(true, Ordering::Relaxed);
    let outcome = measured(|| drives.cycle(&targets));
    IS_COUNTED.store(false, Ordering::Relaxed);
    assert_eq!(black_box(outcome), Ok(()));
}
