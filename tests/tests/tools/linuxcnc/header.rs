//! The header of `gantry-tau header`: it compiles without a warning, and the C interface finds the
//! same machine in it.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use gantry_tau::header::{HeaderOptions, Prefix, run as write_header};
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::units::{Metres, PositionNm};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile};
use gantry_tau_system::output::{Kind, Output};
use libtest_mimic::Failed;

use crate::capi::STRICT;
use crate::capi::tools::{assert_lines, folder, library, run, target};

pub(super) fn compiles() -> Result<(), Failed> {
    for name in ["l2", "f1"] {
        let robot = AnyRobotFile::named(name).unwrap();
        let place = target().join(format!("header-{name}"));
        std::fs::create_dir_all(&place)?;
        write_header(&HeaderOptions {
            robot: robot.clone(),
            prefix: Prefix::default(),
            output: Output::new(place.join("machine.h"), Kind::Header),
        })?;
        let program = place.join("header");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tools/linuxcnc/header.c");
        let mut command = Command::new("gcc");
        command
            .args(STRICT)
            .arg("-I")
            .arg(folder().join("include"))
            .arg("-I")
            .arg(&place)
            .arg(source)
            .arg(library());
        run(command
            .args(["-lm", "-Wl,--gc-sections", "-o"])
            .arg(&program))?;
        let expected = match &robot {
            AnyRobotFile::L2(robot) => machine(robot),
            AnyRobotFile::F1(robot) => machine(robot),
        };
        assert_lines(&run(&mut Command::new(program))?, &expected);
    }
    Ok(())
}

/// The machine, as the C program prints it.
fn machine<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) -> String {
    let checksum = robot.checksum();
    let mut text = format!("{} {checksum:08x} {checksum:08x}\n", robot.name);
    let home = robot.model.axes_at(&robot.home_m()).unwrap();
    for (axis, limits) in robot.limits.iter().enumerate() {
        let metres = robot.metres_per_q[axis];
        let home = PositionNm::from_metres(Metres(home[axis] * metres))
            .unwrap()
            .0;
        let (nominal, machine) = (limits.nominal_travel, limits.machine_travel);
        writeln!(
            text,
            "axis {home}, {:x}, {} to {} in {} to {} by {}{}{}{}",
            metres.to_bits(),
            nominal.lower.0,
            nominal.upper.0,
            machine.lower.0,
            machine.upper.0,
            limits.nominal_step_nm,
            channel(&limits.limits.position),
            channel(&limits.limits.velocity),
            channel(&limits.limits.torque),
        )
        .unwrap();
    }
    for axis in &robot.motors.axis_of_motor {
        writeln!(text, "motor {axis}").unwrap();
    }
    text
}

fn channel<U>(limits: &Limits<U>) -> String {
    format!(
        ", {} {} {} {}",
        limits.max(),
        limits.step(),
        limits.accel(),
        limits.ramp()
    )
}
