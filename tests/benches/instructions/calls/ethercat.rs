//! An exchange with the drives of nine motors. The chain that answers is a wire's other end: what
//! it does is left out.

use std::hint::black_box;
use std::sync::atomic::{AtomicBool, Ordering};

use gantry_tau_ethercat::emulation::{
    Chain, ClockSetup, Drive, DriveSetup, EmulatedWire, ForceTerminal, ForceUnits, Identity,
    Instrument, Kinematic, Node, SubDevice,
};
use gantry_tau_ethercat::steering::{Steering, SteeringConfig};
use gantry_tau_ethercat::{
    ClockSettings, DevicePlace, DriveConfig, Drives, Extras, ForceSensorConfig, Offset, Settings,
    Target, Wire, WireError,
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

    fn now_ns(&self) -> u64 {
        aside(|| self.0.now_ns())
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

    fn makes_cycles(&self) -> bool {
        true
    }

    fn shift_cycles(&mut self, ns: i64) {
        aside(|| self.0.shift_cycles(ns));
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
    exchange_with(Extras::default());
}

/// The same with the time of the reference, and the steering of the cycle.
pub(super) fn exchange_with_clocks() {
    exchange_with(Extras {
        clocks: Some(ClockSettings {
            sync0_ns: 1_000_000,
            frame_to_sync0_ns: 500_000,
            has_sync1: false,
        }),
        force_sensor: None,
        gauges: &[],
    });
}

/// The same without clocks, and with the frame of a force sensor.
pub(super) fn exchange_with_force_sensor() {
    exchange_with(Extras {
        clocks: None,
        gauges: &[],
        force_sensor: Some(ForceSensorConfig {
            place: DevicePlace::Position(9),
            vendor: ForceTerminal::IDENTITY.vendor,
            product: ForceTerminal::IDENTITY.product,
            calibration: 0,
        }),
    });
}

/// Nine drives and a force sensor. With clocks, drives that run on SYNC0 alone.
fn chain(has_clocks: bool) -> Chain<Kinematic> {
    let drives = (0..9).map(setup).map(|setup| {
        let drive = Drive::new(&setup);
        Node::Drive(if has_clocks {
            SubDevice::of(drive.with_synchronisation(0x04).requiring_sync0())
                .with_clock(ClockSetup::default())
        } else {
            SubDevice::of(drive)
        })
    });
    let units = ForceUnits {
        force: 2,
        torque: 3,
        counts_per_force: 1_000_000,
        counts_per_torque: 1_000_000,
    };
    let sensor = Instrument::Force(ForceTerminal::new(ForceTerminal::IDENTITY, units));
    let sensor = Node::Instrument(SubDevice::of(sensor));
    Chain::of(drives.chain([sensor]).collect(), Kinematic)
}

fn exchange_with(extras: Extras<'_>) {
    let mut wire = EmulatedWire::new(chain(extras.clocks.is_some()));
    let settings = Settings {
        cycle_us: 1_000,
        watchdog_cycles: 5,
        answer_us: 500,
    };
    let configs = [0, 1, 2, 3, 4, 5, 6, 7, 8].map(config);
    let aside = Aside(wire.clone());
    let mut drives = Drives::bring_up_with(aside, &configs, settings, extras).unwrap();
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
    assert_eq!(drives.force().is_some(), extras.force_sensor.is_some());
    assert!(drives.force().is_none_or(|reading| reading.is_ok()));
}

/// Steers by one sample, locked.
pub(super) fn steering() {
    let config = SteeringConfig {
        cycle_ns: 1_000_000,
        frame_to_sync0_ns: 500_000,
    };
    let start_ns = 200_000_000;
    let mut steering = Steering::new(config, start_ns);
    let mut time_ns = start_ns + 500_000;
    for cycle in 0..600 {
        time_ns += 1_000_000 + cycle % 7;
        steering.step(Some(time_ns), 0);
    }
    assert!(steering.is_locked());
    let (time_ns, late_ns) = black_box((Some(time_ns + 1_000_003), 5_000));
    black_box(measured(|| steering.step(time_ns, late_ns)));
}
