use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::units::{TorquePermille, VelocityUmS};
use gantry_tau_machine::model::{L2, L2_MOTORS};

use super::*;
use crate::experiment::fixture::{Folder, campaign_a, plan_in};

/// Largest displacement of the tool on the first second of its way to the first pose, um.
fn bent_um(robot: &RobotFile<L2, 3>) -> f64 {
    let folder = Folder::new("campaign-machine");
    let text = campaign_a("", &[0, 240, 0]);
    let home = "T = [0.0, 0.5, 0.65]";
    assert!(text.contains(home));
    let plan = plan_in(&folder, &text.replace(home, "T = [0.1, 0.5, 0.65]"));
    let link = GaugePublisher::bind(([127, 0, 0, 1], 0).into()).unwrap();
    let mut machine = CampaignMachine::<3, L2_MOTORS>::from_robot(robot, plan, link).unwrap();
    let motors = robot.motor_map::<L2_MOTORS>().unwrap();
    let mut granted = TickRecord::<3>::listening();
    (granted.state.phase, granted.welcomed) = (Phase::Submit, true);
    machine.switch().see(&granted);
    let mut most_m: f64 = 0.0;
    for _ in 0..1_000 {
        let reading = machine.read(1).unwrap();
        let [x, y, z] = reading.tool.unwrap().displacement_m;
        most_m = most_m.max(x.hypot(y).hypot(z));
        let references = reading.nominal.map(|position| Reference {
            position,
            velocity_offset: VelocityUmS(0),
            torque_offset: TorquePermille(0),
        });
        let references = motors.spread(&references).unwrap();
        let parts = reading.nominal.map(InForce::at);
        machine.write(&references, &parts).unwrap();
    }
    most_m * 1e6
}

/// Weight is taken off at home; inertia is not: 0.6 um on a way that accelerates smoothly.
#[test]
fn a_machine_with_masses_bends_on_its_way() {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.simulation.jump_gap_m = 0.0;
    let moving_um = bent_um(&robot);
    robot.masses = None;
    let settled_um = bent_um(&robot);
    assert!(
        moving_um > 10.0 * settled_um,
        "{moving_um} and {settled_um} um"
    );
}
