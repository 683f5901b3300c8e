//! The client over UDP: what comes twice, or has been overtaken, is not answered again.

use gantry_tau_client::force_sensor::SensorSource;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::Ordering;

use gantry_tau_client::{ClientControls, ClientOptions, run};
use gantry_tau_core::control::endpoint::{Endpoint, Transport};
use gantry_tau_core::control::message::{Capabilities, ClientMessage, Command, Phase};
use gantry_tau_core::control::session::{Connection, Session, Start};
use gantry_tau_core::control::wire::{Frame, MAX_FRAME, decode_client};
use gantry_tau_core::units::{EpochRange, PositionNm, Tick};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_tests::DEADLINE;
use gantry_tau_tests::server_fixture::{LOOPBACK, on_time, taken};

/// A server of one client, by hand: what it sends is the test's to send.
struct Server {
    socket: UdpSocket,
    client: Option<SocketAddr>,
    endpoint: Endpoint<3>,
    connection: Connection,
}

impl Server {
    fn of<K: gantry_tau_machine::model::MachineKind<3>>(robot: &RobotFile<K, 3>) -> Self {
        let config = robot.session_config(Capabilities::NONE).unwrap();
        let session = Session::new(config, &Start::at_rest([PositionNm(0); 3])).unwrap();
        let mut endpoint = Endpoint::new(session, EpochRange::VOLATILE);
        let connection = endpoint.open(Transport::Datagram).unwrap();
        let socket = UdpSocket::bind(LOOPBACK).unwrap();
        socket.set_read_timeout(Some(DEADLINE)).unwrap();
        Self {
            socket,
            client: None,
            endpoint,
            connection,
        }
    }

    /// Waits for the client's next message, which the coming tick has.
    fn receive(&mut self) -> ClientMessage<3> {
        let mut buffer = [0; MAX_FRAME];
        let (count, from) = loop {
            match self.socket.recv_from(&mut buffer) {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                received => break received.unwrap(),
            }
        };
        self.client = Some(from);
        self.endpoint.feed(self.connection, &buffer[..count]);
        decode_client(&Frame::parse(&buffer[..count]).unwrap()).unwrap()
    }

    /// Waits for a Command. A Hello before it is that of a client that has waited long in the
    /// handshake: this machine is busy.
    fn receive_command(&mut self) -> Command<3> {
        loop {
            match self.receive() {
                ClientMessage::Command(command) => return command,
                ClientMessage::Hello(_) if self.phase() == Phase::Handshake => {}
                other => panic!("not a Command: {other:?}"),
            }
        }
    }

    /// One tick; the frames it sends.
    fn tick(&mut self) -> Vec<Vec<u8>> {
        taken(self.endpoint.tick(&on_time([PositionNm(0); 3])));
        let mut frames = Vec::new();
        while let Some((_, bytes)) = self.endpoint.poll_transmit() {
            frames.push(bytes.to_vec());
        }
        frames
    }

    fn send(&self, frame: &[u8]) {
        self.socket.send_to(frame, self.client.unwrap()).unwrap();
    }

    fn phase(&self) -> Phase {
        self.endpoint.session().phase()
    }
}

#[test]
fn every_state_is_answered_once() {
    let robot = RobotFile::builtin_l2().unwrap();
    let mut server = Server::of(&robot);
    let options = ClientOptions {
        server: server.socket.local_addr().unwrap().into(),
        transport: Transport::Datagram,
        sensor: SensorSource::States,
        accelerometer: None,
        robot,
        key: None,
        record: None,
        obtain: false,
        accept_unstable: false,
    };
    let controls = ClientControls::default();
    std::thread::scope(|scope| {
        let client = scope.spawn(|| run(&options, &controls));
        assert!(matches!(server.receive(), ClientMessage::Hello(_)));
        let frames = server.tick();
        frames.iter().for_each(|frame| server.send(frame));
        let mut before = frames.last().unwrap().clone();
        for tick in 1..50 {
            // An answer to anything but the new State would come first, or be received in the next
            // round.
            let command = server.receive_command();
            assert_eq!((command.sequence.0, command.echo), (tick, Tick(tick)));
            let [state] = server.tick().try_into().unwrap();
            for frame in [&before, &state, &state, &before] {
                server.send(frame);
            }
            before = state;
        }
        assert_eq!(server.phase(), Phase::Submit);
        controls.quit.store(true, Ordering::Relaxed);
        while server.phase() == Phase::Submit {
            server.receive();
            let frames = server.tick();
            frames.iter().for_each(|frame| server.send(frame));
        }
        let report = client.join().unwrap().unwrap();
        assert!(report.states >= 50, "{report:?}");
    });
}
