//! Parameters and machines for the tests of this crate.

use gantry_tau_core::model::robot::ARMS;
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{RobotFile, Simulation};
use gantry_tau_server::plant::interpolator::Motion;
pub(crate) use gantry_tau_test_support::vectors::Vectors;
use nalgebra::Vector3;

use crate::drive::Settings;
use crate::parameters::SimulationParameters;

/// Nominal compliances; no wrist.
pub(crate) fn springs<const N: usize>(vectors: &Vectors<N>) -> Springs<N> {
    Springs::rigid_wrist(vectors.compliances)
}

/// Returns a motion with these waypoints (m), speed (m/s), acceleration (m/s^2) and dwell (cycles).
pub(crate) fn motion<const N: usize>(
    waypoints_m: &[[f64; N]],
    speed: f64,
    acceleration: f64,
    dwell: u32,
) -> Motion<N> {
    Motion::BackAndForth {
        waypoints_m: waypoints_m.to_vec(),
        speed_m_per_s: speed,
        acceleration_m_per_s2: acceleration,
        dwell_cycles: dwell,
    }
}

/// Returns a machine like the thesis' `[T 4.2, 5.2]`: true springs within 15 % of the nominal ones,
/// the jump at 360 N, one metre per unit of `q`. Its home is the mean of the L2's poses: inside the
/// workspace, far from its edges.
pub(crate) fn parameters() -> SimulationParameters<ARMS> {
    let cases = Vectors::l2().cases;
    let home: Vector3<f64> = cases
        .iter()
        .map(|case| case.translation_m)
        .sum::<Vector3<f64>>()
        / cases.len() as f64;
    let robot = RobotFile::builtin_l2().unwrap();
    SimulationParameters {
        simulation: Simulation {
            seed: 1,
            spring_deviation: 0.15,
            force_noise_n: 0.5,
            moment_noise_nm: 0.02,
            acceleration_noise_m_per_s2: 0.02,
            gauge_resolution_m: 0.5e-6,
            jump_force_n: 360.0,
            jump_gap_m: 40e-6,
            home_m: home.into(),
            ..robot.simulation
        },
        drives: Settings::IDEAL,
        sensor: robot.sensor,
        home_q: robot.model.axes_at(&home).unwrap(),
        metres_per_q: [1.0; ARMS],
        motion: Motion::Hold,
    }
}
