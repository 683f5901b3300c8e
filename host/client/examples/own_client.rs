//! A client of one's own: it moves the first axis by 10 µm, and leaves.
//!
//! ```text
//! cargo run -p gantry-tau-client --example own_client
//! ```
use std::error::Error;
use std::time::Duration;

use gantry_tau_client::Connection;
use gantry_tau_core::control::client::{Event, Requirements};
use gantry_tau_core::control::message::Capabilities;
use gantry_tau_core::{EpochRange, Mode, OffsetNm, Offsets, Transport};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::server::{Cycle, Server, TickSource};
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::{load_generator::load_generator, machine::SimulatedMachine};

fn main() -> Result<(), Box<dyn Error>> {
    let server = simulated_l2()?; // in its place: the address of your server
    let requirements = Requirements {
        capabilities: Capabilities::LOCKSTEP, // the server waits for each answer
        ..Requirements::default()
    };
    let patience = Duration::from_secs(3);
    let mut link = Connection::open(Transport::Stream, server.address, patience, requirements)?;
    let limits = link.greet()?.limits;
    println!("offsets of up to {} nm", limits[0].position.max());
    let mut targets = [Offsets::ZERO; 3];
    targets[0].position = OffsetNm(10_000);
    loop {
        match link.next_event()? {
            Event::State(state) if state.axes[0].offsets == targets[0] => {
                println!("tick {}: the first axis is there", state.tick.0);
                break;
            }
            Event::State(_) => {
                link.answer(Mode::Obtain, &targets)?;
            }
            ended => return Err(format!("the session has ended: {ended:?}").into()),
        }
    }
    link.leave()?; // the server takes the offset back, within its limits
    Ok(server.quit().map(|_missed| println!("left"))?)
}

fn simulated_l2() -> Result<Server<3>, Box<dyn Error>> {
    let robot = RobotFile::builtin_l2()?;
    let (_hand, tool) = load_generator();
    let machine = SimulatedMachine::<3, 3>::from_robot(&robot, tool, Motion::Hold)?;
    let config = robot.session_config(Capabilities::LOCKSTEP)?;
    let motors = robot.motor_map()?;
    let epochs = EpochRange::VOLATILE; // a server of a machine keeps epochs and the stop in files
    let address: std::net::SocketAddr = "127.0.0.1:0".parse()?;
    let cycle = Cycle::new(
        config,
        motors,
        machine,
        epochs,
        StopLatch::volatile(),
        address,
    )?;
    let (server, _records) = Server::spawn(cycle, TickSource::Lockstep)?;
    Ok(server)
}
