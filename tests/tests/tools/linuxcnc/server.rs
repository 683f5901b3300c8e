//! The component `gantry_tau` in a thread of HAL without the motion controller: a streamer has the
//! path, the drives are ideal, and the unchanged `gantry-tau client` compensates.

pub(super) mod hal;
mod record;

use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs::Permissions;
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::os::unix::fs::PermissionsExt;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use gantry_tau_server::state::{MachineState, StatePlace};
use libtest_mimic::Failed;

use super::record::{FAULT, LISTENING, OBTAIN, SAFE_DISCONNECT};
use hal::{Hal, free_port, modules, program};
use record::{AXES, Row, judge, parse};

/// Trials of this file.
pub(super) const TRIALS: &[(&str, super::Check)] = &[
    ("server_needs_known_functions_only", || {
        done(known_functions_only)
    }),
    (
        "server_ends_sessions_of_a_killed_client_and_by_a_stop",
        || done(|| two_ends(&[])),
    ),
    ("server_ends_sessions_over_datagrams", || {
        done(|| two_ends(&["udp=1"]))
    }),
    ("server_takes_a_burst_as_one_tick", || {
        done(a_burst_is_one_tick)
    }),
    (
        "server_has_places_for_newcomers_beside_idle_strangers",
        || done(places_are_shared),
    ),
    ("server_refuses_bad_parameters_in_one_line", || {
        done(bad_parameters)
    }),
    ("server_refuses_a_port_in_use_in_one_line", || {
        done(port_in_use)
    }),
];

/// A test that fails by panicking.
fn done(test: fn()) -> Result<(), Failed> {
    test();
    Ok(())
}

/// Longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(120);
/// Causes, as on the wire.
const CLIENT_LATE: u8 = 1;
const CLOSED: u8 = 5;
const STOP: u8 = 8;
/// Joints of the L2 at home, mm.
const HOME_MM: [f64; AXES] = [624.499_8, -696.419_414, 668.954_408];

/// Periods in which the path stands at first.
const STANDS: u32 = 5_000;

/// The path: every joint swings by centimetres, in whole nanometres, for much longer than a test
/// takes; then it stands.
fn path() -> String {
    let mut lines = String::new();
    for period in 0..60_000_u32 {
        // It stands where the drives are while the component starts.
        let swing = 5.0 * (1.0 - (TAU * f64::from(period.saturating_sub(STANDS)) / 2_000.0).cos());
        let [first, second, third] = HOME_MM;
        writeln!(
            lines,
            "{:.6} {:.6} {:.6}",
            first + swing,
            second + 1.1 * swing,
            third - 0.9 * swing
        )
        .unwrap();
    }
    lines
}

/// A thread with the component between streamer and sampler; `parameters` of the component.
fn setup(parameters: &str) -> String {
    let mut hal = format!(
        "loadrt threads name1=servo period1=1000000\nloadrt gantry_tau {parameters}\n\
         loadrt streamer depth=6000 cfg=fff\nloadrt sampler depth=8000 cfg=fffffffffffffssuu\n\
         loadrt mux2 count=3\nloadrt sum2 count=3\nloadrt scale count=3\nnet enable gantry-tau.enable\nsetp gantry-tau.wrench-valid 1\nnet permit gantry-tau.permit\n"
    );
    for (joint, home) in HOME_MM.into_iter().enumerate() {
        let [nominal, reference, difference, offset] = [0, 1, 2, 3].map(|group| 3 * group + joint);
        write!(
            hal,
            "net nominal{joint} streamer.0.pin.{joint} gantry-tau.{joint}.nominal sum2.{joint}.in1 sampler.0.pin.{nominal}\n\
             net reference{joint} gantry-tau.{joint}.reference mux2.{joint}.in1 sum2.{joint}.in0 sampler.0.pin.{reference}\n\
             setp mux2.{joint}.in0 {home}\nnet enable mux2.{joint}.sel\n\
             net position{joint} mux2.{joint}.out gantry-tau.{joint}.position\n\
             net difference{joint} sum2.{joint}.out scale.{joint}.in\n\
             net scaled{joint} scale.{joint}.out sampler.0.pin.{difference}\n\
             net offset{joint} gantry-tau.{joint}.offset sampler.0.pin.{offset}\n\
             setp sum2.{joint}.gain1 -1\nsetp scale.{joint}.gain 1e15\n"
        )
        .unwrap();
    }
    let pins = ["0.feedback", "phase", "cause", "missed", "tick"];
    for (at, pin) in (12..).zip(pins) {
        writeln!(hal, "net s{at} gantry-tau.{pin} sampler.0.pin.{at}").unwrap();
    }
    for axis in 0..6 {
        writeln!(hal, "net wrench-{axis} gantry-tau.wrench-{axis}").unwrap();
    }
    hal + "addf streamer.0 servo\nstart\n"
}

/// Functions of the thread once the streamer has begun: the component takes the first nominal
/// positions as those in force.
const FUNCTIONS: &str = "addf mux2.0 servo\naddf mux2.1 servo\naddf mux2.2 servo\naddf gantry-tau.read servo\naddf gantry-tau.write servo\naddf sum2.0 servo\naddf sum2.1 servo\naddf sum2.2 servo\n\
                         addf scale.0 servo\naddf scale.1 servo\naddf scale.2 servo\naddf sampler.0 servo\n";

/// A running component.
struct Bench {
    hal: Hal,
    port: u16,
    udp: bool,
}

impl Bench {
    fn start(name: &str, parameters: &[&str]) -> Self {
        // Nothing waits for the compiler later.
        program();
        let port = free_port();
        let parameters = format!("port={port} epoch_file=epochs {}", parameters.join(" "));
        let hal = Hal::start(name, &setup(&parameters), Some([&path(), FUNCTIONS]));
        assert!(hal.is_ready, "{}", hal.said());
        let mut bench = Self {
            hal,
            port,
            udp: parameters.contains("udp=1"),
        };
        // While they are off the drives stand at home, and the path does.
        let since = Instant::now();
        while bench.hal.ask("getp gantry-tau.permit") != "TRUE" {
            assert!(
                since.elapsed() < PATIENCE,
                "not permitted: {}",
                bench.hal.said()
            );
        }
        bench.hal.ask("sets enable 1");
        bench.rearm();
        bench
    }

    /// Leads out of the stop. A start is one.
    fn rearm(&mut self) {
        self.wait_for("gantry-tau.phase", FAULT);
        for pressed in [0, 1] {
            self.hal.ask(&format!("setp gantry-tau.rearm {pressed}"));
            self.pass(20);
        }
        self.wait_for("gantry-tau.phase", LISTENING);
        self.hal.ask("setp gantry-tau.rearm 0");
    }

    /// Starts a client and waits until its offsets act against a load.
    fn compensate(&mut self) -> Client {
        self.hal.ask("sets wrench-1 0");
        let client = Client::start(self.port, self.udp);
        self.wait_for("gantry-tau.phase", OBTAIN);
        // So much that the offsets meet their limit behind the filter of the client.
        self.hal.ask("sets wrench-1 500");
        self.pass(300);
        assert!(
            self.hal.pin("gantry-tau.1.offset").abs() > 0.05,
            "{}",
            self.hal.pin("gantry-tau.1.offset")
        );
        client
    }

    fn wait_for(&mut self, pin: &str, value: u8) {
        let since = Instant::now();
        while self.hal.ask(&format!("getp {pin}")) != value.to_string() {
            assert!(
                since.elapsed() < PATIENCE,
                "waited too long for {pin} = {value}: {}",
                self.hal.said()
            );
        }
    }

    /// Lets ticks pass.
    fn pass(&mut self, ticks: u32) {
        let (since, first) = (Instant::now(), self.tick());
        while self.tick() < first + f64::from(ticks) {
            assert!(
                since.elapsed() < PATIENCE,
                "the thread stands: {}",
                self.hal.said()
            );
        }
    }

    fn tick(&mut self) -> f64 {
        // Printed in hexadecimal.
        let text = self.hal.ask("getp gantry-tau.tick");
        let digits = text.trim_start_matches("0x");
        f64::from(if digits.len() < text.len() {
            u32::from_str_radix(digits, 16).unwrap()
        } else {
            text.parse().unwrap()
        })
    }

    /// Ends the session. Returns its periods, judged.
    fn end(mut self) -> Vec<Row> {
        assert_eq!(self.hal.ask("getp sampler.0.overruns"), "0");
        let rows = parse(&self.hal.end());
        judge(&rows);
        rows
    }
}

/// A running client; killed at the end.
struct Client(Child);

impl Client {
    fn start(port: u16, udp: bool) -> Self {
        let mut command = Command::new(program());
        command.args(["client", &format!("127.0.0.1:{port}"), "--robot", "l2"]);
        command
            .args(udp.then_some("--udp"))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        Self(command.spawn().unwrap())
    }

    fn end(mut self) -> Option<i32> {
        self.0.wait().unwrap().code()
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Two sessions: the client is killed; a stop, after which the machine is re-armed.
fn two_ends(parameters: &[&str]) {
    let name = if parameters.is_empty() {
        "streams"
    } else {
        "datagrams"
    };
    let mut bench = Bench::start(name, &[&["lockstep=1"], parameters].concat());
    drop(bench.compensate());
    bench.wait_for("gantry-tau.phase", LISTENING);
    let client = bench.compensate();
    bench.hal.ask("setp gantry-tau.stop 1");
    bench.wait_for("gantry-tau.phase", FAULT);
    bench.hal.ask("setp gantry-tau.stop 0");
    // Only a re-arm leads out, and not before the offsets are zero.
    bench.pass(2_500);
    assert_eq!(bench.hal.ask("getp gantry-tau.phase"), FAULT.to_string());
    bench.rearm();
    assert_eq!(client.end(), Some(6), "its session was ended by the server");
    let rows = bench.end();
    let ends: Vec<[u8; 2]> = rows
        .windows(2)
        .filter(|pair| pair[0].phase == OBTAIN && pair[1].phase != OBTAIN)
        .map(|pair| [pair[1].phase, pair[1].cause])
        .collect();
    let lost = if parameters.is_empty() {
        CLOSED
    } else {
        CLIENT_LATE
    };
    assert_eq!(ends, [[SAFE_DISCONNECT, lost], [FAULT, STOP]]);
    let in_session = rows.iter().filter(|row| row.phase == OBTAIN);
    assert!(in_session.clone().count() > 600, "{}", in_session.count());
    // Silence is what tells that a sender of datagrams is gone: one miss is tolerated, and the
    // second ends the session.
    let missed = in_session.clone().filter(|row| row.missed != 0).count();
    assert_eq!(
        missed,
        usize::from(!parameters.is_empty()),
        "in lock-step no deadline is missed"
    );
    let largest = rows.iter().map(|row| row.offset[1].abs()).max().unwrap();
    assert!(largest > 50_000, "{largest}");
    assert!(
        rows.windows(2)
            .any(|pair| (pair[1].offset[1] - pair[0].offset[1]).abs() == 5_000),
        "the limit of a step was met"
    );
}

/// The thread stands for a while; the periods that follow in a burst are one tick, and the offsets
/// are held in them.
fn a_burst_is_one_tick() {
    let mut bench = Bench::start("burst", &[]);
    for _ in 0..3 {
        bench
            .hal
            .ask("!kill -STOP $(pidof rtapi_app); sleep 0.05; kill -CONT $(pidof rtapi_app)");
        bench.pass(200);
    }
    assert!(bench.hal.pin("gantry-tau.lateness-max") > 40e6);
    let rows = bench.end();
    let held: Vec<usize> = (1..rows.len())
        .filter(|at| rows[*at].tick == rows[at - 1].tick)
        .collect();
    assert!(held.len() >= 3 * 40, "{}", held.len());
    // The next tick counts those that were skipped: its number is that of the period.
    for at in (1..rows.len()).filter(|at| !held.contains(at)) {
        assert_eq!(
            usize::try_from(rows[at].tick - rows[0].tick).unwrap(),
            at,
            "{:?}",
            rows[at]
        );
    }
}

/// Strangers who take all places, and say and read nothing, do not keep a client out.
fn places_are_shared() {
    let mut bench = Bench::start("places", &["lockstep=1"]);
    let address = ("127.0.0.1", bench.port);
    let _strangers: Vec<TcpStream> = (0..8)
        .map(|_| TcpStream::connect(address).unwrap())
        .collect();
    bench.pass(20);
    drop(bench.compensate());
    bench.wait_for("gantry-tau.phase", LISTENING);
    drop(bench.end());
}

/// A component that does not load says why in one line, and HAL goes on without it.
fn refused(name: &str, parameters: &str, why: &str) {
    let hal = Hal::start(name, &format!("loadrt gantry_tau {parameters}\n"), None);
    assert!(!hal.is_ready);
    let said = hal.said();
    let lines: Vec<&str> = said
        .lines()
        .filter(|line| line.starts_with("gantry_tau: ") && !line.contains("rtapi_app_main"))
        .collect();
    assert_eq!(lines.len(), 1, "{said}");
    assert!(lines[0].contains(why), "{said}");
}

fn bad_parameters() {
    let port = format!("port={}", free_port());
    refused("no-epochs", &port, "epoch_file is missing");
    refused(
        "bad-epochs",
        &format!("{port} epoch_file=setup.hal"),
        "epoch_file=setup.hal does not contain a counter",
    );
    refused(
        "no-folder",
        &format!("{port} epoch_file=nowhere/epochs"),
        "epoch_file=nowhere/epochs: No such file or directory",
    );
    refused(
        "device-epochs",
        &format!("{port} epoch_file=/dev/null"),
        "epoch_file=/dev/null: ",
    );
    epochs_in_use(&port);
    names_in_use(&port);
    refused(
        "no-port",
        "port=70000 epoch_file=epochs",
        "port=70000 is not a port",
    );
    refused(
        "no-address",
        &format!("{port} address=here epoch_file=epochs"),
        "address=here is not an IPv4 address",
    );
    refused(
        "no-key",
        &format!("{port} address=0.0.0.0 epoch_file=epochs"),
        "everybody who reaches 0.0.0.0 could move the machine: give key=FILE",
    );
    refused(
        "no-key-file",
        &format!("{port} key=nowhere epoch_file=epochs"),
        "key=nowhere: No such file or directory",
    );
    refused(
        "no-key-in-it",
        &format!("{port} key=setup.hal epoch_file=epochs"),
        "key=setup.hal: others may read or write it; run: chmod 600 setup.hal",
    );
}

/// One server at a time owns a counter, be it this component or `serve`.
fn epochs_in_use(port: &str) {
    let folder = tempfile::tempdir().unwrap();
    let place = StatePlace::named(&folder.path().join("epochs"));
    let owned = MachineState::own(&place, "test").unwrap();
    // LinuxCNC runs as another user.
    for path in [
        folder.path().to_path_buf(),
        folder.path().join("epochs.lock"),
    ] {
        std::fs::set_permissions(path, Permissions::from_mode(0o777)).unwrap();
    }
    let parameters = format!("{port} epoch_file={}", place.epoch_file.display());
    refused(
        "epochs-in-use",
        &parameters,
        "epochs: in use by another server",
    );
    assert!(!place.epoch_file.exists());
    drop(owned);
}

/// Another file that has the name of the lock, or of the counter's second file, is left as it is; a
/// counter that has a lock is another machine's.
fn names_in_use(port: &str) {
    const OTHER: &str = "4 of another program\n";
    for (extension, files) in [
        ("lock", &[("epochs.lock", OTHER)][..]),
        ("lock", &[("epochs.lock", "\0")]),
        ("new", &[("epochs.new", OTHER)]),
        ("new", &[("epochs.new", "\0")]),
        ("new", &[("epochs.new", "17\n"), ("epochs.new.lock", "")]),
    ] {
        let folder = tempfile::tempdir().unwrap();
        // LinuxCNC runs as another user.
        let for_all = Permissions::from_mode(0o777);
        for (name, text) in files {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            std::fs::set_permissions(path, for_all.clone()).unwrap();
        }
        std::fs::set_permissions(folder.path(), for_all).unwrap();
        refused(
            "names-in-use",
            &format!(
                "{port} epoch_file={}",
                folder.path().join("epochs").display()
            ),
            &format!(
                "epochs: a file of this name with .{extension} behind it is another program's; move it away"
            ),
        );
        for (name, text) in files {
            assert_eq!(
                std::fs::read_to_string(folder.path().join(name)).unwrap(),
                *text
            );
        }
    }
}

fn port_in_use() {
    let held = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = held.local_addr().unwrap().port();
    let why = format!("cannot listen on 127.0.0.1:{port}");
    refused(
        "port-in-use",
        &format!("port={port} epoch_file=epochs"),
        &why,
    );
    let held = UdpSocket::bind(("127.0.0.1", 0)).unwrap();
    let port = held.local_addr().unwrap().port();
    let why = format!("cannot listen on 127.0.0.1:{port}");
    refused(
        "udp-port-in-use",
        &format!("udp=1 port={port} epoch_file=epochs"),
        &why,
    );
}

/// A shared object may have undefined symbols, so the linker does not refuse a panic, as it does
/// for programs: the list does.
fn known_functions_only() {
    let module = modules().join("gantry_tau.so");
    let listed = Command::new("nm")
        .args(["-D", "--undefined-only"])
        .arg(module)
        .output()
        .unwrap();
    assert!(listed.status.success());
    let text = String::from_utf8(listed.stdout).unwrap();
    let needed: BTreeSet<&str> = text
        .lines()
        .filter_map(|line| line.split_whitespace().last()?.split('@').next())
        .collect();
    let known = "accept4 bind close dirname dprintf flock fstat fsync ftruncate geteuid getpid getrandom inet_pton listen lseek lstat memcmp memcpy memmove memset bcmp nanosleep open \
                 ppoll read recv recvfrom rename send sendto setsockopt snprintf socket strcpy strerror strlen strncmp strspn strtoull unlink write";
    let known: BTreeSet<&str> = known.split_whitespace().collect();
    let prefixes = ["hal_", "rtapi_", "_"];
    let unknown: Vec<_> = needed
        .difference(&known)
        .filter(|name| !prefixes.iter().any(|prefix| name.starts_with(prefix)))
        .collect();
    assert!(
        needed.contains("hal_init") && unknown.is_empty(),
        "{unknown:?}"
    );
}
