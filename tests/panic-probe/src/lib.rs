//! Links core into an image whose panic handler calls a function that does not exist. If the symbol
//! `gantry_tau_panic` is in the archive, some path of the functions below can panic (T12, second
//! leg).
#![no_std]

use core::hint::black_box;

use gantry_tau_core::control::client::Requirements;
use gantry_tau_core::control::endpoint::{Budget, Greeted};
use gantry_tau_core::control::keys::{Key, KeyId, Keyring, Role};
use gantry_tau_core::control::message::Capabilities;
use gantry_tau_core::control::pacer::{Paced, Pacer, Settings, Target};
use gantry_tau_core::control::position_loop::config::{LoopConfig, LoopValues};
use gantry_tau_core::control::position_loop::{LoopInput, PositionLoops};
use gantry_tau_core::model::compensation::{CompensatorConfig, Correction};
use gantry_tau_core::model::kinematics::{Pose, WARM_ITERATIONS};
use gantry_tau_core::model::load_filter::Notch;
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::sensor::{ForceSensor, Reading, SensorConfig};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::model::{f1, l2};
use gantry_tau_core::{
    BlackBox, Client, Config, Connection, Endpoint, EpochRange, Limits, Mode, Monitor, MotorMap,
    OffsetNm, Offsets, Parameters, PositionNm, Session, Start, State, Tick, TickInput, Transport,
    Write,
};
use nalgebra::{Matrix3, Vector3};

unsafe extern "C" {
    fn gantry_tau_panic() -> !;
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    // SAFETY: never linked into a program; the symbol only marks that a panic is reachable.
    unsafe { gantry_tau_panic() }
}

/// The server side on six axes: start, open, feed, tick, poll, close, and the black box.
#[unsafe(no_mangle)]
pub extern "C" fn server(
    parameters: &Parameters<6>,
    start: &Start<6>,
    bytes: &[u8; 64],
    input: &TickInput<6>,
) -> i64 {
    serve(parameters, start, bytes, input).unwrap_or(0)
}

fn serve(
    parameters: &Parameters<6>,
    start: &Start<6>,
    bytes: &[u8; 64],
    input: &TickInput<6>,
) -> Option<i64> {
    let session = Session::new(Config::new(*parameters).ok()?, start).ok()?;
    let motors = MotorMap::<6, 9>::new([0, 0, 1, 1, 2, 2, 3, 4, 5]).ok()?;
    let mut endpoint = Endpoint::new(session, EpochRange::VOLATILE);
    let mut black_box_of_ticks = BlackBox::<6, 4>::new();
    let stream = endpoint.open(Transport::Stream).ok()?;
    let datagrams = endpoint.open(Transport::Datagram).ok()?;
    endpoint.feed(stream, bytes);
    endpoint.feed(datagrams, bytes);
    endpoint.close(Connection(black_box(1)));
    let mut sum = 0_i64;
    match endpoint.tick_recorded(input, &mut black_box_of_ticks) {
        Write::Due(write) => {
            for motor in motors.spread(write.references()).iter().flatten() {
                sum = sum.wrapping_add(motor.position.0);
            }
            match black_box(0) {
                0 => write.accepted(),
                1 => write.refused(start.in_force),
                _ => write.unknown(),
            }
        }
        Write::Withheld(drives) => drives.read_back(start.in_force),
    }
    if let Some(write) = endpoint.pending() {
        write.unknown();
    }
    endpoint.note_arrival(black_box(1));
    while let Some((_, bytes)) = endpoint.poll_transmit() {
        sum = sum.wrapping_add(i64::from(bytes.first().copied().unwrap_or(0)));
    }
    while let Some(Connection(number)) = endpoint.poll_close() {
        sum = sum.wrapping_add(i64::from(number != 0));
    }
    black_box_of_ticks.release();
    Some(sum)
}

/// A server of six axes with keys: keyring, greet, open, feed, tick, poll.
#[unsafe(no_mangle)]
pub extern "C" fn keyed_server(
    parameters: &Parameters<6>,
    start: &Start<6>,
    bytes: &[u8; 128],
    secrets: &[[u8; 32]; 2],
    input: &TickInput<6>,
) -> i64 {
    serve_with_keys(parameters, start, bytes, secrets, input).unwrap_or(0)
}

fn serve_with_keys(
    parameters: &Parameters<6>,
    start: &Start<6>,
    bytes: &[u8; 128],
    [secret, of_start]: &[[u8; 32]; 2],
    input: &TickInput<6>,
) -> Option<i64> {
    let session = Session::new(Config::new(*parameters).ok()?, start).ok()?;
    let mut keyring = Keyring::new(of_start);
    keyring.add(Key::new(secret, Role::Control)).ok()?;
    keyring.add(Key::new(of_start, Role::Read)).ok()?;
    let mut endpoint = Endpoint::keyed(session, EpochRange::VOLATILE, keyring, Budget::default());
    let mut sum = 0_i64;
    let (peer, datagram) = bytes.split_first_chunk()?;
    match endpoint.greet(peer, datagram) {
        Greeted::Nothing => {}
        Greeted::Answer(frame) => sum = i64::from(frame.first().copied().unwrap_or(0)),
        Greeted::Peer(connection) => sum = i64::from(endpoint.feed(connection, bytes)),
    }
    let stream = endpoint.open(Transport::Stream).ok()?;
    endpoint.feed(stream, bytes);
    if let Write::Due(write) = endpoint.tick(input) {
        write.accepted();
    }
    endpoint.feed(stream, bytes);
    while let Some((_, bytes)) = endpoint.poll_transmit() {
        sum = sum.wrapping_add(i64::from(bytes.first().copied().unwrap_or(0)));
    }
    let id = endpoint.granted_key().map_or(0, |KeyId([first, ..])| first);
    Some(sum.wrapping_add(i64::from(id)))
}

/// A client with a key.
#[unsafe(no_mangle)]
pub extern "C" fn keyed_client(bytes: &[u8; 500], secret: &[u8; 32], nonce: &[u8; 16]) -> i64 {
    let key = Key::new(secret, Role::Control);
    let transport = if black_box(0) == 0 {
        Transport::Stream
    } else {
        Transport::Datagram
    };
    let mut client = Client::<6>::keyed(transport, Requirements::default(), key, *nonce);
    let mut sum = client.hello().map_or(0, |frame| i64::from(frame.len() > 1));
    let mut received = client.feed(bytes);
    while let Some(event) = received.poll_event() {
        sum = sum.wrapping_add(i64::from(event.is_ok()));
    }
    let frames = [
        client
            .answer(Mode::Obtain, &[Offsets::ZERO; 6])
            .map(|answer| answer.frame),
        client.goodbye(),
        client.stop(),
    ];
    for frame in frames.iter().flatten() {
        sum = sum.wrapping_add(i64::from(frame.first().copied().unwrap_or(0)));
    }
    sum
}

/// Position loops of six axes: check, start, tick.
#[unsafe(no_mangle)]
pub extern "C" fn position_loops(
    values: &[LoopValues; 6],
    inputs: &[LoopInput; 6],
    accepted: bool,
) -> i64 {
    run_loops(values, inputs, accepted).unwrap_or(0)
}

fn run_loops(values: &[LoopValues; 6], inputs: &[LoopInput; 6], accepted: bool) -> Option<i64> {
    let mut config = [LoopConfig::DISABLED; 6];
    for (config, values) in config.iter_mut().zip(values) {
        *config = LoopConfig::new(*values).ok()?;
    }
    let mut loops = PositionLoops::at_rest(config, [PositionNm(black_box(0)); 6]);
    let references = loops.tick(inputs, accepted);
    let sum: i64 = references
        .iter()
        .map(|axis| i64::from(axis.velocity.0))
        .sum();
    let stopped = loops
        .stop()
        .map_or(0, |(axis, _)| i64::try_from(axis).unwrap_or(0));
    Some(
        sum.wrapping_add(stopped)
            .wrapping_add(i64::from(loops.is_valid() && loops.is_at_rest())),
    )
}

/// The pacer of six axes: check, target, ticks, a new beginning.
#[unsafe(no_mangle)]
pub extern "C" fn pacer(
    limits: &[Limits<OffsetNm>; 6],
    settings: &Settings,
    target: &Target<6>,
    now: u64,
) -> i64 {
    let Ok(mut pacer) = Pacer::<6>::new(*limits, *settings, Tick(now)) else {
        return 0;
    };
    let mut sum = i64::from(pacer.push(*target).is_ok());
    for passed in 1..3 {
        if let Paced::Targets(offsets) = pacer.tick(Tick(now.saturating_add(passed))) {
            pacer.restart(&offsets);
            for offset in offsets {
                sum = sum.wrapping_add(i64::from(offset.0));
            }
        }
    }
    sum.wrapping_add(i64::from(pacer.silent_ticks()))
}

/// The client's half of the protocol, and the monitor.
#[unsafe(no_mangle)]
pub extern "C" fn dialogue(
    bytes: &[u8; 64],
    targets: &[Offsets; 6],
    state: &State<6>,
    monitor: &mut Monitor<6>,
) -> i64 {
    let requirements = Requirements {
        capabilities: Capabilities::NONE,
        cycle_us: Some(1_000),
        kinematics_checksum: Some(black_box(0)),
    };
    let mut client = Client::<6>::new(Transport::Stream, requirements);
    let hello = client.hello();
    let mut received = client.feed(bytes);
    let (event, left) = (received.poll_event(), received.left());
    let answer = client.answer(Mode::Obtain, targets);
    let goodbye = client.goodbye();
    let told = [hello, goodbye, client.stop()];
    let sent = told
        .iter()
        .flatten()
        .map(|frame| frame.len())
        .sum::<usize>();
    let checked = monitor.check_state(state).is_ok();
    let heard = event.is_some_and(|event| event.is_ok())
        && answer.is_some_and(|answer| answer.is_saturated());
    i64::try_from(sent.wrapping_add(left)).unwrap_or(0) + i64::from(checked && heard)
}

/// Compensation: validate, tare, filter, compensate.
#[unsafe(no_mangle)]
pub extern "C" fn client(
    geometry: &l2::Geometry,
    compliances: &[f64; 9],
    mounting: &SensorConfig,
    platform: &Matrix3<f64>,
    gain: f64,
    raw: &[f64; 6],
    q: &[f64; 3],
    nominal: &[PositionNm; 3],
    tcp_m: &Vector3<f64>,
) -> f64 {
    compensate(
        geometry,
        compliances,
        mounting,
        platform,
        gain,
        raw,
        q,
        nominal,
        tcp_m,
    )
    .unwrap_or(0.0)
}

fn compensate(
    geometry: &l2::Geometry,
    compliances: &[f64; 9],
    mounting: &SensorConfig,
    platform: &Matrix3<f64>,
    gain: f64,
    raw: &[f64; 6],
    q: &[f64; 3],
    nominal: &[PositionNm; 3],
    tcp_m: &Vector3<f64>,
) -> Option<f64> {
    let [a, b, c, d, e, f, x, y, z] = *compliances;
    let robot = l2::Robot::new(*geometry).ok()?;
    let compliances = Compliances::new([a, b, c, d, e, f], [x, y, z]).ok()?;
    let kinematics = l2::Kinematics::new(&robot, &Matrix3::identity()).ok()?;
    let config = CompensatorConfig {
        gain,
        limits: [Default::default(); 3],
        metres_per_q: [1.0; 3],
    };
    let compensator = l2::Compensator::new(&kinematics, &compliances, config).ok()?;
    let mut sensor = ForceSensor::new(*mounting).ok()?;
    let notch = Notch { hz: gain, q: gain };
    sensor.set_notches(&[Some(notch), None, Some(notch)]).ok()?;
    let reading = sensor.update(&Wrench::from_array(*raw), platform).ok()?;
    let Reading::Load(load) = reading else {
        return None;
    };
    let inverse = kinematics.inverse(tcp_m).map_or(0.0, |q| q.iter().sum());
    let jacobian = kinematics.jacobian(tcp_m).map_or(0.0, |j| j.sum());
    let correction = compensator.correct(nominal, &load);
    let exact = compensator.correct_exact_at(&Pose::at(*tcp_m), q, &load);
    let in_q = compensator.correct_q(q, &load);
    Some(
        inverse
            + jacobian
            + [correction, in_q, exact]
                .iter()
                .flatten()
                .map(metres)
                .sum::<f64>(),
    )
}

/// All of a correction, so that none of it is left out.
fn metres<const N: usize>(correction: &Correction<N>) -> f64 {
    let offsets = correction.offsets.iter();
    offsets.map(|offset| offset.to_metres().0).sum()
}

/// Everything the client side does with six axes: validate, inverse, forward with and without a
/// seed, statics, compensate.
#[unsafe(no_mangle)]
pub extern "C" fn client_of_six(
    geometry: &f1::Geometry,
    compliances: &[[f64; 6]; 2],
    raw: &[f64; 6],
    q: &[f64; 6],
    nominal: &[PositionNm; 6],
    seed: &Pose,
    metres_per_q: &[f64; 6],
) -> f64 {
    compensate_six(geometry, compliances, raw, q, nominal, seed, metres_per_q).unwrap_or(0.0)
}

fn compensate_six(
    geometry: &f1::Geometry,
    compliances: &[[f64; 6]; 2],
    raw: &[f64; 6],
    q: &[f64; 6],
    nominal: &[PositionNm; 6],
    seed: &Pose,
    metres_per_q: &[f64; 6],
) -> Option<f64> {
    let robot = f1::Robot::new(*geometry).ok()?;
    let [links, axes] = *compliances;
    let compliances = Compliances::new(links, axes).ok()?;
    let kinematics = f1::Kinematics::new(&robot);
    let mut tracker = f1::PoseTracker::default();
    tracker.last = Some(*seed);
    let pose = tracker.track(&kinematics, q).ok()?;
    let there = kinematics.inverse(&pose.value, None).ok()?;
    let [.., q4, q5, q6] = there.value;
    let (place, near) = (&pose.value.position_m, &seed.rotation);
    let fixed = kinematics.inverse_fixed_plates(place, &[q4, q5, q6], near, WARM_ITERATIONS);
    let load = Wrench::from_array(*raw);
    let config = CompensatorConfig {
        gain: 1.0,
        limits: [Default::default(); 6],
        metres_per_q: *metres_per_q,
    };
    let mut compensator =
        f1::Compensator::new(&kinematics.without_travel(), &compliances, config).ok()?;
    let lines = kinematics.line_matrix(&pose.value, &there.value);
    let jacobian = lines
        .and_then(|lines| Ok(lines.jacobian()? + kinematics.jacobian(&pose.value, &there.value)?));
    let compliance = lines.and_then(|lines| lines.compliance(&compliances));
    let correction = compensator.correct(nominal, &load);
    let at =
        lines.and_then(|lines| compensator.correct_of(&lines, &pose.value, &there.value, &load));
    let at = at.or(compensator.correct_at(&pose.value, &there.value, &load));
    let exact = compensator.correct_exact_at(&pose.value, &there.value, &load);
    let sum = f64::from(kinematics.checksum(metres_per_q))
        + jacobian.map_or(0.0, |jacobian| jacobian.sum())
        + compliance.map_or(0.0, |compliance| compliance.0.sum())
        + fixed.map_or(0.0, |fixed| fixed.value.0.iter().sum())
        + [correction, at, exact]
            .iter()
            .flatten()
            .map(metres)
            .sum::<f64>();
    Some(sum)
}

/// The negative control: a panic that is linked.
#[cfg(feature = "control")]
#[unsafe(no_mangle)]
pub extern "C" fn control(values: &[i64; 4], index: usize) -> i64 {
    values[index]
}
