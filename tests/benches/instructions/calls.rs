//! The calls that are counted, each once, each in a function of its own that is not inlined.

use std::hint::black_box;

use crate::setup::{a_command, l2, l2_compensator, load, on_time, six, six_compensator};
use gantry_tau_core::control::endpoint::Endpoint;
use gantry_tau_core::control::message::ClientMessage;
use gantry_tau_core::control::session::{BlackBox, Connection, Event, Input, Output, Session, TickInput};
use gantry_tau_core::control::wire::{
    ContentError, Deframer, Feed, Frame, FrameBytes, decode_client, encode_client, encode_state,
};
use gantry_tau_core::model::compensation::Correction;
use gantry_tau_core::model::kinematics::{KinematicsError, Pose, Solution, WARM_ITERATIONS};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::model::{f1, l2};
use gantry_tau_core::units::{EpochRange, PositionNm};
use gantry_tau_proofs::robots;
use nalgebra::{Matrix3, SMatrix, Vector3};

/// A counted call, and its limit.
pub(crate) struct Call {
    pub(crate) name: &'static str,
    pub(crate) limit: Option<u64>,
    run: fn(),
}

const fn call(name: &'static str, limit: Option<u64>, run: fn()) -> Call {
    Call { name, limit, run }
}

pub(crate) const CALLS: &[Call] = &[
    call("nominal_inverse", Some(150), nominal_inverse),
    call("nominal_forward", Some(230), nominal_forward),
    call("nominal_jacobian", None, nominal_jacobian),
    call("l2_statics", None, l2_statics),
    call("l2_compensation", Some(1_000), l2_compensation),
    call("six_inverse", None, six_inverse),
    call("six_forward_warm", Some(5_000), six_forward_warm),
    call("six_jacobian", None, six_jacobian),
    call("six_compensation", None, six_compensation),
    call("session_tick", None, session_tick),
    call("server_tick", None, server_tick),
    call("encode_command", None, encode_command),
    call("encode_state", None, encode_a_state),
    call("decode_command", None, decode_command),
    call("deframe_command", None, deframe_command),
];

/// Makes the call of this name.
pub(crate) fn run(name: &str) {
    let call = CALLS.iter().find(|call| call.name == name);
    (call.unwrap_or_else(|| panic!("no call is named {name}")).run)();
}

fn nominal_inverse() {
    #[inline(never)]
    fn measured_nominal_inverse(nominal: &l2::Kinematics, tcp: &Vector3<f64>) -> Result<[f64; 3], KinematicsError> {
        nominal.inverse(tcp)
    }
    let (nominal, tcp, _) = l2();
    black_box(measured_nominal_inverse(black_box(&nominal), black_box(&tcp))).unwrap();
}

fn nominal_forward() {
    #[inline(never)]
    fn measured_nominal_forward(nominal: &l2::Kinematics, q: &[f64; 3]) -> Result<Vector3<f64>, KinematicsError> {
        nominal.forward(q)
    }
    let (nominal, _, q) = l2();
    black_box(measured_nominal_forward(black_box(&nominal), black_box(&q))).unwrap();
}

fn nominal_jacobian() {
    #[inline(never)]
    fn measured_nominal_jacobian(
        nominal: &l2::Kinematics,
        tcp: &Vector3<f64>,
    ) -> Result<Matrix3<f64>, KinematicsError> {
        nominal.jacobian(tcp)
    }
    let (nominal, tcp, _) = l2();
    black_box(measured_nominal_jacobian(black_box(&nominal), black_box(&tcp))).unwrap();
}

fn l2_statics() {
    #[inline(never)]
    fn measured_l2_statics(
        robot: &l2::Robot,
        pose: &Pose,
        q: &[f64; 3],
        load: &Wrench,
    ) -> Result<[f64; 3], KinematicsError> {
        let lines = robot.line_matrix(pose, q)?;
        Ok(lines.cart_loads(&lines.link_forces_n(load)?))
    }
    let (robot, _) = robots::l2(robots::l2_geometry()).unwrap();
    let (_, tcp, q) = l2();
    let pose = Pose::at(tcp);
    let loads = measured_l2_statics(black_box(&robot), black_box(&pose), black_box(&q), black_box(&load()));
    black_box(loads).unwrap();
}

fn l2_compensation() {
    #[inline(never)]
    fn measured_l2_compensation(
        compensator: &l2::Compensator,
        nominal: &[PositionNm; 3],
        load: &Wrench,
    ) -> Result<Correction<3>, KinematicsError> {
        compensator.correct(nominal, load)
    }
    let (compensator, nominal) = l2_compensator();
    black_box(measured_l2_compensation(black_box(&compensator), black_box(&nominal), black_box(&load()))).unwrap();
}

fn six_inverse() {
    #[inline(never)]
    fn measured_six_inverse(
        kinematics: &f1::Kinematics,
        pose: &Pose,
        seed: Option<[f64; 3]>,
    ) -> Result<Solution<[f64; 6]>, KinematicsError> {
        kinematics.inverse(pose, seed)
    }
    let (kinematics, _, q, before) = six();
    let [.., q4, q5, q6] = q;
    let seed = Some([q4, q5, q6]);
    black_box(measured_six_inverse(black_box(&kinematics), black_box(&before), black_box(seed))).unwrap();
}

fn six_forward_warm() {
    #[inline(never)]
    fn measured_six_forward_warm(
        kinematics: &f1::Kinematics,
        q: &[f64; 6],
        before: &Pose,
    ) -> Result<Solution<Pose>, KinematicsError> {
        kinematics.forward_from(q, before, WARM_ITERATIONS)
    }
    let (kinematics, _, q, before) = six();
    let solved = measured_six_forward_warm(black_box(&kinematics), black_box(&q), black_box(&before)).unwrap();
    assert!(solved.iterations == 2 && solved.residual_m < 1e-10, "{solved:?}");
}

fn six_jacobian() {
    #[inline(never)]
    fn measured_six_jacobian(
        kinematics: &f1::Kinematics,
        pose: &Pose,
        q: &[f64; 6],
    ) -> Result<SMatrix<f64, 6, 6>, KinematicsError> {
        kinematics.line_matrix(pose, q)?.jacobian()
    }
    let (kinematics, pose, q, _) = six();
    black_box(measured_six_jacobian(black_box(&kinematics), black_box(&pose), black_box(&q))).unwrap();
}

fn six_compensation() {
    #[inline(never)]
    fn measured_six_compensation(
        compensator: &f1::Compensator,
        pose: &Pose,
        q: &[f64; 6],
        load: &Wrench,
    ) -> Result<Correction<6>, KinematicsError> {
        compensator.correct_at(pose, q, load)
    }
    let (compensator, pose, q) = six_compensator();
    let correction =
        measured_six_compensation(black_box(&compensator), black_box(&pose), black_box(&q), black_box(&load()));
    black_box(correction).unwrap();
}

/// One command in, one state out: read, decided, moved, recorded, written.
#[inline(never)]
fn measured_server_tick(
    endpoint: &mut Endpoint<6, 9>,
    recorder: &mut BlackBox<6, 64>,
    connection: Connection,
    bytes: &[u8],
    input: &TickInput<6>,
) {
    endpoint.feed(connection, bytes);
    black_box(endpoint.tick_recorded(input, recorder));
    while let Some((_, bytes)) = endpoint.poll_transmit() {
        black_box(bytes);
    }
}

fn server_tick() {
    let (mut server, command) = a_command();
    let bytes = encode_client(&ClientMessage::Command(command));
    let cycle = on_time();
    measured_server_tick(
        black_box(&mut server.endpoint),
        black_box(&mut *server.black_box),
        server.connection,
        black_box(&bytes),
        black_box(&cycle),
    );
}

/// One command in, one state out, as messages: what the bytes of [`server_tick`] are wrapped around.
fn session_tick() {
    #[inline(never)]
    fn measured_session_tick(session: &mut Session<6>, input: &Input<6>) -> Output<6> {
        session.tick(input)
    }
    let (server, command) = a_command();
    let mut session = *server.endpoint.session();
    let mut input = Input::empty(EpochRange::VOLATILE);
    input.tick = on_time();
    let event = Event::Message(ClientMessage::Command(command));
    input.events.push((server.connection, event)).unwrap();
    let output = measured_session_tick(black_box(&mut session), black_box(&input));
    assert_eq!(black_box(output).state.accepted, command.sequence);
}

fn encode_command() {
    #[inline(never)]
    fn measured_encode_command(message: &ClientMessage<6>) -> FrameBytes {
        encode_client(message)
    }
    let message = ClientMessage::Command(a_command().1);
    black_box(measured_encode_command(black_box(&message)));
}

fn encode_a_state() {
    #[inline(never)]
    fn measured_encode_state(state: &gantry_tau_core::control::message::State<6>) -> FrameBytes {
        encode_state(state)
    }
    let (mut server, command) = a_command();
    server.endpoint.feed(server.connection, &encode_client(&ClientMessage::Command(command)));
    let _ = server.endpoint.tick(&on_time());
    let state = server.endpoint.output().unwrap().state;
    black_box(measured_encode_state(black_box(&state)));
}

fn decode_command() {
    #[inline(never)]
    fn measured_decode_command(frame: &Frame<'_>) -> Result<ClientMessage<6>, ContentError> {
        decode_client(frame)
    }
    let bytes = encode_client(&ClientMessage::Command(a_command().1));
    let frame = Frame::parse(&bytes).unwrap();
    black_box(measured_decode_command(black_box(&frame))).unwrap();
}

fn deframe_command() {
    #[inline(never)]
    fn measured_deframe_command(deframer: &mut Deframer, bytes: &[u8]) -> bool {
        matches!(deframer.feed(bytes), Feed::Frame { .. })
    }
    let bytes = encode_client(&ClientMessage::Command(a_command().1));
    let mut deframer = Deframer::new();
    assert!(measured_deframe_command(black_box(&mut deframer), black_box(&bytes)));
}
