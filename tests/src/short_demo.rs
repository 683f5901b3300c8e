//! The demo, as short as it still shows something: two force steps, in lock-step.

use std::path::Path;

use gantry_tau::demo::{DemoOptions, Loops, PaceChoice, run_on};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::Plant;
use gantry_tau_server::server::tick_source::TickSource;
use gantry_tau_sim::load_generator::AppliedLoad;
use gantry_tau_system::output::{Kind, Output};

/// Runs the demo on the machine that `build` makes, with its report in a folder. Returns what is not
/// as it should be.
///
/// # Panics
/// The demo does not run to its end.
pub fn complaints<K, P, E, const N: usize, const M: usize>(
    folder: &Path,
    robot: RobotFile<K, N>,
    build: impl Fn(&RobotFile<K, N>, AppliedLoad) -> Result<P, E>,
    loops: Loops<N, M, P>,
) -> Vec<String>
where
    K: MachineKind<N>,
    P: Plant<N, M> + 'static,
    E: std::error::Error,
{
    let report = folder.join("demo.html");
    let options = DemoOptions {
        key: None,
        client: robot.clone(),
        // The machines that are built here have none.
        robot: RobotFile {
            masses: None,
            ..robot
        },
        pace: PaceChoice::Only(TickSource::Lockstep),
        force_max_n: 120.0,
        force_step_n: 60.0,
        // Five times as long as the slower filter takes.
        step_seconds: 1.0,
        report: Output::new(&*report, Kind::Page),
        json: None,
        record: None,
        black_box: None,
    };
    run_on(&options, build, loops).unwrap().complaints
}
