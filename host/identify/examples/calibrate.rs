//! The geometry of an L2 from poses in memory, as a camera or a tracker measures them.
//!
//! ```text
//! cargo run -p gantry-tau-identify --example calibrate
//! ```
#![allow(clippy::arithmetic_side_effects, reason = "floats do not overflow")]

use std::error::Error;

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_identify::geometry::calibrate::{
    CalibrateOptions, FrameOption, GuidewaysOption, calibrate_l2_with,
};
use gantry_tau_identify::geometry::deviation::Deviating;
use gantry_tau_identify::measurements::poses::{MeasuredPose, PoseNoise, Poses};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use nalgebra::{Matrix3, Vector3};

fn main() -> Result<(), Box<dyn Error>> {
    let robot = RobotFile::builtin_l2()?;
    // In place of your machine and your device: joints and links up to 3 mm off the robot file.
    let mut phase: f64 = 0.0;
    let mut draw = || {
        phase += 2.4;
        phase.sin()
    };
    let machine = robot.model.off(3e-3, &mut draw)?;
    let mut poses = Vec::new();
    for index in 0..64_u32 {
        let step = [index % 4, index / 4 % 4, index / 16].map(|step| f64::from(step) * 0.1 - 0.15);
        let place_m = Vector3::from(robot.simulation.home_m) + Vector3::from(step);
        let q = robot.model.axes_for(&Pose::at(place_m))?;
        let noise_m = Vector3::new(draw(), draw(), draw()) * 70e-6;
        poses.push(MeasuredPose {
            name: format!("pose {index}").parse()?,
            q,
            position_m: machine.forward(&q)? + noise_m,
            rotation: None,
        });
    }
    let measured = Poses {
        model: "l2".to_owned(),
        table: "camera".to_owned(), // in messages
        crc: 0,
        noise: PoseNoise::independent(Matrix3::identity() * 50e-6_f64.powi(2), None),
        poses,
    };
    let options = CalibrateOptions {
        poses: "camera".into(),
        robot: "l2".to_owned(),
        frame: FrameOption::Nominal,
        guideways: GuidewaysOption::Free,
        target_m: None, // at the tool centre point
        tolerance_m: 1e-3,
    };
    let calibration = calibrate_l2_with(&robot, &measured, &options)?;
    println!("{}", calibration.summary);
    for doubt in &calibration.doubts {
        println!("doubt: {doubt}");
    }
    Ok(())
}
