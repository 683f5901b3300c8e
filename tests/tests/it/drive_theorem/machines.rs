//! The machines of which the theorem is asked.

use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::control::message::Capabilities;
use gantry_tau_core::control::session::config::Config;
use gantry_tau_identify::experiment::campaign_machine::{CampaignMachine, SessionSwitch};
use gantry_tau_identify::measurements::plan;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile, text_of};
use gantry_tau_server::links::gauges::GaugePublisher;
use gantry_tau_server::plant::Plant;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::record::TickRecord;
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_tests::fake_plant::Bus;
use gantry_tau_tests::server_fixture::{LOOPBACK, parameters};

use super::watched::{Watch, Watched};
use super::{AtDrive, Bench, Counts, Run, Trouble};

/// Ticks of a run.
const TICKS: u32 = 15_000;
const SEED: u64 = 0x7215;

/// Asks a plant of the file, in front of which writes are refused and readings fail.
fn ask<K: MachineKind<N>, P: Plant<N, M>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    plant: P,
) -> Result<Counts, String> {
    let motors = robot.motor_map::<M>().unwrap();
    let (plant, watch) = Watched::new(plant, motors, false);
    Run::new(
        robot.session_config(Capabilities::NONE).unwrap(),
        motors,
        plant,
        watch,
        SEED,
    )
    .ticks(TICKS)
}

/// A path that always moves, at most 100 nm per tick times 1 000.
fn path<const N: usize>(start_m: [f64; N]) -> Motion<N> {
    Motion::BackAndForth {
        waypoints_m: vec![start_m.map(|place| place + 0.05)],
        speed_m_per_s: 0.1,
        acceleration_m_per_s2: 1.0,
        dwell_cycles: 10,
    }
}

/// The simulated machine of a file, on that path.
fn simulated<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
) -> Result<Counts, String> {
    let (_hand, tool) = load_generator();
    let home_q = robot.home_q().unwrap();
    let home_m = std::array::from_fn(|axis| home_q[axis] * robot.metres_per_q[axis]);
    ask(
        robot,
        SimulatedMachine::<N, M>::from_robot(robot, tool, path(home_m)).unwrap(),
    )
}

fn fake(lies: bool) -> Result<Counts, String> {
    let motors = MotorMap::new([0, 1, 2]).unwrap();
    let (plant, watch) = Watched::<Bus<3>, 3, 3>::new(Bus::default(), motors, lies);
    Run::new(
        Config::new(parameters()).unwrap(),
        motors,
        plant,
        watch,
        SEED,
    )
    .ticks(TICKS)
}

#[test]
fn of_the_fake_machine() {
    fake(false).unwrap().assert_much();
}

/// The check can fail: a machine that says it refused what its drives took goes forth by S and back
/// by S and a step of the ramp.
#[test]
fn not_of_a_machine_whose_refused_writes_act() {
    let error = fake(true).unwrap_err();
    assert!(error.contains("from AtDrive"), "{error}");
}

#[test]
fn of_the_simulated_machine() {
    simulated::<_, 3, 3>(&RobotFile::builtin_l2().unwrap())
        .unwrap()
        .assert_much();
    simulated::<_, 6, 9>(&RobotFile::builtin_f1().unwrap())
        .unwrap()
        .assert_much();
}

#[test]
fn of_simulated_drives_with_supervision() {
    let text = text_of("l2")
        .unwrap()
        .replacen("[simulation]", "[drives]\n\n[simulation]", 1);
    let AnyRobotFile::L2(robot) = AnyRobotFile::parse("supervised.toml", &text).unwrap() else {
        panic!()
    };
    simulated::<_, 3, 3>(&robot).unwrap().assert_much();
}

/// A campaign between home and a pose 20 mm away.
const PLAN: &str = r#"format = "gantry-tau springs 1"
model = "l2"
measurements = "springs.csv"
[noise]
gauge_um = 1.0
force_n = 1.0
moment_nm = 0.05
[[pose]]
name = "aside"
T = [0.02, 0.5, 0.65]
[[gauge]]
name = "px"
on = "platform"
point_m = [0.14, 0.0, 0.05]
axis = [1.0, 0.0, 0.0]
[[series]]
name = "x"
pose = "aside"
mounting = "strap along x"
hook_m = [0.0, 0.0, -0.08]
direction = [1.0, 0.0, 0.0]
levels_n = [0.0, 60.0, 0.0]
gauges = ["px"]
"#;

/// A watched machine in a campaign, which must learn of sessions.
struct InCampaign(Watch<3, 3>, SessionSwitch);

impl Bench<3> for InCampaign {
    fn set(&mut self, trouble: Option<Trouble>) {
        self.0.set(trouble);
    }

    fn at_drives(&self) -> Vec<AtDrive> {
        self.0.at_drives()
    }

    fn see(&mut self, row: &TickRecord<3>) -> Result<(), String> {
        self.1.see(row);
        self.0.see(row)
    }
}

#[test]
fn of_the_machine_in_a_campaign() {
    let robot = RobotFile::builtin_l2().unwrap();
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("drive_theorem");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("plan.toml"), PLAN).unwrap();
    let plan = plan::read(&folder.join("plan.toml"), "l2", &robot.metres_per_q).unwrap();
    let machine =
        CampaignMachine::<3, 3>::from_robot(&robot, plan, GaugePublisher::bind(LOOPBACK).unwrap())
            .unwrap();
    let (switch, motors) = (machine.switch(), robot.motor_map().unwrap());
    let (plant, watch) = Watched::new(machine, motors, false);
    let config = robot.session_config(Capabilities::NONE).unwrap();
    let run = Run::new(config, motors, plant, InCampaign(watch, switch), SEED);
    run.ticks(TICKS).unwrap().assert_much();
}

#[cfg(target_os = "linux")]
mod ethercat {
    use gantry_tau::ethercat::{EmulatedBus, EthercatPlant};
    use gantry_tau_core::control::axis::Offsets;
    use gantry_tau_core::units::{OffsetNm, TorquePermille, VelocityUmS};
    use gantry_tau_ethercat::emulation::Faults;

    use super::*;
    use crate::ethercat::{bus_of, section_of_whole_steps};

    /// One count, nm.
    const COUNT_NM: i64 = 10;

    /// Drives on an emulated bus, seen by their own objects; trouble is a frame that is lost, on
    /// its way out or back.
    struct OnTheBus<const N: usize, const M: usize> {
        bus: EmulatedBus<N, M>,
        motors: MotorMap<N, M>,
        /// Positions of the drives on a standing path, counts, if they know but the sum of nominal
        /// reference and offset.
        start: Option<Vec<i64>>,
        /// 1, or -1 for a drive that counts against its axis.
        signs: Vec<i8>,
    }

    impl<const N: usize, const M: usize> Bench<N> for OnTheBus<N, M> {
        const RESOLUTION_NM: u64 = COUNT_NM.unsigned_abs();

        fn set(&mut self, trouble: Option<Trouble>) {
            self.bus.bench().faults = Faults {
                lost_out: u32::from(trouble == Some(Trouble::Write)),
                lost_back: u32::from(trouble == Some(Trouble::Read)),
                ..Faults::default()
            };
        }

        fn at_drives(&self) -> Vec<AtDrive> {
            let bench = self.bus.bench();
            let motors = self
                .motors
                .axis_of_motor()
                .iter()
                .zip(bench.chain.drives())
                .enumerate();
            let at_drives = motors.map(|(motor, (axis, drive))| {
                let [target, own, velocity, torque] =
                    [0x607A, 0x60B0, 0x60B1, 0x60B2].map(|object| drive.object(object, 0));
                let (target, own) = (i64::from(target), i64::from(own));
                let nominal = self.start.as_ref().map_or(target, |start| start[motor]);
                let sign = self.signs[motor];
                let [reference_nm, nominal_nm, offset_nm] =
                    [target + own, nominal, target + own - nominal]
                        .map(|counts| COUNT_NM * counts * i64::from(sign));
                AtDrive {
                    axis: *axis,
                    reference_nm,
                    nominal_nm,
                    offsets: Offsets {
                        position: OffsetNm(i32::try_from(offset_nm).unwrap()),
                        velocity: VelocityUmS(velocity * i32::from(sign)),
                        torque: TorquePermille(i16::try_from(torque).unwrap() * i16::from(sign)),
                    },
                }
            });
            at_drives.collect()
        }
    }

    fn ask_bus<K: MachineKind<N>, const N: usize, const M: usize>(
        robot: &RobotFile<K, N>,
        knows_offset: bool,
    ) {
        let section = section_of_whole_steps(robot);
        let bus = bus_of::<K, N, M>(robot, &section);
        if !knows_offset {
            bus.bench()
                .chain
                .drives_mut()
                .for_each(|drive| drive.remove_object(0x60B0));
        }
        let plant = EthercatPlant::<_, N, M>::open(robot, &section, bus.clone(), |start_m| {
            if knows_offset {
                path(start_m)
            } else {
                Motion::Hold
            }
        })
        .unwrap();
        let motors = robot.motor_map().unwrap();
        let start = (!knows_offset).then(|| {
            bus.bench()
                .chain
                .drives()
                .map(|drive| drive.motor().position)
                .collect()
        });
        let signs = section.drives.iter().map(|drive| drive.sign).collect();
        let bench = OnTheBus {
            bus: bus.clone(),
            motors,
            start,
            signs,
        };
        let config = robot.session_config(Capabilities::NONE).unwrap();
        Run::new(config, motors, plant, bench, SEED)
            .ticks(TICKS)
            .unwrap()
            .assert_much();
    }

    #[test]
    fn of_drives_over_ethercat() {
        ask_bus::<_, 3, 3>(&RobotFile::builtin_l2().unwrap(), true);
        ask_bus::<_, 6, 9>(&RobotFile::builtin_f1().unwrap(), true);
    }

    #[test]
    fn of_drives_over_ethercat_without_60b0() {
        ask_bus::<_, 3, 3>(&RobotFile::builtin_l2().unwrap(), false);
        ask_bus::<_, 6, 9>(&RobotFile::builtin_f1().unwrap(), false);
    }
}
