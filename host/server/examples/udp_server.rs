//! A server that speaks UDP, and a peer that asks it for a session, datagram by datagram.
//!
//! ```text
//! cargo run -p gantry-tau-server --example udp_server
//! ```
use std::net::UdpSocket;
use std::time::Duration;

use gantry_tau_server::gantry_tau_core::control::client::{Event, Requirements};
use gantry_tau_server::gantry_tau_core::*;
use gantry_tau_server::links::Allowed;
use gantry_tau_server::plant::{Plant, PlantError, Reading};
use gantry_tau_server::server::connections::Listen;
use gantry_tau_server::server::*;
use gantry_tau_server::state::StopLatch;

struct Axis([InForce; 1]); // one drive that does what it is asked for
impl Plant<1, 1> for Axis {
    type Error = PlantError;
    fn in_force(&mut self) -> Result<[InForce; 1], PlantError> {
        Ok(self.0)
    }
    fn read(&mut self, _elapsed_cycles: u64) -> Result<Reading<1>, PlantError> {
        Ok(Reading::of_axes([PositionNm(0)], [Actual::ZERO]))
    }
    fn write(&mut self, _: &[Reference; 1], parts: &[InForce; 1]) -> Result<(), PlantError> {
        self.0 = *parts;
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let limits = Limits::new(LimitValues {
        max: 2_000_000,
        step: 5_000,
        accel: 10_000,
        ramp: 100,
    })?;
    let axis = AxisConfig::position_only(limits, Travel::around_zero(1_000_000_000), 2_000_000);
    let config = Config::new(Parameters::thesis([axis]))?;
    let listen = Listen {
        address: "127.0.0.1:0".parse()?, // a free port
        transport: Transport::Datagram,
        allowed: Allowed::only(&["127.0.0.0/8".to_owned()])?, // other peers are not answered
    };
    let machine = Axis([InForce::at(PositionNm(0))]);
    let motors = MotorMap::new([0])?;
    let epochs = EpochRange::VOLATILE; // own_machine.rs keeps epochs and the stop in files
    let cycle = Cycle::new(
        config,
        motors,
        machine,
        epochs,
        StopLatch::volatile(),
        listen,
    )?;
    let (server, _records) = Server::spawn(cycle, TickSource::RealTime)?;
    let peer = UdpSocket::bind("127.0.0.1:0")?;
    peer.connect(server.address)?;
    peer.set_read_timeout(Some(Duration::from_secs(1)))?;
    let mut client = Client::<1>::new(Transport::Datagram, Requirements::default());
    let hello = client.hello().ok_or("a client says Hello first")?;
    peer.send(&hello)?; // again after a while without an answer: datagrams may be lost
    let mut datagram = [0; 512];
    let length = peer.recv(&mut datagram)?;
    let datagram = datagram.get(..length).unwrap_or_default();
    match client.feed(datagram).poll_event().transpose()? {
        Some(Event::Welcomed(session)) => println!("session granted, epoch {}", session.epoch.0),
        other => println!("no session: {other:?}"),
    }
    Ok(server.quit().map(|_missed| ())?)
}
