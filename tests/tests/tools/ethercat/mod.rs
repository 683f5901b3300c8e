//! EtherCAT over raw sockets: the server and SOEM, another MainDevice, on a veth pair with the
//! emulated chain at its other end.
//!
//! Each trial runs in a network namespace of its own, in a process of its own. Without that
//! privilege, or without `ip`, trials are reported as ignored, with what is missing; SOEM's needs
//! `pysoem` of PyPI, which `.ci/run` installs in `target/pysoem`. With
//! `GANTRY_TAU_REQUIRE_ETHERCAT=1` they fail instead.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

mod clocks;
mod instruments;
mod ownership;
mod scan;

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use gantry_tau::ethercat::{EmulatedBus, EthercatPlant, MachineWire, emulated_bus};
use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::control::message::Phase;
use gantry_tau_ethercat::emulation::{EmulatedWire, Process};
use gantry_tau_ethercat::{RawSocket, Wire, WireError, check_link};
use gantry_tau_machine::robot_file::{Ethercat, RobotFile};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::plant::{Plant, PlantError, ToolReading};
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_tests::short_demo;
use libtest_mimic::{Failed, Trial};
use serde_json::{Value, json};

use crate::python_packages::python_with;

/// The process has a namespace of its own.
const IN_NAMESPACE: &str = "GANTRY_TAU_TEST_NAMESPACE";
/// Ends of the cable.
const ENDS: [&str; 2] = ["ec0", "ec1"];
const PATIENCE: Duration = Duration::from_secs(60);

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    let network = (!succeeds(Command::new("ip").arg("-V")))
        .then_some("ip missing")
        .or_else(|| {
            (!succeeds(Command::new("unshare").args(["-n", "true"])))
                .then_some("network namespaces not permitted")
        });
    let python = python_with("pysoem", "pysoem");
    let soem = network.or_else(|| python.is_none().then_some("pysoem of PyPI missing"));
    let [of_scan, of_clocks, of_instruments] = [(); 3].map(|()| python.clone());
    vec![
        trial(
            "ethercat::the_demo_compensates_over_a_veth_pair",
            network,
            demo_over_veth,
        ),
        trial(
            "ethercat::a_link_that_is_not_up_is_named",
            network,
            link_is_named,
        ),
        trial(
            "ethercat::a_second_server_of_a_bus_is_refused_before_its_first_frame",
            network,
            ownership::second_server,
        ),
        trial(
            "ethercat::soem_takes_the_emulated_chain_to_op",
            soem,
            move || soem_agrees(python.as_deref().unwrap()),
        ),
        trial(
            "ethercat::soem_sets_up_the_clocks_of_the_emulated_chain",
            soem,
            move || clocks::soem_agrees(of_clocks.as_deref().unwrap()),
        ),
        trial(
            "ethercat::soem_and_the_gauges_read_the_same_counts",
            soem,
            move || instruments::soem_agrees(of_instruments.as_deref().unwrap()),
        ),
        trial(
            "ethercat::soem_and_the_scan_list_the_same_devices",
            soem,
            move || scan::soem_agrees(of_scan.as_deref().unwrap()),
        ),
    ]
}

/// A trial that runs in a namespace of its own, unless something is missing.
fn trial(
    name: &'static str,
    missing: Option<&'static str>,
    body: impl FnOnce() + Send + 'static,
) -> Trial {
    if let Some(missing) = missing {
        if std::env::var_os("GANTRY_TAU_REQUIRE_ETHERCAT").is_some_and(|value| value == "1") {
            return Trial::test(name, move || Err(missing.into())).with_kind(missing);
        }
        return Trial::test(name, || Ok(()))
            .with_kind(missing)
            .with_ignored_flag(true);
    }
    Trial::test(name, move || {
        if std::env::var_os(IN_NAMESPACE).is_some() {
            body();
            return Ok(());
        }
        let mut child = Command::new("unshare");
        child
            .arg("-n")
            .arg(std::env::current_exe()?)
            .args(["--exact", name])
            .env(IN_NAMESPACE, "1");
        let output = child.output()?;
        if output.status.success() {
            return Ok(());
        }
        let said = [output.stdout, output.stderr]
            .map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
        Err(Failed::from(said.concat()))
    })
}

fn succeeds(command: &mut Command) -> bool {
    command
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

fn ip(arguments: &[&str]) {
    let status = Command::new("ip").args(arguments).status();
    assert!(status.unwrap().success());
}

/// Creates the cable.
fn connect() {
    ip(&[
        "link", "add", ENDS[0], "type", "veth", "peer", "name", ENDS[1],
    ]);
    // Loopback is down in a new namespace.
    for end in ENDS.into_iter().chain(["lo"]) {
        ip(&["link", "set", end, "up"]);
    }
    ENDS.into_iter().for_each(|end| await_carrier(end, true));
}

/// Waits until the kernel says that an end has a carrier, or none, as it does some time after a
/// change.
fn await_carrier(end: &str, is_there: bool) {
    let began = Instant::now();
    while check_link(end).is_ok() != is_there {
        assert!(
            began.elapsed() < PATIENCE,
            "carrier of {end}: {:?}",
            check_link(end)
        );
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// A thread that answers frames on the far end of the cable.
struct FarEnd {
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl FarEnd {
    /// Answers until dropped. With a `slowness`, the chain's time is that of the system divided by
    /// it; without one nothing but frames and ticks moves it.
    fn start<P: Process + 'static>(wire: EmulatedWire<P>, slowness: Option<u32>) -> Self {
        let ends = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&ends);
        let mut socket = RawSocket::open(ENDS[1]).unwrap();
        let thread = std::thread::spawn(move || {
            let start = Instant::now();
            let mut frame = [0; 1_536];
            while !told.load(Ordering::Relaxed) {
                if let Some(slowness) = slowness {
                    let passed = start.elapsed() / slowness;
                    wire.bench()
                        .chain
                        .advance_to(u64::try_from(passed.as_micros()).unwrap());
                }
                if let Some(length) = socket.receive(&mut frame) {
                    let passed = wire.bench().chain.pass(&mut frame[..length]);
                    assert!(!passed || socket.send(&frame[..length]).is_ok());
                } else {
                    let soon = socket.now_us() + 500;
                    socket.wait_until(soon);
                }
            }
        });
        Self {
            ends,
            thread: Some(thread),
        }
    }
}

impl Drop for FarEnd {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

/// The near end: frames through the socket, cycles by the server's ticks. Its clock is slow, so
/// that an answer within half a cycle is one within 50 ms: nothing here depends on how busy the
/// computer is.
struct NearEnd<const N: usize, const M: usize> {
    socket: RawSocket,
    bus: EmulatedBus<N, M>,
    _far: FarEnd,
}

/// Factor of the slow clock.
const SLOW: u64 = 100;

impl<const N: usize, const M: usize> Wire for NearEnd<N, M> {
    fn now_us(&self) -> u64 {
        self.socket.now_us() / SLOW
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), WireError> {
        self.socket.send(frame)
    }

    fn receive(&mut self, buffer: &mut [u8]) -> Option<usize> {
        self.socket.receive(buffer)
    }

    fn wait_until(&mut self, us: u64) {
        self.socket.wait_until(us * SLOW);
    }

    fn begin_cycles(&mut self, cycles: u64, cycle_us: u64) {
        self.bus.begin_cycles(cycles, cycle_us);
    }
}

impl<const N: usize, const M: usize> MachineWire<N> for NearEnd<N, M> {
    fn note(&mut self, parts: &[InForce; N]) {
        self.bus.note(parts);
    }

    fn tool(&mut self) -> Option<ToolReading> {
        self.bus.tool()
    }

    fn failure(&mut self) -> Option<PlantError> {
        self.bus.failure()
    }
}

fn demo_over_veth() {
    connect();
    let robot = RobotFile::builtin_l2().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let complaints = short_demo::complaints(
        folder.path(),
        robot,
        |robot, tool| {
            let section = Ethercat::emulated(&robot.motors.axis_of_motor, &robot.metres_per_q);
            let bus = emulated_bus::<_, 3, 3>(robot, &section, tool)?;
            let far = FarEnd::start(bus.clone(), None);
            let near = NearEnd {
                socket: RawSocket::open(ENDS[0]).unwrap(),
                bus,
                _far: far,
            };
            EthercatPlant::<_, 3, 3>::open(robot, &section, near, |_| Motion::Hold)
        },
        |cycle, _| Ok(cycle),
    );
    assert_eq!(complaints, Vec::<String>::new());
}

/// Reason why the socket is not opened.
fn refusal() -> String {
    RawSocket::open(ENDS[0]).map(drop).unwrap_err().to_string()
}

/// Down, without a carrier, gone: each has its sentence, before a frame is sent and while a bus
/// runs.
fn link_is_named() {
    connect();
    assert_eq!(check_link(ENDS[0]), Ok(()));
    let robot = RobotFile::builtin_l2().unwrap();
    let section = Ethercat::emulated(&robot.motors.axis_of_motor, &robot.metres_per_q);
    let (_hand, tool) = load_generator();
    let bus = emulated_bus::<_, 3, 3>(&robot, &section, tool).unwrap();
    let far = FarEnd::start(bus.clone(), None);
    let near = NearEnd {
        socket: RawSocket::open(ENDS[0]).unwrap(),
        bus,
        _far: far,
    };
    let mut plant =
        EthercatPlant::<_, 3, 3>::open(&robot, &section, near, |_| Motion::Hold).unwrap();
    let mut faults = plant.fault_log().of_interface(ENDS[0]);
    plant.start().unwrap();
    let in_force = plant.in_force().unwrap();
    let references = in_force.map(|axis| Reference {
        position: axis.nominal,
        velocity_offset: Default::default(),
        torque_offset: Default::default(),
    });
    // The cable is pulled out at its far end.
    ip(&["link", "set", ENDS[1], "down"]);
    await_carrier(ENDS[0], false);
    let no_carrier = "the network interface ec0 has no carrier: its cable is out, or the drive at the other end has no power";
    // On a busy machine the far end may have been late before.
    faults.see(Phase::Fault);
    faults.see(Phase::Obtain);
    plant.read(1).ok();
    assert!(plant.write(&references, &in_force).is_err());
    let lines = faults.see(Phase::Obtain);
    assert!(
        lines.iter().any(|line| line.ends_with(no_carrier)),
        "{lines:?}"
    );
    assert_eq!(refusal(), no_carrier);
    ip(&["link", "set", ENDS[0], "down"]);
    assert_eq!(
        refusal(),
        "the network interface ec0 is down; `ip link set ec0 up`"
    );
    drop(plant);
    ip(&["link", "delete", ENDS[0]]);
    assert_eq!(
        refusal(),
        "there is no network interface ec0; `ip link` lists them"
    );
}

/// Runs a script of this folder at the near end of the cable; returns what it saw.
fn judged(python: &Path, script: &str) -> Value {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tools/ethercat");
    let judge = Command::new("timeout")
        .arg("60")
        .arg(python)
        .arg("-B")
        .arg(folder.join(script))
        .arg(ENDS[0])
        .output()
        .unwrap();
    assert!(
        judge.status.success(),
        "{}",
        String::from_utf8_lossy(&judge.stderr)
    );
    serde_json::from_slice(&judge.stdout).unwrap()
}

fn soem_agrees(python: &Path) {
    connect();
    let robot = RobotFile::builtin_l2().unwrap();
    let (_hand, tool) = load_generator();
    let section = Ethercat::emulated(&robot.motors.axis_of_motor, &robot.metres_per_q);
    let bus = emulated_bus::<_, 3, 3>(&robot, &section, tool).unwrap();
    let far = FarEnd::start(bus.clone(), Some(10));
    let saw = judged(python, "judge.py");
    drop(far);
    assert_eq!(saw["found"], 3);
    assert_eq!(saw["names"][1], json!(["emulated drive", 0x0A11, 1, 1]));
    assert_eq!(
        saw["aborted"],
        json!([
            0x0601_0002,
            0x0602_0000,
            0x0601_0002,
            0x0602_0000,
            0x0601_0002,
            0x0602_0000
        ])
    );
    assert_eq!(saw["size"], 3 * (17 + 14));
    assert_eq!(
        [&saw["pre_op"], &saw["safe_op"], &saw["operational"]],
        [&json!(2), &json!(4), &json!(8)]
    );
    assert_eq!(saw["counter"], json!([9, 9]));
    for drive in 0..3 {
        assert_eq!(
            saw["status"][drive].as_u64().unwrap() & 0x6F,
            0x27,
            "operation enabled: {saw}"
        );
        // The position arrives at the offset, but for the frames that were on their way.
        let (moved, offset) = (
            saw["moved"][drive].as_i64().unwrap(),
            saw["offset"].as_i64().unwrap(),
        );
        assert!((-20..=20).contains(&(offset - moved)), "{saw}");
        assert!(
            (0..=10).contains(&(offset - saw["offsets"][drive].as_i64().unwrap())),
            "{saw}"
        );
        let after = saw["after"][drive].as_u64().unwrap();
        assert!(
            after == 0x08 || after == 0x0F,
            "fault, after leaving OP: {saw}"
        );
    }
}
