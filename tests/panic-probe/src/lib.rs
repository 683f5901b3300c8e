//! Links core into an image whose panic handler calls a function that does not exist.
//! If the symbol `gantry_tau_panic` is in the archive, some path of the functions below can panic (T12, second leg).
#![no_std]

use core::hint::black_box;

use gantry_tau_core::control::axis::{Actual, Offsets};
use gantry_tau_core::control::endpoint::{Cycle, Endpoint, MotorMap, Transport};
use gantry_tau_core::control::session::Session;
use gantry_tau_core::control::session::config::{Config, Parameters};
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::model::compensation::{CompensatorConfig, Correction};
use gantry_tau_core::model::kinematics::{Pose, WARM_ITERATIONS};
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::sensor::{ForceSensor, Reading, SensorConfig};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::model::{f1, l2};
use gantry_tau_core::units::{Epoch, PositionNm, Tick};
use nalgebra::{Matrix3, Vector3};

unsafe extern "C" {
    fn gantry_tau_panic() -> !;
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    // SAFETY: never linked into a program; the symbol only marks that a panic is reachable.
    unsafe { gantry_tau_panic() }
}

/// Everything the server side does, on six axes: start, open, feed, tick, close.
#[unsafe(no_mangle)]
pub extern "C" fn server(
    parameters: &Parameters<6>,
    in_force: &[Offsets; 6],
    bytes: &[u8; 64],
    elapsed: u32,
) -> i64 {
    let Ok(config) = Config::new(*parameters) else {
        return 0;
    };
    let nominal = [PositionNm(black_box(0)); 6];
    let Ok(session) = Session::new(config, in_force, nominal, Tick(0), Epoch(0)) else {
        return 0;
    };
    let Ok(motors) = MotorMap::new([0, 0, 1, 1, 2, 2, 3, 4, 5]) else {
        return 0;
    };
    let mut endpoint = Endpoint::<6, 9, 4>::new(session, motors);
    let (Ok(stream), Ok(datagrams)) = (
        endpoint.open(Transport::Stream),
        endpoint.open(Transport::Datagram),
    ) else {
        return 0;
    };
    endpoint.feed(stream, bytes);
    endpoint.feed(datagrams, bytes);
    endpoint.close(Connection(black_box(1)));
    let cycle = Cycle {
        elapsed,
        nominal,
        actual: [Actual::default(); 6],
        stop: black_box(false),
        rearm: black_box(false),
        next_epoch: Epoch(black_box(1)),
        arrival_us: 0,
    };
    let mut sum = 0_i64;
    let turn = endpoint.tick(&cycle, &mut |_, bytes| {
        sum = sum.wrapping_add(i64::from(bytes.first().copied().unwrap_or(0)));
    });
    for motor in &turn.motors {
        sum = sum.wrapping_add(motor.position.0);
    }
    sum
}

/// Everything the client side does: validate, tare, filter, compensate.
#[unsafe(no_mangle)]
pub extern "C" fn client(
    geometry: &l2::Geometry,
    compliances: &[f64; 9],
    mounting: &SensorConfig,
    gain: f64,
    raw: &[f64; 6],
    q: &[f64; 3],
    nominal: &[PositionNm; 3],
    tcp_m: &Vector3<f64>,
) -> f64 {
    let [a, b, c, d, e, f, x, y, z] = *compliances;
    let Ok(robot) = l2::Robot::new(*geometry) else {
        return 0.0;
    };
    let Ok(compliances) = Compliances::new([a, b, c, d, e, f], [x, y, z]) else {
        return 0.0;
    };
    let Ok(kinematics) = l2::Kinematics::new(&robot, &Matrix3::identity()) else {
        return 0.0;
    };
    let config = CompensatorConfig {
        gain,
        limits: [Default::default(); 3],
        metres_per_q: [1.0; 3],
    };
    let Ok(compensator) = l2::Compensator::new(&kinematics, &compliances, config) else {
        return 0.0;
    };
    let Ok(mut sensor) = ForceSensor::new(*mounting) else {
        return 0.0;
    };
    let Ok(Reading::Load(load)) = sensor.update(&Wrench::from_array(*raw)) else {
        return 0.0;
    };
    let inverse = kinematics.inverse(tcp_m).map_or(0.0, |q| q.iter().sum());
    let jacobian = kinematics.jacobian(tcp_m).map_or(0.0, |j| j.sum());
    let correction = compensator.correct(nominal, &load);
    let exact = compensator.correct_exact(nominal, &load);
    let exact_at = compensator.correct_exact_at(&Pose::at(*tcp_m), q, &load);
    let in_q = compensator.correct_q(q, &load);
    inverse
        + jacobian
        + [correction, in_q, exact, exact_at]
            .iter()
            .flatten()
            .map(metres)
            .sum::<f64>()
}

/// All of a correction, so that none of it is left out.
fn metres<const N: usize>(correction: &Correction<N>) -> f64 {
    let offsets = correction.offsets.iter();
    offsets.map(|offset| offset.to_metres().0).sum()
}

/// Everything the client side does with six axes: validate, inverse, forward with and without a seed, statics, compensate.
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
    let Ok(robot) = f1::Robot::new(*geometry) else {
        return 0.0;
    };
    let [links, axes] = *compliances;
    let Ok(compliances) = Compliances::new(links, axes) else {
        return 0.0;
    };
    let kinematics = f1::Kinematics::new(&robot);
    let synchronised = kinematics.forward_synchronised(q);
    let mut tracker = f1::PoseTracker::new(&kinematics);
    tracker.start_from(seed);
    let Ok(pose) = tracker.track(q) else {
        return 0.0;
    };
    let Ok(there) = kinematics.inverse(&pose.value, None) else {
        return 0.0;
    };
    let [.., q4, q5, q6] = there.value;
    let (place, near) = (&pose.value.position_m, &seed.rotation);
    let fixed = kinematics.inverse_fixed_plates(place, &[q4, q5, q6], near, WARM_ITERATIONS);
    let load = Wrench::from_array(*raw);
    let config = CompensatorConfig {
        gain: 1.0,
        limits: [Default::default(); 6],
        metres_per_q: *metres_per_q,
    };
    let Ok(mut compensator) =
        f1::Compensator::new(&kinematics.without_travel(), &compliances, config)
    else {
        return 0.0;
    };
    let lines = kinematics.line_matrix(&pose.value, &there.value);
    let jacobian = lines.and_then(|lines| lines.jacobian());
    let stiffness = (lines.and_then(|lines| lines.compliance(&compliances)))
        .and_then(|compliance| compliance.to_stiffness());
    let exact = compensator.correct_exact(nominal, &load);
    let correction = compensator.correct(nominal, &load);
    let at = compensator.correct_at(&pose.value, &there.value, &load);
    let exact_at = compensator.correct_exact_at(&pose.value, &there.value, &load);
    f64::from(robot.kinematics_checksum())
        + synchronised.map_or(0.0, |pose| pose.position_m.sum())
        + jacobian.map_or(0.0, |jacobian| jacobian.sum())
        + stiffness.map_or(0.0, |stiffness| stiffness.0.sum())
        + fixed.map_or(0.0, |fixed| fixed.value.0.iter().sum())
        + [correction, at, exact, exact_at]
            .iter()
            .flatten()
            .map(metres)
            .sum::<f64>()
}

/// The negative control: a panic that is linked.
#[cfg(feature = "control")]
#[unsafe(no_mangle)]
pub extern "C" fn control(values: &[i64; 4], index: usize) -> i64 {
    values[index]
}
