//! A campaign on one machine whose drives, force sensor and gauges are all devices of emulated
//! buses, with distributed clocks: `experiment` measures it, `identify` finds its springs, and a
//! client with these springs compensates it.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::channel;

use gantry_tau::ethercat::gauges::{GaugesFile, ShownGauges, shown_bus};
use gantry_tau::ethercat::{EthercatPlant, emulated_bus_of};
use gantry_tau_client::force_sensor::SensorSource;
use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_ethercat::Wire as _;
use gantry_tau_ethercat::emulation::EmulatedWire;
use gantry_tau_ethercat::gauges::Gauges;
use gantry_tau_identify::experiment::campaign_machine::CampaignMachine;
use gantry_tau_identify::experiment::live::{self, LiveOptions};
use gantry_tau_identify::measurements::plan;
use gantry_tau_identify::springs::identify::{Identification, IdentifyOptions, identify};
use gantry_tau_machine::model::L2;
use gantry_tau_machine::robot_file::{AnyRobotFile, Clocks, Ethercat, RobotFile};
use gantry_tau_record::recording::drain;
use gantry_tau_server::links::gauges::{GaugePublisher, Lengths};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::plant::{DriveState, Plant, Reading};
use gantry_tau_server::server::Server;
use gantry_tau_server::server::tick_source::TickSource;
use gantry_tau_sim::springs::TrueSprings;
use gantry_tau_system::dial::Addresses;
use gantry_tau_test_support::campaigns::{GAUGES, campaign_a};
use gantry_tau_tests::client_session;
use gantry_tau_tests::server_fixture::LOOPBACK;

use super::force::with_sensor;

/// Two of the hooks of campaign A.
fn plan_text() -> String {
    let noise = "gauge_um = 0.5\nforce_n = 0.5\nmoment_nm = 0.05\n";
    let whole = campaign_a(noise, &[0, 300, 0]);
    let parts: Vec<&str> = whole.split("[[series]]").take(7).collect();
    parts.join("[[series]]")
}

/// Terminals for the gauges of the plan, 0.5 µm to a count, one of them the other way round.
fn terminals_text() -> String {
    let mut text = String::new();
    for (position, name) in (1..).zip(GAUGES) {
        let sign = if position == 2 { -1 } else { 1 };
        write!(
            text,
            "[[gauge]]\nname = {name:?}\nposition = {position}\nproduct = 0x13ED3052\n\
             um_per_count = 0.5\nsign = {sign}\n"
        )
        .unwrap();
    }
    text
}

/// The built-in machine with springs that the file has 3 % wrong, and nothing else that is not
/// stated.
fn robot() -> RobotFile<L2, 3> {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.masses = None;
    robot.simulation.jump_gap_m = 0.0;
    robot.sensor.tare_samples = 100;
    robot
}

/// A machine whose gauges are on a bus of their own, which is read once per tick: time is that of
/// the ticks.
struct WithGauges<P> {
    plant: P,
    gauges: Gauges<EmulatedWire<ShownGauges>>,
    file: GaugesFile,
    link: GaugePublisher,
    tick: u64,
}

impl<P> WithGauges<P> {
    fn new(plant: P, file: &GaugesFile, shown_at: &Addresses) -> Self {
        let wire = shown_bus(file, Some(shown_at)).unwrap();
        Self {
            plant,
            gauges: Gauges::bring_up(wire, &file.configs(), 1_000, 400).unwrap(),
            file: file.clone(),
            link: GaugePublisher::bind(LOOPBACK).unwrap(),
            tick: 0,
        }
    }
}

impl<P: Plant<3, 3>> Plant<3, 3> for WithGauges<P> {
    type Error = P::Error;

    fn start(&mut self) -> Result<(), P::Error> {
        self.plant.start()
    }

    fn in_force(&mut self) -> Result<[InForce; 3], P::Error> {
        self.plant.in_force()
    }

    fn read(&mut self, elapsed: u64) -> Result<Reading<3>, P::Error> {
        self.tick += elapsed;
        self.gauges.wire_mut().begin_cycles(elapsed, 1_000);
        self.gauges.cycle();
        let lengths_m = self.file.lengths_m(self.gauges.counts());
        self.link.publish(&Lengths::new(self.tick, lengths_m));
        self.plant.read(elapsed)
    }

    fn write(&mut self, references: &[Reference; 3], parts: &[InForce; 3]) -> Result<(), P::Error> {
        self.plant.write(references, parts)
    }

    fn drives(&self) -> Option<[DriveState; 3]> {
        self.plant.drives()
    }

    fn reset(&mut self) {
        self.plant.reset();
    }
}

/// Measures the plan in a folder; the server's machine is behind drives and a force sensor, the
/// gauges behind terminals.
fn measure(folder: &Path, robot: &RobotFile<L2, 3>) {
    let plan = plan::read(&folder.join("plan.toml"), "l2", &robot.metres_per_q).unwrap();
    let shown = GaugePublisher::bind(LOOPBACK).unwrap();
    let shown_at = shown.address().unwrap();
    let machine = CampaignMachine::<3, 3>::from_robot(robot, plan.clone(), shown).unwrap();
    let switch = machine.switch();
    let section = Ethercat {
        clocks: Clocks::Sync0,
        ..with_sensor(robot)
    };
    let bus = emulated_bus_of::<_, _, 3, 3>(robot, &section, machine).unwrap();
    let plant = EthercatPlant::<_, 3, 3>::open(robot, &section, bus, |_| Motion::Hold).unwrap();
    let file = GaugesFile::read(&folder.join("gauges.toml")).unwrap();
    let plant = WithGauges::new(plant, &file, &shown_at.into());
    let published = plant.link.address().unwrap();
    let cycle = client_session::cycle::<_, 3, 3, _>(robot, plant);
    let (server, mut rows) = Server::spawn(cycle, TickSource::Lockstep).unwrap();
    std::thread::spawn(move || drain(&mut rows, |row, _| switch.see(row)));

    let (_keyboard, keys) = channel();
    let report = live::run(
        LiveOptions {
            robot: robot.clone(),
            plan,
            server: server.address.into(),
            transport: Transport::Stream,
            key: None,
            sensor: SensorSource::States,
            accelerometer: None,
            gauges: Some(published.into()),
            obtain: false,
            is_unattended: true,
            raw: None,
            output: folder.join("springs.csv"),
        },
        &AtomicBool::new(false),
        &keys,
    );
    assert_eq!(report.unwrap().missing, 0);
    server.quit().unwrap();
}

/// Every spring within four of its stated standard deviations, which are below a tenth of it.
fn assert_found(robot: &RobotFile<L2, 3>, found: &Identification) {
    assert_eq!(found.doubts, Vec::<String>::new());
    let answer: serde_json::Value = serde_json::from_str(&found.json).unwrap();
    let truth = TrueSprings::from_robot(robot).unwrap().springs().machine;
    let truth: Vec<f64> = truth
        .links_m_per_n
        .iter()
        .chain(&truth.axes)
        .copied()
        .collect();
    let parameters = answer["parameters"].as_array().unwrap();
    assert_eq!(parameters.len(), truth.len());
    for (parameter, truth) in parameters.iter().zip(truth) {
        let [value, sd] = ["value", "sd"].map(|key| parameter[key].as_f64().unwrap());
        assert!((value - truth).abs() < 4.0 * sd, "{parameter}: {truth:e}");
        assert!(sd < 0.1 * truth, "{parameter}: {truth:e}");
    }
}

#[test]
fn drives_gauges_and_force_sensor_of_emulated_buses_give_the_simulated_machine() {
    let folder = tempfile::tempdir().unwrap();
    let robot = robot();
    std::fs::write(folder.path().join("plan.toml"), plan_text()).unwrap();
    std::fs::write(folder.path().join("gauges.toml"), terminals_text()).unwrap();
    measure(folder.path(), &robot);
    let options = IdentifyOptions::new(folder.path().join("plan.toml"), "l2");
    let found = identify(&robot, &options).unwrap();
    assert_found(&robot, &found);
    // A client with these springs compensates.
    let path = folder.path().join("my-l2.toml");
    std::fs::write(&path, &found.robot_file).unwrap();
    let AnyRobotFile::L2(identified) = AnyRobotFile::named(path.to_str().unwrap()).unwrap() else {
        panic!("another machine");
    };
    super::force::compensates::<_, 3, 3>(*identified, Clocks::Sync0);
}
