//! Ownership before effect: a second server of anything ends with one line, and the first does not
//! miss a tick. One writer of a machine's state, by any login, and however the one before has
//! ended.

use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use crate::process::{Ended, Folder, Running};
use crate::signals::{Recorded, await_obtain, client, rows, serve, serve_typed};

const FREE: [&str; 2] = ["--listen", "127.0.0.1:0"];
/// Epochs that a start gives away.
const RESERVE: u64 = 1 << 32;

/// Runs a second server to its end, which must come by itself.
fn second(folder: &Folder, arguments: &[&str]) -> Ended {
    folder
        .start("second", &[&["serve"], arguments].concat())
        .end()
}

fn epoch(folder: &Folder, file: &str) -> u64 {
    folder.read(file).trim().parse().unwrap()
}

/// The binary as another login runs it: another user where that can be had, and in any case another
/// environment.
fn other_login(folder: &Folder) -> Command {
    let binary = folder.path("gantry-tau");
    if !binary.exists() {
        std::fs::copy(env!("CARGO_BIN_EXE_gantry-tau"), &binary).unwrap();
    }
    let is_root = std::fs::metadata(folder.path(".")).unwrap().uid() == 0;
    let mut command = if is_root {
        Command::new("setpriv")
    } else {
        Command::new(&binary)
    };
    if is_root {
        command
            .args(["--reuid=65534", "--regid=65534", "--clear-groups"])
            .arg(&binary);
    }
    // Not a service.
    command
        .env("STATE_DIRECTORY", "")
        .env_remove("XDG_STATE_HOME")
        .env_remove("HOME");
    command
}

/// A folder in which every login may write.
fn open_folder(folder: &Folder, name: &str) -> PathBuf {
    use std::os::unix::fs::PermissionsExt;
    let path = folder.path(name);
    std::fs::create_dir_all(&path).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o777)).unwrap();
    path
}

/// Found by trial: the same command typed twice threw the drives of a running machine out of
/// operation.
#[test]
fn a_second_server_of_anything_is_refused_and_the_first_does_not_miss_a_tick() {
    let folder = Folder::new("second");
    let further = [
        "--name",
        "press",
        "--record",
        "serve.csv",
        "--black-box",
        "boxes",
        "--labcomm",
        "127.0.0.1:0",
    ];
    let (mut server, address) = serve(&folder, &further);
    let owner = client(&folder, "owner", &address);
    await_obtain(&mut server, 1);
    let said = server.stdout();
    let labcomm = said
        .split_once("LabComm on ")
        .unwrap()
        .1
        .split(';')
        .next()
        .unwrap();
    let listen = address.as_str();
    std::os::unix::fs::symlink("press", folder.path("alias")).unwrap();
    let state = folder.read("press/epoch");

    let process = if cfg!(target_os = "linux") {
        format!("pid {}", server.id())
    } else {
        String::new()
    };
    let pid = format!("pid {} (serve, l2 on 127.0.0.1:0)", server.id());
    let of_state = ["in use by", &pid, "--name", "--epoch-file"];
    let seconds = [
        // The same command line, but for the ports that the first got.
        (vec!["--listen", listen, "--name", "press"], of_state),
        ([&FREE[..], &["--name", "press"]].concat(), of_state),
        (
            [&FREE[..], &["--epoch-file", "press/epoch"]].concat(),
            of_state,
        ),
        (
            [&FREE[..], &["--epoch-file", "alias/epoch"]].concat(),
            of_state,
        ),
        (vec!["--listen", listen], of_port(listen, &process)),
        (
            [&FREE[..], &["--labcomm", labcomm]].concat(),
            of_port(labcomm, &process),
        ),
        (
            [
                &FREE[..],
                &[
                    "--name",
                    "press",
                    "--record",
                    "serve.csv",
                    "--black-box",
                    "boxes",
                ],
            ]
            .concat(),
            of_state,
        ),
    ];
    for (arguments, words) in seconds {
        let recording = folder.path("serve.csv");
        let before = recording.metadata().unwrap().len();
        let line = second(&folder, &arguments).failure(1);
        assert!(
            words.iter().all(|word| line.contains(word)),
            "{arguments:?}: {line}"
        );
        server.await_that("a tick", |_| recording.metadata().unwrap().len() > before);
    }
    assert_eq!(
        folder.read("press/epoch"),
        state,
        "a second server has written the state"
    );

    // Another login has another state folder, and the same ports.
    let mut command = other_login(&folder);
    command.env("HOME", open_folder(&folder, "home"));
    command.args(["serve", "--listen", listen]);
    let line = folder
        .start_command("login", command, Stdio::null())
        .end()
        .failure(1);
    assert!(
        line.contains("cannot listen on") && line.contains(listen),
        "{line}"
    );
    // Or the same state.
    let mut command = other_login(&folder);
    command
        .arg("serve")
        .args(FREE)
        .arg("--epoch-file")
        .arg(folder.path("press/epoch"));
    let line = folder
        .start_command("login", command, Stdio::null())
        .end()
        .failure(1);
    assert!(line.contains(&pid), "{line}");

    assert!(
        owner
            .stop()
            .success()
            .starts_with("left with Goodbye after ")
    );
    server.await_words("SafeDisconnect -> Listening");
    let said = server.stop().success();
    let all = rows(&folder);
    assert!(
        said.contains(&format!("recorded {} rows to serve.csv", all.len())),
        "{said}"
    );
    assert_first_missed_nothing(&folder, &all);
}

/// Words of a refusal for a port.
fn of_port<'a>(port: &'a str, process: &'a str) -> [&'a str; 4] {
    ["cannot listen on", port, "in use by", process]
}

/// One grant, no miss, no stop: Obtain until the client left.
fn assert_first_missed_nothing(folder: &Folder, rows: &[Recorded]) {
    let mut phases: Vec<&str> = rows.iter().map(|row| row.state.as_str()).collect();
    phases.dedup();
    let seen: Vec<&str> = phases
        .into_iter()
        .skip_while(|phase| *phase != "Submit")
        .collect();
    assert_eq!(
        seen[..3],
        ["Submit", "Obtain", "SafeDisconnect"],
        "{seen:?}"
    );
    let csv = folder.read("serve.csv");
    let header: Vec<&str> = csv.lines().next().unwrap().split(',').collect();
    let [tick, state, missed] = ["tick", "state", "missed"]
        .map(|name| header.iter().position(|column| *column == name).unwrap());
    let mut last = None;
    for line in csv.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let tick: u64 = cells[tick].parse().unwrap();
        assert!(
            last.is_none_or(|last| tick == last + 1),
            "a tick is missing before {line}"
        );
        last = Some(tick);
        if ["Submit", "Obtain"].contains(&cells[state]) {
            assert_eq!(cells[missed], "0", "{line}");
        }
    }
}

/// Found by attack: of 48 starts 33 got epochs of another, and in 15 of 15 rounds of four.
#[test]
fn of_servers_that_start_at_once_one_gets_the_state_and_no_epoch_is_given_twice() {
    const ROUNDS: u64 = 12;
    let folder = Folder::new("parallel");
    for round in 1..=ROUNDS {
        let arguments = [&["serve", "--epoch-file", "epoch"], &FREE[..]].concat();
        let names = ["a", "b", "c", "d"];
        let mut started: Vec<Running> = names.map(|name| folder.start(name, &arguments)).into();
        // One listens; the others end, refused by it.
        let first = started
            .iter_mut()
            .map(|server| server.await_either("listening on", "in use by"))
            .position(|up| up);
        let first = started.remove(first.expect("no server got the state"));
        for refused in started {
            assert!(
                !refused.stdout().contains("listening on"),
                "two servers own the state"
            );
            let line = refused.end().failure(1);
            assert!(line.contains("epoch file epoch: in use by "), "{line}");
        }
        assert_eq!(epoch(&folder, "epoch"), round * RESERVE, "in round {round}");
        if round % 2 == 0 {
            first.kill();
        } else {
            first.stop().success();
        }
    }
}

/// Found by trial: servers of one user shared one latch, and a re-arm at one forgot the stop of the
/// other.
#[test]
fn a_stop_at_one_machine_survives_the_re_arm_of_another() {
    let folder = Folder::new("machines");
    // One name for the files of output: each server is looked at before the next starts.
    let (mut a, _) = serve_typed(&folder, ["60", "5"], &["--name", "a"], Stdio::piped());
    a.write("stop\n");
    a.await_words("the stop is latched; type `rearm` when the machine may move");
    let (mut b, _) = serve_typed(&folder, ["60", "5"], &["--name", "b"], Stdio::piped());
    b.write("stop\n");
    b.await_words("Listening -> Fault");
    b.write("rearm\n");
    b.await_words("Fault -> Listening");
    b.stop().success();
    a.kill();
    let (mut a, addresses) = serve_typed(&folder, ["60", "5"], &["--name", "a"], Stdio::piped());
    a.await_words("a stop was not re-armed before this server started");
    let line = client(&folder, "client", &addresses).end().failure(4);
    assert!(
        line.contains("stopped") && line.contains("type `rearm` where `gantry-tau serve` runs"),
        "{line}"
    );
    assert_eq!(
        [epoch(&folder, "a/epoch"), epoch(&folder, "b/epoch")],
        [2 * RESERVE, RESERVE]
    );
    a.write("rearm\n");
    a.await_words("Fault -> Listening");
    a.stop().success();
    assert_eq!(folder.read("a/epoch.stop"), "released\n");
}

/// Serves for a moment with these options; returns the log.
fn log_of_a_run(folder: &Folder, options: &[&str]) -> String {
    let mut server = folder.start(
        "serve",
        &[&["serve", "--pace", "lockstep"], options].concat(),
    );
    server.await_words("listening on");
    // Output and log have a thread each: one of them may be late.
    let ended = server.stop();
    let said = ended.stderr.clone();
    ended.success();
    said
}

/// Found by trial: another HOME, sudo, or a file that was removed, and the stop was gone.
#[test]
fn a_machine_without_state_starts_in_fault_unless_it_cannot_hurt() {
    let folder = Folder::new("without");
    let any = [
        "--listen",
        "0.0.0.0:0",
        "--insecure",
        "--epoch-file",
        "epoch",
    ];
    let lost = "no state of this machine at epoch";
    let said = log_of_a_run(&folder, &any);
    assert!(
        said.contains(lost) && said.contains("starts in Fault") && said.contains("--first-run"),
        "{said}"
    );
    // It stays a stop: nothing has re-armed the machine.
    assert!(
        log_of_a_run(&folder, &any).contains("a stop was not re-armed"),
        "forgotten"
    );
    let line = second(&folder, &[&any[..], &["--first-run"]].concat()).failure(1);
    assert!(
        line.contains("--first-run: epoch is there") && line.contains("leave the option out"),
        "{line}"
    );
    for file in ["epoch", "epoch.stop"] {
        std::fs::remove_file(folder.path(file)).unwrap();
    }
    assert!(
        !log_of_a_run(&folder, &[&any[..], &["--first-run"]].concat()).contains("starts in Fault")
    );
    assert!(!log_of_a_run(&folder, &any).contains("starts in Fault"));
    std::fs::remove_file(folder.path("epoch.stop")).unwrap();
    let said = log_of_a_run(&folder, &any);
    assert!(
        said.contains("epoch.stop is missing") && said.contains("starts in Fault"),
        "{said}"
    );
    let line = second(&folder, &[&FREE[..], &["--name", "../x"]].concat()).failure(2);
    assert!(line.contains("expected 1 to 64 of"), "{line}");
    let line = second(
        &folder,
        &[&FREE[..], &["--name", "x", "--epoch-file", "y"]].concat(),
    )
    .failure(2);
    assert!(
        line.contains("--name") && line.contains("--epoch-file"),
        "{line}"
    );
}

/// Starts a server in the surroundings of a login.
fn serve_as(folder: &Folder, xdg: Option<&str>, home: Option<&PathBuf>) -> Running {
    let mut command = other_login(folder);
    xdg.map(|xdg| command.env("XDG_STATE_HOME", xdg));
    home.map(|home| command.env("HOME", home));
    command.args(["serve", "--name", "mine"]).args(FREE);
    folder.start_command("login", command, Stdio::null())
}

/// Found by trial: an empty XDG_STATE_HOME put the state into the working directory.
#[test]
fn a_login_without_a_state_folder_is_told_what_to_do() {
    let folder = Folder::new("login");
    let (home, closed) = (open_folder(&folder, "home"), folder.path("closed"));
    std::fs::create_dir(&closed).unwrap();
    std::fs::set_permissions(&closed, std::os::unix::fs::PermissionsExt::from_mode(0o555)).unwrap();
    for (xdg, home) in [
        (None, None),
        (Some(""), None),
        (Some("relative"), Some(PathBuf::new())),
    ] {
        let line = serve_as(&folder, xdg, home.as_ref()).end().failure(1);
        assert!(
            line.contains("XDG_STATE_HOME") && line.contains("--epoch-file"),
            "{line}"
        );
    }
    let line = serve_as(&folder, None, Some(&closed)).end().failure(1);
    assert!(
        line.contains("ermission denied")
            && line.contains("--epoch-file")
            && line.contains("closed"),
        "{line}"
    );
    for xdg in [None, Some(""), Some("relative/state")] {
        let mut server = serve_as(&folder, xdg, Some(&home));
        server.await_words("listening on");
        server.stop().success();
        let file = "home/.local/state/gantry-tau/mine/epoch";
        assert!(epoch(&folder, file) > 0);
        std::fs::remove_file(folder.path(file)).unwrap();
        std::fs::remove_file(folder.path(&format!("{file}.stop"))).unwrap();
    }
    assert!(!folder.path("gantry-tau/mine").exists() && !folder.path("relative").exists());
}

/// Found by attack: 2 GB were read, a start hung, the target of a link was overwritten.
#[test]
fn a_state_that_is_not_a_regular_file_ends_the_start_with_one_line() {
    let folder = Folder::new("kinds");
    for (name, program, options) in [
        ("pipe", "mkfifo", &[][..]),
        ("folder", "mkdir", &[]),
        ("link", "ln", &["-s", "/dev/zero"]),
        ("big", "truncate", &["-s", "10G"]),
    ] {
        let mut command = Command::new(program);
        let status = command.args(options).arg(folder.path(name)).status();
        assert!(status.unwrap().success(), "{program}");
    }
    folder.write("other", "{\"version\": 2}\n");
    for (file, words) in [
        ("pipe", "a device, a pipe or a socket"),
        ("folder", "is a folder"),
        ("link", "is a symbolic link"),
        ("/dev/zero", "a device, a pipe or a socket"),
        ("big", "does not contain a counter"),
        ("other", "does not contain a counter"),
    ] {
        let line = second(&folder, &[&FREE[..], &["--epoch-file", file]].concat()).failure(1);
        assert!(line.contains(file) && line.contains(words), "{line}");
    }
}
