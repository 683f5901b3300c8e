//! The demo's compensation over the emulated bus: the same limits as without it.

use gantry_tau::demo::{DemoOptions, PaceChoice, run_on};
use gantry_tau::ethercat::{EthercatPlant, emulated_bus};
use gantry_tau::model::MachineKind;
use gantry_tau::robot_file::RobotFile;
use gantry_tau::server::tick_source::TickSource;
use gantry_tau::sim::parameters::Motion;

use super::section;

fn compensates<K: MachineKind<N>, const N: usize, const M: usize>(robot: RobotFile<K, N>) {
    let report = std::env::temp_dir().join(format!("gantry-tau-ethercat-{}-{N}.html", std::process::id()));
    let options = DemoOptions {
        robot,
        client: None,
        pace: PaceChoice::Only(TickSource::Lockstep),
        force_max_n: 120.0,
        force_step_n: 60.0,
        step_seconds: 0.2,
        report: report.clone(),
        json: None,
        record: None,
        black_box: None,
    };
    let results = run_on(&options, |robot, tool| {
        let bus = emulated_bus::<_, N, M>(robot, &section(robot), tool)?;
        EthercatPlant::<_, N, M>::open(robot, &section(robot), bus, |_| Motion::Hold)
    });
    std::fs::remove_file(&report).unwrap();
    assert_eq!(results.unwrap().complaints, Vec::<String>::new());
}

#[test]
fn the_demo_ends_within_its_tolerance_on_three_axes() {
    compensates::<_, 3, 3>(RobotFile::builtin_l2().unwrap());
}

#[test]
fn the_demo_ends_within_its_tolerance_on_six_axes() {
    compensates::<_, 6, 9>(RobotFile::builtin_f1().unwrap());
}
