//! A whole server around the core: bytes in, bytes and drive references out. Timer, sockets and drives are yours.
use gantry_tau_core::axis::Offsets;
use gantry_tau_core::channel::Limits;
use gantry_tau_core::endpoint::{Cycle, Endpoint, MotorMap, Transport};
use gantry_tau_core::message::{AxisLimits, Capabilities};
use gantry_tau_core::session::Session;
use gantry_tau_core::session::config::{AxisConfig, Config, Parameters, Travel};
use gantry_tau_core::units::{Epoch, PositionNm, Tick};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let travel = |lower, upper| Travel {
        lower: PositionNm(lower),
        upper: PositionNm(upper),
    };
    let axis = AxisConfig {
        limits: AxisLimits {
            // At most 2 mm, 5 µm per tick, and 0.1 µm per tick on the way back to zero.
            position: Limits::new(2_000_000, 5_000, 10_000, 100)?,
            velocity: Limits::DISABLED,
            torque: Limits::DISABLED,
        },
        nominal_travel: travel(-1_000_000_000, 1_000_000_000),
        machine_travel: travel(-1_002_000_000, 1_002_000_000),
        nominal_step_nm: 2_000_000,
    };
    let config = Config::new(Parameters {
        cycle_us: 1_000,
        echo_window: 0,
        handshake_ticks: 1_000,
        budget: None,
        capabilities: Capabilities::NONE,
        kinematics_checksum: 0,
        axes: [axis; 3],
    })?;
    let in_force = [Offsets::default(); 3]; // as read back from the drives
    let nominal = [PositionNm(0); 3];
    let session = Session::new(config, &in_force, nominal, Tick(0), Epoch(0))?;
    let motors = MotorMap::new([0, 1, 2])?;
    let mut server = Endpoint::<3, 3, 64>::new(session, motors);

    let client = server.open(Transport::Stream).map_err(|_| "no room")?;
    for _ in 0..3 {
        // Once per millisecond: what the socket had, what the drives say, and out comes what both receive.
        server.feed(client, b"");
        let cycle = Cycle {
            elapsed: 1,
            nominal,
            actual: Default::default(),
            stop: false,
            rearm: false,
            next_epoch: Epoch(1), // from a counter kept on your disk
            arrival_us: 0,
        };
        let turn = server.tick(&cycle, &mut |to, bytes| println!("{to:?}: {bytes:?}"));
        println!("to the drives: {:?}", turn.motors);
    }
    Ok(())
}
