//! `serve` and `client` as two processes, ended by signals.

use std::process::Stdio;

use crate::process::{Folder, Running, address_behind};

/// Starts a server in lock-step on free ports; returns it with its address.
pub(crate) fn serve(folder: &Folder, further: &[&str]) -> (Running, String) {
    serve_pulling(folder, ["60", "5"], further)
}

/// The same with the largest force, N, and the length of its steps, s.
pub(crate) fn serve_pulling(
    folder: &Folder,
    steps: [&str; 2],
    further: &[&str],
) -> (Running, String) {
    serve_typed(folder, steps, further, Stdio::null())
}

/// The same with an input for commands.
pub(crate) fn serve_typed(
    folder: &Folder,
    [force, seconds]: [&str; 2],
    further: &[&str],
    input: Stdio,
) -> (Running, String) {
    let mut arguments = vec!["serve", "--pace", "lockstep", "--listen", "127.0.0.1:0"];
    arguments.extend(["--force-max", force, "--step-seconds", seconds]);
    arguments.extend(further);
    let mut server = folder.start_with("serve", &arguments, input);
    server.await_words("Ctrl-C");
    let said = server.stdout();
    let address = address_behind(&said, "listening on ");
    assert!(
        address.starts_with("127.0.0.1:") && !address.ends_with(":0"),
        "{said}"
    );
    (server, address)
}

pub(crate) fn client(folder: &Folder, name: &str, server: &str) -> Running {
    folder.start(name, &["client", server])
}

/// Waits until the server has seen Obtain `times` times.
pub(crate) fn await_obtain(server: &mut Running, times: usize) {
    server.await_that("Obtain", |server| {
        server.stderr().matches("Submit -> Obtain").count() == times
    });
}

/// Ends a client by Ctrl-C, and waits for the end of its ramp: a client during the ramp is refused.
pub(crate) fn leave(owner: Running, server: &mut Running) {
    let said = owner.stop().success();
    assert!(said.starts_with("left with Goodbye after "), "{said}");
    server.await_words("SafeDisconnect -> Listening");
}

/// A row of a recording.
pub(crate) struct Recorded {
    pub(crate) tick: i64,
    pub(crate) state: String,
    pub(crate) offsets_nm: [i64; 3],
}

impl Recorded {
    fn is_of_ramp(&self) -> bool {
        ["Fault", "SafeDisconnect"].contains(&self.state.as_str())
    }
}

/// Returns every row so far.
pub(crate) fn rows(folder: &Folder) -> Vec<Recorded> {
    let csv = folder.read("serve.csv");
    let mut lines = csv.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let [Some(tick), Some(state), Some(a), Some(b), Some(c)] =
        ["tick", "state", "offset_1_nm", "offset_2_nm", "offset_3_nm"]
            .map(|name| header.iter().position(|column| *column == name))
    else {
        return Vec::new();
    };
    let whole = lines.filter_map(|line| {
        let fields: Vec<&str> = line.split(',').collect();
        (fields.len() == header.len()).then(|| Recorded {
            tick: fields[tick].parse().unwrap(),
            state: fields[state].to_owned(),
            offsets_nm: [a, b, c].map(|index| fields[index].parse().unwrap()),
        })
    });
    whole.collect()
}

/// Checks that every change is within S a tick, and every change in a ramp exactly rho a tick or
/// the rest. A recording that is not taken away in time loses rows: between those beside them there
/// are more ticks.
pub(crate) fn assert_no_jump(rows: &[Recorded]) {
    for pair in rows.windows(2) {
        let (earlier, later) = (&pair[0], &pair[1]);
        let ticks = later.tick - earlier.tick;
        assert!(ticks > 0, "tick {} after {}", later.tick, earlier.tick);
        for (from, to) in earlier.offsets_nm.iter().zip(&later.offsets_nm) {
            assert!(
                (to - from).abs() <= 5_000 * ticks,
                "{from} to {to} in {ticks} ticks"
            );
            // Where the first tick of the ramp is lost, it is not known what the ramp began with.
            if later.is_of_ramp() && (ticks == 1 || earlier.is_of_ramp()) {
                assert_eq!(from - to, from.signum() * from.abs().min(100 * ticks));
            }
        }
    }
}

/// Checks that only the ramp follows the last Obtain, with exactly its ticks.
fn assert_whole_ramp(rows: &[Recorded]) {
    let stopped = rows.iter().rposition(|row| row.state == "Obtain");
    let (before, ramp) = rows.split_at(stopped.unwrap() + 1);
    let left = before.last().unwrap().offsets_nm.map(i64::unsigned_abs);
    // The hand pulls for seconds: unless this machine was paused meanwhile, some 48 um are left.
    let ticks = left.into_iter().max().unwrap().div_ceil(100).max(1);
    assert_eq!(u64::try_from(ramp.len()).unwrap(), ticks);
    assert!(ramp.iter().all(|row| row.state == "Fault"));
}

#[test]
fn a_session_of_two_processes_from_obtain_to_the_servers_end() {
    let folder = Folder::new("processes");
    let (mut server, addresses) = serve(&folder, &["--record", "serve.csv"]);

    let owner = client(&folder, "owner", &addresses);
    await_obtain(&mut server, 1);
    let line = client(&folder, "second", &addresses).end().failure(4);
    assert!(line.contains("another client owns the session"), "{line}");
    leave(owner, &mut server);

    let third = client(&folder, "third", &addresses);
    await_obtain(&mut server, 2);
    let before = rows(&folder).len();
    server.await_that("an offset in force", |_| {
        rows(&folder)[before..]
            .iter()
            .any(|row| row.state == "Obtain" && row.offsets_nm[1].abs() > 30_000)
    });
    server.interrupt();
    let line = third.end().failure(6);
    assert!(line.contains("stopped"), "{line}");
    let said = server.end().success();
    assert!(said.contains("all offsets are zero; ended"), "{said}");

    let rows = rows(&folder);
    let recorded = format!("recorded {} rows to serve.csv, ", rows.len());
    assert!(
        said.contains(&recorded) && said.contains(" dropped"),
        "{said}"
    );
    assert_eq!(rows.last().unwrap().offsets_nm, [0; 3]);
    if said.contains(", 0 dropped") {
        assert_no_jump(&rows);
        assert_whole_ramp(&rows);
    }
}

#[test]
fn a_client_whose_server_is_killed_says_so() {
    let folder = Folder::new("killed");
    let (mut server, addresses) = serve(&folder, &[]);
    let owner = client(&folder, "owner", &addresses);
    await_obtain(&mut server, 1);
    server.kill();
    let line = owner.end().failure(7);
    assert!(line.contains("the server vanished"), "{line}");
}

#[test]
fn a_server_whose_client_is_killed_ramps_and_takes_the_next() {
    let folder = Folder::new("orphaned");
    let (mut server, addresses) = serve(&folder, &[]);
    let owner = client(&folder, "owner", &addresses);
    await_obtain(&mut server, 1);
    owner.kill();
    server.await_words("SafeDisconnect -> Listening");
    let next = client(&folder, "next", &addresses);
    await_obtain(&mut server, 2);
    next.stop().success();
    server.stop().success();
}

#[test]
fn a_server_without_clients_ends_at_once_and_loses_no_row() {
    let folder = Folder::new("alone");
    let (server, _) = serve(&folder, &["--record", "serve.csv"]);
    let said = server.stop().success();
    let recorded = format!("recorded {} rows to serve.csv", rows(&folder).len());
    assert!(said.contains(&recorded), "{said}");
}

#[test]
fn a_reader_that_leaves_early_makes_no_panic() {
    let folder = Folder::new("broken-pipe");
    // The shell's `head` closes the pipe after the first line.
    let script = format!(
        "'{}' demo --pace lockstep --step-seconds 0.5 --force-max 60 --report r.html 2>err | head -n 1",
        env!("CARGO_BIN_EXE_gantry-tau")
    );
    let done = std::process::Command::new("sh")
        .args(["-c", &script])
        .current_dir(folder.path("."))
        .output()
        .unwrap();
    assert!(done.status.success());
    let err = folder.read("err");
    assert!(!err.contains("panicked"), "{err}");
    assert!(
        folder.path("r.html").exists(),
        "the demo did not go on: {err}"
    );
}

#[test]
fn the_same_over_datagrams() {
    let folder = Folder::new("udp");
    let (mut server, address) = serve(&folder, &["--udp", "--allow", "127.0.0.0/8"]);
    let arguments = ["client", &address, "--udp"];
    let owner = folder.start("owner", &arguments);
    await_obtain(&mut server, 1);
    let line = folder.run(&arguments).failure(4);
    assert!(line.contains("another client owns the session"), "{line}");
    leave(owner, &mut server);
    // Killed, it cannot close a connection: the server only sees silence.
    let killed = folder.start("killed", &arguments);
    await_obtain(&mut server, 2);
    killed.kill();
    server.await_words("no command arrived before two consecutive deadlines");
    server.stop().success();
}

#[test]
fn a_peer_that_is_not_allowed_is_closed_silently() {
    let folder = Folder::new("allow");
    let (server, addresses) = serve(&folder, &["--allow", "192.0.2.7", "--allow", "10.0.0.0/8"]);
    client(&folder, "refused", &addresses).end().failure(7);
    server.stop().success();
    let line = folder.run(&["serve", "--allow", "nowhere"]).failure(1);
    assert!(line.contains("nowhere"), "{line}");
}

/// As of the page of `monitor --web`: samples move nothing.
#[test]
fn samples_that_others_reach_need_the_names_of_their_readers() {
    let folder = Folder::new("reach");
    let serve = ["serve", "--listen", "127.0.0.1:0", "--labcomm", "0.0.0.0:0"];
    let line = folder.run(&serve).failure(1);
    assert!(
        line.contains("other machines reach 0.0.0.0:0") && line.contains("--allow"),
        "{line}"
    );
    let mut server = folder.start("serve", &[&serve[..], &["--allow", "0.0.0.0/0"]].concat());
    server.await_words("listening on");
    server.stop().success();
}

/// A client whose screws have another lead would correct by another share than it computes: it is
/// refused before it moves anything.
#[test]
fn a_client_with_another_lead_is_refused() {
    let folder = Folder::new("lead");
    let (server, address) = serve(&folder, &["--robot", "f1"]);
    let text = include_str!("../../../../robots/f1.toml");
    let lead = "metres_per_q = [1.0, 1.0, 1.0, 0.1, 0.1, 0.1]";
    assert!(text.contains(lead));
    // The travel in metres stays the same; of the plates it is then a smaller angle.
    folder.write(
        "other.toml",
        &text.replace(lead, "metres_per_q = [1.0, 1.0, 1.0, 0.1, 0.1, 0.11]"),
    );
    let client = ["client", &address, "--robot", "other.toml"];
    let said = folder.run(&client).failure(5);
    assert!(
        said.contains("the server's machine has checksum ") && said.contains("metres_per_q differ"),
        "{said}"
    );
    server.stop().success();
}
