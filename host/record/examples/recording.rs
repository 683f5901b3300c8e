//! A second of a server, tick by tick, in a file: CSV, LabComm or MCAP by the name's extension.
//!
//! ```text
//! cargo run -p gantry-tau-record --example recording -- ticks.mcap
//! ```
use std::error::Error;
use std::sync::atomic::Ordering;

use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_record::recording::{RecordTo, Recording, drain};
use gantry_tau_server::gantry_tau_core::EpochRange;
use gantry_tau_server::gantry_tau_core::control::message::Capabilities;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::event_log::EventLog;
use gantry_tau_server::server::{Cycle, Server, TickSource};
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::{load_generator::load_generator, machine::SimulatedMachine};

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args().nth(1);
    let to: RecordTo = file.as_deref().unwrap_or("ticks.csv").parse()?;
    let robot = RobotFile::builtin_l2()?;
    let (_hand, tool) = load_generator();
    let machine = SimulatedMachine::<3, 3>::from_robot(&robot, tool, Motion::Hold)?;
    let config = robot.session_config(Capabilities::default())?;
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
    let (server, mut records) = Server::spawn(cycle, TickSource::RealTime)?;

    let mut recording = Recording::create::<TickRecord<3>, _>(&to, &robot)?;
    let mut log = EventLog::default(); // what happened between one tick and the next
    drain(&mut records, |record, _is_last| {
        recording.write(record, &log.see(record));
        if record.state.tick.0 >= 1_000 {
            server.controls.quit.store(true, Ordering::Relaxed);
        }
    });
    let missed = server.quit()?;
    println!("{}", recording.finish(missed));
    Ok(())
}
