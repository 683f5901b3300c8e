//! A black box through core again: every output must be the recorded one, bit for bit.
//!
//! ```text
//! cargo run -p gantry-tau-record --example replay -- epoch-7-tick-4711-Stop.jsonl
//! ```
use std::error::Error;
use std::time::Duration;

use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_record::black_box;
use gantry_tau_server::black_box::{Window, swap_channel};
use gantry_tau_server::gantry_tau_core::EpochRange;
use gantry_tau_server::gantry_tau_core::control::message::Capabilities;
use gantry_tau_server::gantry_tau_core::control::session::replay;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::server::{Cycle, Server, TickSource};
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::{load_generator::load_generator, machine::SimulatedMachine};

fn main() -> Result<(), Box<dyn Error>> {
    let bytes = match std::env::args().nth(1) {
        Some(path) => black_box::bytes(path.as_ref())?,
        None => black_box::encode(&stopped_server()?).into_bytes(), // as `serve` writes it
    };
    let window: Window<3> = black_box::decode("black box", &bytes)?;
    let end = window.end();
    println!(
        "{} ticks; tick {}: {:?}",
        window.entries.len(),
        end.tick.0,
        end.cause
    );
    let replayed = replay(&window.before, &window.entries);
    println!("{} ticks agree", replayed.agreeing);
    match replayed.differing {
        None => Ok(()),
        Some(output) => Err(format!("tick {} differs: {output:?}", output.state.tick.0).into()),
    }
}

/// Runs a server, stops it, and returns the ticks around the stop.
fn stopped_server() -> Result<Window<3>, Box<dyn Error>> {
    let robot = RobotFile::builtin_l2()?;
    let (_hand, tool) = load_generator();
    let machine = SimulatedMachine::<3, 3>::from_robot(&robot, tool, Motion::Hold)?;
    let config = robot.session_config(Capabilities::default())?;
    let motors = robot.motor_map()?;
    let epochs = EpochRange::VOLATILE;
    let address: std::net::SocketAddr = "127.0.0.1:0".parse()?;
    let cycle = Cycle::new(
        config,
        motors,
        machine,
        epochs,
        StopLatch::volatile(),
        address,
    )?;
    let (sender, mut windows) = swap_channel::channel();
    let cycle = cycle.with_black_box(sender);
    let (server, _records) = Server::spawn(cycle, TickSource::RealTime)?;
    std::thread::sleep(Duration::from_millis(100));
    server.controls.press_stop();
    std::thread::sleep(Duration::from_millis(500)); // as many ticks after it
    server.quit()?;
    windows.receive().ok_or("no black box".into())
}
