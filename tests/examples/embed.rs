//! A whole server around the core: bytes in, drive references and bytes out. Timer, sockets and
//! drives are yours. README.md shows the part between the two lines `// README`.
use gantry_tau_core::{
    Actual, AxisConfig, Config, Connection, Endpoint, EpochRange, InForce, LimitValues, Limits,
    MotorMap, Parameters, PositionNm, Reading, Reference, Session, Start, TickInput, Transport,
    Travel, Write,
};

#[rustfmt::skip] // the README's part is compact
fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Offsets of at most 2 mm, 5 µm per tick, and 0.1 µm per tick on the way back to zero; all in
    // nm.
    let limits = Limits::new(LimitValues {
        max: 2_000_000,
        step: 5_000,
        accel: 10_000,
        ramp: 100,
    })?;
    let axis = AxisConfig::position_only(limits, Travel::around_zero(1_000_000_000), 2_000_000);
    let config = Config::new(Parameters::thesis([axis; 3]))?;
    let (nominal, actual) = ([PositionNm(0); 3], [Actual::ZERO; 3]); // as interpolated along the path, and as measured
    let start = Start::at_rest(nominal); // a real machine: as read back from its drives
    let session = Session::new(config, &start)?;
    let motors = MotorMap::<3, 3>::new([0, 1, 2])?;
    let epochs = EpochRange::VOLATILE; // a real machine: a range that is reserved in storage
    // README
    let mut server = Endpoint::new(session, epochs);
    let client = server.open(Transport::Stream)?;
    for _millisecond in 0..3 {
        server.feed(client, b""); // what the client's socket has
        let write = server.tick(&TickInput {
            elapsed_cycles: 1,
            reading: Some(Reading { nominal, actual }), // None: not read
            sensor: None, stop: false, quit: false, rearm: false,
        });
        match write { // not said is unknown
            Write::Due(write) => match write_to_drives(motors.spread(write.references())) {
                Ok(()) => write.accepted(),
                Err(in_force) => write.refused(in_force),
            },
            Write::Withheld(drives) => drives.unknown(), // or read_back
        }
        while let Some((to, frame)) = server.poll_transmit() { send(to, frame); }
        while let Some(connection) = server.poll_close() { close(connection); }
    }
    // README
    Ok(())
}

/// Drives that refuse say what they have in force.
fn write_to_drives(references: Option<[Reference; 3]>) -> Result<(), [InForce; 3]> {
    println!("write {references:?}");
    Ok(())
}

fn send(to: Connection, frame: &[u8]) {
    println!("send to {to:?}: {frame:?}");
}

fn close(connection: Connection) {
    println!("close {connection:?}");
}
