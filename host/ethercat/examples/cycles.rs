//! Cycles on an emulated bus, for counting instructions: `valgrind --tool=callgrind target/release/examples/cycles 1000`.
#![cfg_attr(not(target_os = "linux"), allow(unused))]

#[cfg(target_os = "linux")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    use gantry_tau_ethercat::emulation::{Chain, DriveSetup, EmulatedWire, Identity, Kinematic};
    use gantry_tau_ethercat::{DriveConfig, Drives, Offset, Place, Settings, Target, Wire};

    const MOTORS: usize = 9;
    let cycles: i32 = std::env::args().nth(1).map_or(Ok(1_000), |text| text.parse())?;
    let setup = |index: u16| DriveSetup {
        identity: Identity { vendor: 1, product: 1, revision: 1, serial: index.into() },
        alias: index.saturating_add(1_001),
        position: 0,
        missing: vec![],
        software_limits: (0, 0),
        encoder: (1 << 20, 1),
        following_error: (20_000, 10),
        quick_stop: 100_000_000,
        has_watchdog: true,
        watchdog_is_writable: true,
    };
    let setups: Vec<DriveSetup> = (0..9).map(setup).collect();
    let drive = DriveConfig {
        place: Place::Position(0),
        vendor: 1,
        product: 1,
        serial: None,
        counts_per_turn: None,
        travel: (-1_000_000, 1_000_000),
        needs_velocity_offset: true,
        needs_torque_offset: true,
    };
    let mut places = (0..).map(Place::Position);
    let drives = [drive; MOTORS].map(|drive| DriveConfig { place: places.next().unwrap_or(drive.place), ..drive });
    let mut wire = EmulatedWire::new(Chain::new(&setups, Kinematic));
    let settings = Settings { cycle_us: 1_000, watchdog_cycles: 5, answer_us: 500 };
    let mut drives = Drives::bring_up(wire.clone(), &drives, settings)?;
    drives.start(|_| [Target::default(); MOTORS]);
    for position in 0..cycles {
        wire.begin_cycles(1, 1_000);
        let offset = Offset { position, ..Offset::default() };
        drives.cycle(&[Target { position: 0, offset }; MOTORS])?;
    }
    println!("{cycles} cycles of {MOTORS} motors");
    Ok(())
}

#[cfg(not(target_os = "linux"))]
fn main() {}
