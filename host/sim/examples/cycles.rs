//! Times of a cycle of the simulated machines with masses on their way, a millisecond of their time.
//! Every 10 mm the damping is found again, and those cycles are the slow ones.
//!
//! ```text
//! cargo run --release -p gantry-tau-sim --example cycles
//! ```

use std::error::Error;
use std::time::{Duration, Instant};

use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::units::{TorquePermille, VelocityUmS};
use gantry_tau_machine::model::{F1_MOTORS, L2_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::Plant;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_sim::machine::SimulatedMachine;

/// Cycles that are timed.
const CYCLES: u32 = 50_000;
/// Way of each cart and back, m.
const WAY_M: f64 = 0.2;

/// Runs a machine at 0.2 m/s. Returns the times of its cycles, shortest first.
fn timed<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
) -> Result<Vec<Duration>, Box<dyn Error>> {
    let (_hand, tool) = load_generator();
    let mut to_m = robot.home_axes_m()?;
    to_m.iter_mut().take(3).for_each(|place| *place += WAY_M);
    let motion = Motion::BackAndForth {
        waypoints_m: vec![to_m],
        speed_m_per_s: 0.2,
        acceleration_m_per_s2: 1.0,
        dwell_cycles: 0,
    };
    let mut machine = SimulatedMachine::<N, M>::moving_from_robot(robot, tool, motion)?;
    let motors = robot.motor_map::<M>()?;
    let mut times = Vec::new();
    for _ in 0..CYCLES {
        let begun = Instant::now();
        let nominal = machine.read(1)?.nominal;
        let references = nominal.map(|position| Reference {
            position,
            velocity_offset: VelocityUmS(0),
            torque_offset: TorquePermille(0),
        });
        let references = motors
            .spread(&references)
            .ok_or("a motor without an axis")?;
        machine.write(&references, &nominal.map(InForce::at))?;
        times.push(begun.elapsed());
    }
    times.sort();
    Ok(times)
}

/// Prints the line of a machine.
fn print(name: &str, times: &[Duration]) {
    let all: Duration = times.iter().sum();
    let real_time = f64::from(CYCLES) * 1e-3 / all.as_secs_f64();
    let last = times.len().saturating_sub(1);
    let [median, slow, slower, slowest] = [500, 990, 999, 1_000].map(|permille| {
        let time = times.get(last.saturating_mul(permille) / 1_000);
        time.map_or(f64::NAN, Duration::as_secs_f64) * 1e6
    });
    println!("{name:8} {real_time:10.0} {median:8.1} {slow:8.1} {slower:8.1} {slowest:8.1}");
}

fn main() -> Result<(), Box<dyn Error>> {
    println!(
        "{:8} {:>10} {:>8} {:>8} {:>8} {:>8}",
        "us", "real time", "median", "99 %", "99.9 %", "slowest"
    );
    let l2 = RobotFile::builtin_l2()?;
    print("l2", &timed::<_, 3, L2_MOTORS>(&l2)?);
    let f1 = RobotFile::builtin_f1()?;
    print("f1", &timed::<_, 6, F1_MOTORS>(&f1)?);
    Ok(())
}
