//! After start the cycle allocates nothing: simulated machine, live session, sensor samples,
//! others, ramp, all of it.
//!
//! The crate `allocation_counter` is the allocator of this binary; it counts per thread, so tests
//! beside this one do not matter.

use std::io::Write;
use std::net::{SocketAddr, TcpStream, UdpSocket};

use allocation_counter::measure;
use gantry_tau_core::Offsets;
use gantry_tau_core::control::client::{self, Event, Requirements};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::keys::{Key, Keyring, Role};
use gantry_tau_core::control::message::{Capabilities, Cause, Mode, Phase, Refusal, ServerMessage};
use gantry_tau_core::units::EpochRange;
use gantry_tau_labcomm::Version;
use gantry_tau_machine::model::{F1_MOTORS, L2_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::{DriveKeys, RobotFile};
use gantry_tau_server::black_box::swap_channel::{self, Receiver};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::publication::{Publication, SampleName};
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::connections::{Listen, Listening};
use gantry_tau_server::server::cycle::{Cycle, OperatorInputs};
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::load_generator::{Load, LoadGenerator, load_generator};
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_tests::client::{Client, Noise};
use gantry_tau_tests::server_fixture::{LOOPBACK, await_bytes};
use gantry_tau_tests::wait_for;

/// The server of `gantry-tau serve`, without its clock.
struct Server<const N: usize, const M: usize> {
    cycle: Cycle<N, M, SimulatedMachine<N, M>>,
    hand: LoadGenerator,
    black_boxes: Receiver<N>,
    /// The LabComm port.
    port: SocketAddr,
    /// Its readers: one that reads nothing, and one that talks.
    _readers: [TcpStream; 2],
}

impl<const N: usize, const M: usize> Server<N, M> {
    fn start<K: MachineKind<N>>(robot: &RobotFile<K, N>, transport: Transport) -> Self {
        Self::keyed(robot, transport, None)
    }

    fn keyed<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        transport: Transport,
        keyring: Option<Keyring>,
    ) -> Self {
        let (hand, tool) = load_generator();
        let machine = SimulatedMachine::from_robot(robot, tool, Motion::Hold).unwrap();
        let config = robot.session_config(Capabilities::NONE).unwrap();
        let motors = robot.motor_map().unwrap();
        let port = Publication::bind::<N>(
            LOOPBACK,
            Version::V2006,
            &[SampleName::Data, SampleName::ForceSensor],
            0.5e-6,
        );
        let port = port.unwrap();
        let address = port.address().unwrap();
        let readers = [(); 2].map(|()| TcpStream::connect(address).unwrap());
        (&readers[1]).write_all(&[0xff; 1_000]).unwrap();
        let listen = Listen {
            transport,
            ..LOOPBACK.into()
        };
        let cycle = Cycle::listening(
            config,
            motors,
            machine,
            EpochRange::VOLATILE,
            StopLatch::volatile(),
            Listening::bind(&listen).unwrap().with_keys(keyring),
        )
        .unwrap();
        let (sender, black_boxes) = swap_channel::channel();
        let cycle = cycle.with_sensors(vec![port]).with_black_box(sender);
        Self {
            cycle,
            hand,
            black_boxes,
            port: address,
            _readers: readers,
        }
    }

    /// One look at the sockets and one tick; neither may allocate.
    fn tick(&mut self, stop: bool) -> TickRecord<N> {
        let mut row = None;
        let counted = measure(|| {
            self.cycle.receive();
            row = Some(self.cycle.step(
                1,
                OperatorInputs {
                    stop,
                    rearm: !stop,
                    ..OperatorInputs::default()
                },
            ));
        });
        assert_eq!(
            (counted.count_total, counted.bytes_total),
            (0, 0),
            "the cycle allocated"
        );
        row.unwrap()
    }

    /// One tick with the owner's answer in it.
    fn answered(&mut self, client: &mut Client<N>, mode: Mode, nm: i32) -> TickRecord<N> {
        let frame = client.frame(mode, [nm; N]);
        client.send_bytes(&frame);
        await_bytes(&mut self.cycle, frame.len());
        let row = self.tick(false);
        assert_eq!(client.state(), row.state);
        row
    }
}

#[test]
fn the_counter_counts() {
    let counted = measure(|| drop(std::hint::black_box(vec![1, 2, 3])));
    assert_eq!(counted.count_total, 1);
}

#[test]
fn the_cycle_allocates_nothing() {
    allocates_nothing(Server::<3, L2_MOTORS>::start(
        &RobotFile::builtin_l2().unwrap(),
        Transport::Stream,
    ));
}

#[test]
fn nor_does_it_with_six_axes() {
    allocates_nothing(Server::<6, F1_MOTORS>::start(
        &RobotFile::builtin_f1().unwrap(),
        Transport::Stream,
    ));
}

/// Pairs with play and bias, encoders, latency and supervision.
#[test]
fn nor_does_it_with_drives_that_are_not_ideal() {
    let mut robot = RobotFile::builtin_f1().unwrap();
    robot.drives = Some(DriveKeys {
        bias_permille: 200,
        backlash_um: 20.0,
        friction_n: 30.0,
        ..DriveKeys::default()
    });
    allocates_nothing(Server::<6, F1_MOTORS>::start(&robot, Transport::Stream));
}

/// With keys: a session, forgeries from the owner's address, Hellos of strangers.
#[test]
fn nor_does_it_with_keys() {
    let robot = RobotFile::builtin_l2().unwrap();
    let key = || Key::new(&[1; 32], Role::Control);
    let mut keyring = Keyring::new(&[2; 32]);
    keyring.add(key()).unwrap();
    let mut server = Server::<3, L2_MOTORS>::keyed(&robot, Transport::Datagram, Some(keyring));
    let [socket, stranger] = [(); 2].map(|()| {
        let socket = UdpSocket::bind(LOOPBACK).unwrap();
        socket.connect(server.cycle.address().unwrap()).unwrap();
        socket.set_nonblocking(true).unwrap();
        socket
    });
    let requirements = Requirements::default();
    let mut owner = client::Client::<3>::keyed(Transport::Datagram, requirements, key(), [3; 16]);
    let foreign = Key::new(&[4; 32], Role::Control);
    let mut other = client::Client::<3>::keyed(Transport::Datagram, requirements, foreign, [5; 16]);
    let foreign = other.hello().unwrap();
    socket.send(&owner.hello().unwrap()).unwrap();
    let mut buffer = [0; 1_000];
    let mut obtained = 0;
    wait_for("three hundred ticks of Obtain", || {
        while let Ok(count) = socket.recv(&mut buffer) {
            let event = owner.feed(&buffer[..count]).poll_event();
            if event == Some(Ok(Event::Challenged)) {
                socket.send(&owner.hello().unwrap()).unwrap();
            }
        }
        stranger.send(&foreign).unwrap();
        if let Some(answer) = owner.answer(Mode::Obtain, &[Offsets::ZERO; 3]) {
            let mut forged = answer.frame.to_vec();
            if let Some(last) = forged.last_mut() {
                *last ^= 1;
            }
            for _ in 0..5 {
                socket.send(&forged).unwrap();
            }
            socket.send(&answer.frame).unwrap();
        }
        obtained += u32::from(server.tick(false).state.phase == Phase::Obtain);
        obtained == 300
    });
}

/// Datagrams of the owner, of others, broken and empty ones.
#[test]
fn nor_does_it_over_udp() {
    let robot = RobotFile::builtin_l2().unwrap();
    let mut server = Server::<3, L2_MOTORS>::start(&robot, Transport::Datagram);
    let address = server.cycle.address().unwrap();
    let [mut owner, mut others @ ..]: [_; 9] =
        std::array::from_fn(|_| Client::<3>::over_datagrams(address));
    owner.say_hello();
    wait_for("the Welcome", || server.tick(false).welcomed);
    owner.welcome();
    let mut noise = Noise::new(7);
    let mut row = server.tick(false);
    for tick in 0..300 {
        let other = &mut others[tick % 8];
        other.say_hello();
        if tick % 2 == 0 {
            // Noise behind the Hello costs the other its place.
            other.send_bytes(&noise.bytes(tick));
        }
        owner.send_bytes(&noise.bytes(tick % 3));
        owner.tick = row.state.tick;
        let answer = owner.frame(Mode::Submit, [0; 3]);
        owner.send_bytes(&answer);
        row = server.tick(false);
    }
    let counters = row.state.counters;
    assert!(counters.malformed > 100, "{counters:?}");
    assert_eq!(row.state.phase, Phase::Submit);
    assert_eq!(
        others[1].receive(),
        Some(ServerMessage::Refusal(Refusal::Busy))
    );
    owner.send_bytes(&[]);
    wait_for("the silence's end", || server.tick(false).ended.is_some());
}

fn allocates_nothing<const N: usize, const M: usize>(mut server: Server<N, M>) {
    for _ in 0..50 {
        server.tick(false);
    }
    let mut client = Client::<N>::connect(server.cycle.address().unwrap());
    client.say_hello();
    wait_for("the Welcome", || server.tick(false).welcomed);
    client.welcome();
    client.state();
    for _ in 0..10 {
        server.answered(&mut client, Mode::Submit, 1_000);
    }
    let pull = Load {
        step: 1,
        force_n: [200.0, 0.0, 0.0],
        moment_nm: [0.0; 3],
    };
    server.hand.set(&pull).unwrap();
    let mut noise = Noise::new(5);
    let mut crowd = Vec::new();
    let mut readers = Vec::new();
    for tick in 0..300 {
        // Readers come, up to one more than there are places, and are gone.
        if tick % 50 < 30 {
            readers.extend((tick % 10 == 0).then(|| TcpStream::connect(server.port).unwrap()));
        } else {
            readers.clear();
        }
        if tick % 10 == 0 {
            let mut other = Client::<N>::connect(server.cycle.address().unwrap());
            if tick % 20 == 0 {
                other.say_hello();
            } else {
                other.send_bytes(&noise.bytes(9_000));
            }
            crowd.push(other);
        }
        let row = server.answered(&mut client, Mode::Obtain, 100 * (tick % 50));
        assert_eq!(row.state.phase, Phase::Obtain);
    }
    crowd.clear();
    let row = server.tick(false);
    let tool = row.tool.unwrap();
    assert!(tool.displacement_m[0] > 1e-5, "without a pull: {tool:?}");
    let shown = row.state.sensor.unwrap().to_si();
    assert!((shown[0] - tool.sensor[0]).abs() <= 0.6e-3);
    drop(client);
    let mut cause = None;
    wait_for("the ramp", || {
        let row = server.tick(false);
        cause = cause.or(row.ended);
        row.state.phase == Phase::Listening
    });
    assert!(matches!(cause, Some(Cause::Closed | Cause::ClientLate)));
    // Its black box has been handed over meanwhile, or is not yet frozen.
    let mut window = None;
    wait_for("the black box", || {
        server.tick(false);
        window = server.black_boxes.receive();
        window.is_some()
    });
    assert_eq!(window.unwrap().end().cause, cause);
    assert_eq!(server.tick(true).ended, Some(Cause::Stop));
    assert_eq!(server.tick(false).state.phase, Phase::Listening);
}
