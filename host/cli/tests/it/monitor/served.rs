//! `monitor` beside a real server: what it prints is what a client is sent in the same tick, in
//! each phase.

use std::collections::HashMap;
use std::io::Read;
use std::net::{SocketAddr, TcpStream};
use std::process::Stdio;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use gantry_tau_client::Connection;
use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::client::{Event, Requirements};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{AxisState, Capabilities, Mode, State};
use gantry_tau_core::units::OffsetNm;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_test_support::labcomm_port::sent_robot;
use serde_json::{Value, json};

use super::web::{Reader, get, page_of};
use crate::process::{Folder, Running};
use crate::publication::{ports, record};
use crate::recording::mcap;
use crate::signals::serve_typed;

const PORT: &str = "127.0.0.1:0=state,axes,tool,session_event,drives,machine";
/// Longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(60);
/// Offset that a ramp of some seconds takes to zero, nm; on each axis another part of it.
const FAR_NM: i32 = 480_000;

/// Answers of a session's owner to each State.
#[derive(Clone, Copy, PartialEq)]
enum Will {
    Nothing,
    Answer(Mode),
    Leave,
}

/// A client that follows its will and keeps every State, until the server closes.
struct Owner {
    will: Arc<Mutex<Will>>,
    thread: JoinHandle<HashMap<i64, State<3>>>,
}

impl Owner {
    fn of(server: &str) -> Self {
        let server: SocketAddr = server.parse().unwrap();
        let requirements = Requirements {
            capabilities: Capabilities::LOCKSTEP,
            ..Requirements::default()
        };
        let mut link =
            Connection::<3>::open(Transport::Stream, server, PATIENCE, requirements).unwrap();
        let will = Arc::new(Mutex::new(Will::Nothing));
        let told = Arc::clone(&will);
        let thread = std::thread::spawn(move || {
            link.greet().unwrap();
            let targets = [1, -2, 3].map(|part| Offsets::position(OffsetNm(FAR_NM / 3 * part)));
            let mut states = HashMap::new();
            while let Ok(event) = link.next_event() {
                let (Event::State(state) | Event::Ended(state)) = event else {
                    panic!("{event:?}")
                };
                states.insert(i64::try_from(state.tick.0).unwrap(), state);
                // Some thousand ticks in all, not some hundred thousand.
                std::thread::sleep(Duration::from_millis(1));
                let _ = match *told.lock().unwrap() {
                    Will::Nothing => Ok(()),
                    Will::Answer(mode) => link.answer(mode, &targets).map(|_| ()),
                    Will::Leave => link.goodbye(),
                };
            }
            states
        });
        Self { will, thread }
    }

    fn shall(&self, will: Will) {
        *self.will.lock().unwrap() = will;
    }
}

/// One line of `--status`, with the exit status.
fn status(folder: &Folder, port: SocketAddr) -> (Value, Option<i32>) {
    let ended = folder.run(&["monitor", &port.to_string(), "--status"]);
    assert_eq!(
        (ended.stdout.lines().count(), ended.stderr.as_str()),
        (1, "")
    );
    (serde_json::from_str(&ended.stdout).unwrap(), ended.code)
}

/// As [`status`], once the server is in a phase.
fn status_in(
    folder: &Folder,
    server: &mut Running,
    port: SocketAddr,
    phase: &str,
) -> (Value, Option<i32>) {
    let mut line = (Value::Null, None);
    server.await_that(phase, |_| {
        line = status(folder, port);
        line.0["phase"] == phase
    });
    line
}

/// The State as `--status` prints it, without what no State has.
fn printed(state: &State<3>, [phase, cause]: [&str; 2]) -> Value {
    let counters = &state.counters;
    json!({
        "tick": state.tick.0, "phase": phase, "epoch": state.epoch.0, "cause": cause, "sequence": state.accepted.0,
        "on_time": state.on_time_of_100, "ramp_ticks_left": state.ramp_ticks_left,
        "counters": {
            "received": counters.received, "missed": counters.missed, "late": counters.late,
            "duplicate": counters.duplicate, "stale": counters.stale, "malformed": counters.malformed,
            "out_of_range": counters.out_of_range, "limited": counters.limited, "clamped": counters.clamped,
            "strangers": counters.non_owner,
        },
        "longest_miss_run": counters.longest_miss_run, "machine_failed": false, "rows_lost": false,
        "axes": state.axes.iter().map(printed_axis).collect::<Vec<_>>(),
    })
}

fn printed_axis(axis: &AxisState) -> Value {
    const FLAGS: [&str; 6] = [
        "clamped",
        "position_limited",
        "velocity_limited",
        "torque_limited",
        "nominal_step",
        "nominal_accel",
    ];
    let flags: Vec<&str> = FLAGS
        .into_iter()
        .enumerate()
        .filter(|(bit, _)| axis.flags.bits() >> bit & 1 == 1)
        .map(|(_, name)| name)
        .collect();
    let (offset, actual) = (&axis.offsets, &axis.actual);
    json!({
        "nominal_nm": axis.nominal.0,
        "offset": {
            "position_nm": offset.position.0, "velocity_um_s": offset.velocity.0, "torque_permille": offset.torque.0,
        },
        "shadow_nm": axis.shadow.position.0,
        "actual": {
            "position_nm": actual.position.0, "velocity_um_s": actual.velocity.0, "torque_permille": actual.torque.0,
        },
        "flags": flags,
    })
}

/// Compares a line with the server's record; returns it without what no State has.
fn without_record(mut line: Value, record: &HashMap<i64, HashMap<String, String>>) -> Value {
    let tick = line["tick"].as_i64().unwrap();
    let row = &record[&tick];
    let state = line["phase"].as_str().unwrap().replace('_', "");
    assert_eq!(row["state"].to_lowercase(), state);
    for (axis, number) in line["axes"].as_array_mut().unwrap().iter_mut().zip(1_u8..) {
        let axis = axis.as_object_mut().unwrap();
        let column = format!("reference_{number}_nm");
        assert_eq!(
            axis.remove("reference_nm").unwrap(),
            row[&column].parse::<i64>().unwrap()
        );
        // Unknown in the first tick that is received.
        let lag = axis.remove("lag_nm").unwrap();
        let actual = axis["actual"]["position_nm"].as_i64().unwrap();
        assert!(
            lag.is_null() || lag == record[&(tick - 1)][&column].parse::<i64>().unwrap() - actual,
            "{lag}"
        );
    }
    let line = line.as_object_mut().unwrap();
    let drives = [1, 2, 3].map(|number| row[&format!("drive_{number}")].clone());
    assert_eq!(line.remove("drives").unwrap(), json!(drives));
    let machine = line.remove("machine").unwrap();
    let own = RobotFile::builtin_l2().unwrap();
    assert_eq!(
        machine,
        json!({"name": own.name, "kinematics": format!("{:08x}", own.checksum()), "lockstep": true})
    );
    let force = line.remove("force").unwrap();
    assert_eq!(json!(row["force_x_n"].parse::<f64>().unwrap()), force[0]);
    for key in ["gauges_m", "displacement_m", "turn_rad"] {
        assert_eq!(line.remove(key).unwrap().as_array().unwrap().len(), 3);
    }
    Value::Object(line.clone())
}

/// Lines of the command and of the page, with the phases and causes in which they were asked for.
struct Watch<'a> {
    folder: &'a Folder,
    port: SocketAddr,
    page: SocketAddr,
    lines: Vec<(Value, [&'static str; 2])>,
}

impl Watch<'_> {
    /// Asks for the status in a phase, which has this exit code.
    fn look(&mut self, server: &mut Running, [phase, cause]: [&'static str; 2], code: i32) {
        let (line, status) = status_in(self.folder, server, self.port, phase);
        assert_eq!(
            (&line["cause"], status),
            (&json!(cause), Some(code)),
            "{phase}"
        );
        self.lines.push((line, [phase, cause]));
        // The object of the page is judged in the same way.
        server.await_that("the page", |_| {
            let answer = get(self.page, "/status");
            let body = answer
                .split_once("\r\n\r\n")
                .and_then(|(_, body)| serde_json::from_str(body).ok());
            let line = body.filter(|line: &Value| line["phase"] == phase);
            let is_there = line.is_some();
            self.lines.extend(line.map(|line| (line, [phase, cause])));
            is_there
        });
    }
}

/// Found from outside: without `--robot` the page drew the built-in L2 at the positions of another
/// machine. Now that machine is drawn, and recorded.
#[test]
fn the_machine_that_is_served_is_the_one_that_is_drawn_and_recorded() {
    let folder = Folder::new("monitor-small");
    folder.write("small.toml", &sent_robot());
    let further = ["--robot", "small.toml", "--labcomm", PORT];
    let (mut server, _) = serve_typed(&folder, ["60", "0.5"], &further, Stdio::null());
    let port = ports(&mut server)[0];
    let (monitor, page) = page_of(&folder, port, &["--record", "small.mcap"]);
    let machine = Reader::of(page).next("machine");
    assert_eq!(machine["name"], "small.toml");
    server.await_that("a recording", |_| {
        std::fs::metadata(folder.path("small.mcap")).is_ok_and(|file| file.len() > 100_000)
    });
    monitor.stop().success();
    server.stop().success();
    let bytes = std::fs::read(folder.path("small.mcap")).unwrap();
    assert_eq!(mcap::origin(&bytes)["robot"], "small.toml");
    assert!(!mcap::samples(&bytes).of("scene").is_empty());
}

#[test]
fn the_status_is_the_state_of_its_tick_in_each_phase() {
    let folder = Folder::new("monitor-served");
    let further = [
        "--record",
        "serve.csv",
        "--labcomm",
        PORT,
        "--labcomm-version",
        "2014",
    ];
    let (mut server, address) = serve_typed(&folder, ["60", "0.5"], &further, Stdio::piped());
    let port = ports(&mut server)[0];
    let (_monitor, page) = page_of(&folder, port, &[]);
    let mut watch = Watch {
        folder: &folder,
        port,
        page,
        lines: Vec::new(),
    };
    watch.look(&mut server, ["listening", "none"], 0);
    let first = Owner::of(&address);
    watch.look(&mut server, ["handshake", "none"], 0);
    first.shall(Will::Answer(Mode::Submit));
    watch.look(&mut server, ["submit", "none"], 0);
    first.shall(Will::Answer(Mode::Obtain));
    // The offsets are far from zero when it leaves.
    server.await_that("the offsets", |_| {
        status(&folder, port).0["axes"][2]["offset"]["position_nm"]
            .as_i64()
            .unwrap()
            > i64::from(FAR_NM) / 2
    });
    watch.look(&mut server, ["obtain", "none"], 0);
    first.shall(Will::Leave);
    watch.look(&mut server, ["safe_disconnect", "goodbye"], 3);
    let mut states = first.thread.join().unwrap();
    watch.look(&mut server, ["listening", "goodbye"], 0);
    let second = Owner::of(&address);
    second.shall(Will::Answer(Mode::Obtain));
    server.await_that("the offsets", |_| {
        status(&folder, port).0["axes"][2]["offset"]["position_nm"]
            .as_i64()
            .unwrap()
            > i64::from(FAR_NM) / 2
    });
    server.write("stop\n");
    watch.look(&mut server, ["fault", "stop"], 4);
    // In Fault a client is sent every tick until the server ends.
    server.stop().success();
    states.extend(second.thread.join().unwrap());
    folder
        .run(&["monitor", &port.to_string(), "--status"])
        .failure(6);
    let record = record(&folder);
    for (line, names) in watch.lines {
        let tick = line["tick"].as_i64().unwrap();
        let line = without_record(line, &record);
        match states.get(&tick) {
            Some(state) => assert_eq!(line, printed(state, names)),
            None => assert_eq!(names[0], "listening", "no client was sent tick {tick}"),
        }
    }
}

/// A reader that takes everything until the connection ends.
fn take_all(port: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(port).unwrap();
    let mut reading = stream.try_clone().unwrap();
    std::thread::spawn(move || std::io::copy(&mut reading, &mut std::io::sink()));
    stream
}

#[test]
fn a_suspended_monitor_is_dropped_and_says_so_when_it_goes_on() {
    let folder = Folder::new("monitor-suspended");
    let (mut server, _) = serve_typed(&folder, ["0", "1"], &["--labcomm", PORT], Stdio::null());
    let port = ports(&mut server)[0];
    let mut monitor = folder.start(
        "monitor",
        &["monitor", &port.to_string(), "--status", "--every", "0.05"],
    );
    monitor.await_words("\"phase\":\"listening\"");
    let others = [(); 3].map(|()| take_all(port));
    // The fifth is served when one of the four has been dropped.
    let mut fifth = TcpStream::connect(port).unwrap();
    fifth.set_read_timeout(Some(PATIENCE)).unwrap();
    monitor.signal("-STOP");
    fifth.read_exact(&mut [0]).unwrap();
    monitor.signal("-CONT");
    monitor.await_words("the server has ended, or dropped this reader because it did not keep up");
    drop((fifth, others));
    let before = monitor.stdout().lines().count();
    monitor.await_that("another tick", |monitor| {
        monitor.stdout().lines().count() > before + 2
    });
    monitor.stop().success();
    server.stop().success();
}
