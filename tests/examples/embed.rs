//! A whole server around the core: bytes in, bytes and drive references out. Timer, sockets and drives are yours.
use gantry_tau_core::control::axis::{Actual, Offsets};
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::endpoint::{Cycle, Endpoint, MotorMap, Transport};
use gantry_tau_core::control::session::Session;
use gantry_tau_core::control::session::config::{AxisConfig, Config, Parameters, Travel};
use gantry_tau_core::units::{Epoch, PositionNm, Tick};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Offsets of at most 2 mm, 5 µm per tick, and 0.1 µm per tick on the way back to zero; all in nm.
    let limits = Limits::new(2_000_000, 5_000, 10_000, 100)?;
    let axis = AxisConfig::position_only(limits, Travel::around_zero(1_000_000_000), 2_000_000);
    let config = Config::new(Parameters::thesis([axis; 3]))?;
    let in_force = [Offsets::default(); 3]; // as read back from the drives
    let nominal = [PositionNm(0); 3]; // as interpolated along the path
    let session = Session::new(config, &in_force, nominal, Tick(0), Epoch(0))?;
    let mut server = Endpoint::<3, 3, 64>::new(session, MotorMap::new([0, 1, 2])?);
    let client = server.open(Transport::Stream).map_err(|_| "no room")?;
    let mut next_epoch = Epoch(1); // greater than every one before: from storage
    for _millisecond in 0..3 {
        server.feed(client, b""); // what the client's socket had
        let cycle = Cycle::on_time(nominal, [Actual::default(); 3], next_epoch);
        let mut frames = Vec::new();
        let turn = server.tick(&cycle, &mut |to, bytes| frames.push((to, bytes.to_vec())));
        println!("write to the drives, first of all: {:?}", turn.motors);
        for (to, bytes) in frames {
            println!("send to {to:?}: {bytes:?}");
        }
        for connection in &turn.close {
            println!("close {connection:?}");
        }
        if turn.output.welcome.is_some() {
            next_epoch = Epoch(next_epoch.0.saturating_add(1)); // into storage, before the next tick
        }
    }
    Ok(())
}
