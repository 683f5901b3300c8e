//! The machines and the server that the calls are made on.

use gantry_tau_core::control::axis::{Offsets, Reference};
use gantry_tau_core::control::endpoint::{Endpoint, MotorMap, Transport};
use gantry_tau_core::control::message::{ClientMessage, Command, Mode, Phase};
use gantry_tau_core::control::session::config::{AxisConfig, Config, Parameters, Travel};
use gantry_tau_core::control::session::recorder::SEGMENTS;
use gantry_tau_core::control::session::{BlackBox, Connection, Session, Start, TickInput};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::model::compensation::CompensatorConfig;
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::linalg::rotation_from_vector;
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::model::{f1, l2};
use gantry_tau_core::units::{EpochRange, Metres, OffsetNm, PositionNm, Sequence};
use gantry_tau_core::verification::control::Internals;
use gantry_tau_proofs::robots;
use gantry_tau_tests::client::hello;
use gantry_tau_tests::server_fixture;
use nalgebra::Vector3;

pub(crate) fn l2() -> (l2::Kinematics, Vector3<f64>, [f64; 3]) {
    let (_, nominal) = robots::l2(robots::l2_geometry()).unwrap();
    let tcp = Vector3::new(0.0, 0.5, 0.65);
    let q = nominal.inverse(&tcp).unwrap();
    (nominal, tcp, q)
}

pub(crate) fn load() -> Wrench {
    Wrench::from_array([300.0, -50.0, 100.0, 1.0, 2.0, -1.0])
}

fn config<const N: usize>() -> CompensatorConfig<N> {
    CompensatorConfig {
        gain: 1.0,
        limits: [OffsetNm(2_000_000); N],
        metres_per_q: [1.0; N],
    }
}

/// The F1 in a pose, and the pose of a cycle before at 1 m/s and 1 rad/s.
pub(crate) fn six() -> (f1::Kinematics, Pose, [f64; 6], Pose) {
    six_from(1e-3)
}

/// The F1 in a pose, and one that is `distance` away, in metres and in radians.
pub(crate) fn six_from(distance: f64) -> (f1::Kinematics, Pose, [f64; 6], Pose) {
    let kinematics = robots::f1(robots::f1_geometry()).unwrap();
    let pose = Pose {
        position_m: Vector3::new(0.1, -0.1, 0.4),
        rotation: rotation_from_vector(&Vector3::new(0.02, -0.15, 0.2)).unwrap(),
    };
    let q = kinematics.inverse(&pose, None).unwrap().value;
    let third = distance / 3.0_f64.sqrt();
    let turn = rotation_from_vector(&Vector3::new(third, third, -third)).unwrap();
    let before = Pose {
        position_m: pose.position_m + Vector3::new(third, -third, third),
        rotation: turn * pose.rotation,
    };
    (kinematics, pose, q, before)
}

/// Ticks of a segment of the black box.
const HALF: usize = 4;

/// A server in Obtain.
pub(crate) struct Server<const N: usize, const MOTORS: usize> {
    pub(crate) endpoint: Endpoint<N>,
    pub(crate) motors: MotorMap<N, MOTORS>,
    pub(crate) black_box: Box<BlackBox<N, HALF>>,
    pub(crate) connection: Connection,
    sequence: u64,
}

impl<const N: usize, const MOTORS: usize> Server<N, MOTORS> {
    /// A server whose motors drive these axes.
    pub(crate) fn in_obtain(motors: [usize; MOTORS]) -> Self {
        let limits = server_fixture::limits(2_000_000, 5_000, 10_000, 100);
        let axis = AxisConfig::position_only(limits, Travel::around_zero(1_000_000_000), 2_000_000);
        let config = Config::new(Parameters::thesis([axis; N])).unwrap();
        let session = Session::new(config, &Start::at_rest([PositionNm(0); N])).unwrap();
        let motors = MotorMap::new(motors).unwrap();
        let mut endpoint = Endpoint::new(session, EpochRange::VOLATILE);
        let connection = endpoint.open(Transport::Stream).unwrap();
        let mut server = Self {
            endpoint,
            motors,
            black_box: Box::new(BlackBox::new()),
            connection,
            sequence: 0,
        };
        server.cycle(&encode_client(&hello::<N>()));
        // Until the black box has been full once, as it is for the life of a server but its first
        // moments.
        let obtain = std::iter::repeat_n(Mode::Obtain, SEGMENTS * HALF);
        for mode in std::iter::once(Mode::Submit).chain(obtain) {
            let command = server.command(mode);
            server.cycle(&encode_client(&ClientMessage::Command(command)));
        }
        assert_eq!(server.endpoint.session().phase(), Phase::Obtain);
        server
    }

    pub(crate) fn command(&mut self, mode: Mode) -> Command<N> {
        self.sequence += 1;
        let discrete = &self.endpoint.session().parts().discrete;
        let target = Offsets {
            position: OffsetNm(123_456),
            ..Offsets::default()
        };
        Command {
            epoch: discrete.epoch,
            sequence: Sequence(self.sequence),
            echo: discrete.tick,
            mode,
            targets: [target; N],
        }
    }

    pub(crate) fn cycle(&mut self, bytes: &[u8]) {
        self.endpoint.feed(self.connection, bytes);
        self.tick(&on_time());
    }

    /// Ticks; the motors take their references.
    pub(crate) fn tick(&mut self, input: &TickInput<N>) -> [Reference; MOTORS] {
        let write = (self.endpoint).tick_recorded(input, &mut *self.black_box);
        let references = server_fixture::taken(write);
        self.motors.spread(&references).unwrap()
    }
}

pub(crate) fn on_time<const N: usize>() -> TickInput<N> {
    server_fixture::on_time([PositionNm(0); N])
}

/// A server of six axes and nine motors in Obtain, and the next command of its client.
pub(crate) fn a_command() -> (Server<6, 9>, Command<6>) {
    let mut server = Server::in_obtain([0, 0, 1, 1, 2, 2, 3, 4, 5]);
    let command = server.command(Mode::Obtain);
    (server, command)
}

pub(crate) fn l2_compensator() -> (l2::Compensator, [PositionNm; 3]) {
    let (kinematics, _, q) = l2();
    let springs = Compliances::new([5e-7; 6], [5e-8; 3]).unwrap();
    let compensator = l2::Compensator::new(&kinematics, &springs, config()).unwrap();
    (compensator, nanometres(q))
}

/// Positions of axes whose `q` is in metres.
fn nanometres<const N: usize>(q: [f64; N]) -> [PositionNm; N] {
    q.map(|q| PositionNm::from_metres(Metres(q)).unwrap())
}

pub(crate) fn six_compensator() -> (f1::Compensator, Pose, [f64; 6]) {
    let (kinematics, pose, q, _) = six();
    let springs = Compliances::new([5e-7; 6], [4e-8, 4e-8, 4e-8, 2e-6, 2e-6, 2e-6]).unwrap();
    let compensator = f1::Compensator::new(&kinematics, &springs, config()).unwrap();
    (compensator, pose, q)
}
