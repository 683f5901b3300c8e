//! The demo, as short as it still shows something: two force steps, in lock-step.

use std::sync::atomic::{AtomicU32, Ordering};

use gantry_tau::demo::{DemoOptions, PaceChoice, run_on};
use gantry_tau::model::MachineKind;
use gantry_tau::output::{Kind, Output};
use gantry_tau::plant::Plant;
use gantry_tau::robot_file::RobotFile;
use gantry_tau::server::tick_source::TickSource;
use gantry_tau::sim::load_generator::AppliedLoad;

/// Runs the demo on the machine that `build` makes. Returns what is not as it should be.
///
/// # Panics
/// The demo does not run to its end.
pub fn complaints<K, P, E, const N: usize, const M: usize>(
    robot: RobotFile<K, N>,
    build: impl Fn(&RobotFile<K, N>, AppliedLoad) -> Result<P, E>,
) -> Vec<String>
where
    K: MachineKind<N>,
    P: Plant<N, M> + 'static,
    E: std::error::Error,
{
    static RUNS: AtomicU32 = AtomicU32::new(0);
    let run = RUNS.fetch_add(1, Ordering::Relaxed);
    let report = std::env::temp_dir().join(format!("gantry-tau-short-demo-{}-{run}.html", std::process::id()));
    let options = DemoOptions {
        robot,
        client: None,
        pace: PaceChoice::Only(TickSource::Lockstep),
        force_max_n: 120.0,
        force_step_n: 60.0,
        step_seconds: 0.2,
        report: Output::new(&*report, Kind::Page),
        json: None,
        record: None,
        black_box: None,
    };
    let results = run_on(&options, build);
    std::fs::remove_file(&report).unwrap();
    results.unwrap().complaints
}
