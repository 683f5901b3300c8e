//! Frames with tags: servers with keys, clients with the same, another or none, and forgers between
//! them.

use std::collections::HashSet;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::keys::{Key, Keyring, Nonce, Role};
use gantry_tau_core::control::message::{Cause, Challenge, Phase};
use gantry_tau_core::control::wire::{Kind, enclose};
use gantry_tau_tests::DEADLINE;
use gantry_tau_tests::client::crc32;
use gantry_tau_tests::server_fixture::LOOPBACK;

use super::failures::{self, STATES};
use super::{folder, python};
use crate::session::Session;

/// Trials of this file.
pub(super) const TRIALS: &[(&str, super::Check)] = &[
    (
        "the_worked_example_of_tags_is_that_of_the_page",
        worked_example,
    ),
    ("a_key_obtains_over_streams_and_datagrams", obtains),
    ("a_path_is_a_key_file_of_run", as_a_function),
    ("another_key_and_none_are_told", other_keys),
    ("forged_datagrams_are_ignored", forged_datagrams),
    ("lost_datagrams_are_said_again", lost_datagrams),
    ("a_forged_frame_ends_a_stream", forged_stream),
    ("nine_challenges_are_one_too_many", challenges),
    ("key_files_are_read_as_strictly_as_by_the_server", key_files),
];

const CONTROL: [u8; 32] = [0xa1; 32];
const READ: [u8; 32] = [0xb2; 32];
const STRANGE: [u8; 32] = [0xc3; 32];
const TRANSPORTS: [Transport; 2] = [Transport::Stream, Transport::Datagram];
/// Length of a Hello with a key and of a State of three axes, bytes.
const HELLO: usize = 68;
const STATE: usize = 258;
/// Place of the phase in a State's frame.
const PHASE: usize = 32;
/// Bytes of a tag.
const TAG: usize = 16;

fn keyring() -> Keyring {
    let mut keyring = Keyring::new(&[0x55; 32]);
    keyring.add(Key::new(&CONTROL, Role::Control)).unwrap();
    keyring.add(Key::new(&READ, Role::Read)).unwrap();
    keyring
}

/// Digits of a secret.
fn hex(secret: &[u8]) -> String {
    secret.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A folder with a key file for each secret.
struct KeyFiles(tempfile::TempDir);

impl KeyFiles {
    fn new() -> Self {
        let files = Self(tempfile::tempdir().unwrap());
        for (name, role, secret) in [
            ("control", "control", CONTROL),
            ("read", "read", READ),
            ("strange", "control", STRANGE),
        ] {
            let text = format!("gantry-tau-key 1\nrole {role}\nsecret {}\n", hex(&secret));
            files.write(name, text.as_bytes(), 0o600);
        }
        files
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &[u8], mode: u32) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, text).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
        path
    }
}

/// The constant offset for some States, with a key of this file or without one.
fn client(address: &str, transport: Transport, key: Option<&Path>) -> Child {
    let mut program = python();
    program
        .arg(folder().join("examples/constant_offset.py"))
        .args([address, "--states", &STATES.to_string()]);
    if transport == Transport::Datagram {
        program.arg("--udp");
    }
    if let Some(path) = key {
        program.arg("--key").arg(path);
    }
    program.spawn().unwrap()
}

/// Waits for the end of a client; returns its exit code and its one sentence.
fn end_of(program: Child) -> (Option<i32>, String) {
    let output = program.wait_with_output().unwrap();
    let said = [output.stdout, output.stderr]
        .map(|bytes| String::from_utf8(bytes).unwrap())
        .concat();
    assert_eq!(said.lines().count(), 1, "{said}");
    (output.status.code(), said)
}

fn worked_example() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tools/python/worked_example.py");
    let output = python().arg(script).arg(folder()).output().unwrap();
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    assert!(output.status.success(), "{}", said.concat());
}

/// The client has left in good order after its States, and none of its commands was lost.
fn assert_left(session: &mut Session, (code, said): (Option<i32>, String)) -> usize {
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(session.ramped(), Cause::Goodbye);
    let obtained = session.obtained();
    let last = &obtained.last().unwrap().state;
    assert_eq!(last.axes[0].offsets.position.0, 10_000);
    assert_eq!((last.counters.missed, last.counters.malformed), (0, 0));
    let [heard] = failures::counted(&said, ["left with Goodbye after "]);
    heard
}

fn obtains() {
    let files = KeyFiles::new();
    let key = files.path("control");
    for (transport, is_keyed) in TRANSPORTS
        .into_iter()
        .flat_map(|transport| [(transport, true), (transport, false)])
    {
        let mut session = Session::listening(transport, is_keyed.then(keyring));
        let program = client(&session.address(), transport, is_keyed.then_some(&key));
        let end = session.end_of(program);
        let heard = assert_left(&mut session, end);
        failures::assert_heard(session.rows.iter().map(failures::is_live), heard);
        let non_owner = session.rows.iter().map(|row| row.state.counters.non_owner);
        assert_eq!(non_owner.max(), Some(0), "{transport:?}");
        session.quit();
    }
}

fn as_a_function() {
    let files = KeyFiles::new();
    let mut session = Session::listening(Transport::Datagram, Some(keyring()));
    let script = format!(
        "import pathlib, sys; sys.path.insert(0, sys.argv[1]); import gantry_tau
step = lambda state, wrench: [10_000, 0, 0]
print(gantry_tau.run(step, sys.argv[2], key=pathlib.Path(sys.argv[3]), udp=True, states={STATES}))"
    );
    let program = python()
        .args(["-c", &script])
        .arg(folder())
        .arg(session.address())
        .arg(files.path("control"))
        .spawn()
        .unwrap();
    let (code, said) = session.end_of(program);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.starts_with("Report(states="), "{said}");
    assert_eq!(session.ramped(), Cause::Goodbye);
    session.quit();
}

fn other_keys() {
    let files = KeyFiles::new();
    let wrong = format!(
        "the server vanished: no answer: wrong key? its id here is {}; compare with `gantry-tau key show-id` at the server",
        Key::new(&STRANGE, Role::Control).id()
    );
    let needed = "refused: the server needs a key (--key)";
    let keyless = "refused: the server has no key; without --key this client speaks to it";
    let silent = "the server vanished: it does not answer";
    let read = "refused: this key may only read";
    for (transport, is_keyed, name, code, words) in [
        (Transport::Stream, true, Some("strange"), 7, wrong.as_str()),
        (Transport::Datagram, true, Some("strange"), 7, &wrong),
        (Transport::Stream, true, None, 4, needed),
        (Transport::Datagram, true, None, 7, silent),
        (Transport::Stream, false, Some("strange"), 4, keyless),
        (Transport::Datagram, false, Some("strange"), 7, &wrong),
        (Transport::Stream, true, Some("read"), 4, read),
        (Transport::Datagram, true, Some("read"), 4, read),
    ] {
        let mut session = Session::listening(transport, is_keyed.then(keyring));
        let key = name.map(|name| files.path(name));
        let program = client(&session.address(), transport, key.as_deref());
        let (found, said) = session.end_of(program);
        assert_eq!(
            (found, said),
            (Some(code), format!("gantry_tau: {words}\n")),
            "{transport:?}"
        );
        assert!(session.rows.iter().all(|row| !row.welcomed));
        session.quit();
    }
}

/// Way of a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    ToServer,
    ToClient,
}

/// Passes datagrams between a client and a server on, as they are changed. Ends when it is dropped.
struct Relay {
    address: String,
    quit: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Relay {
    /// `change`: the datagrams in place of one.
    fn new(
        server: &str,
        mut change: impl FnMut(Way, &[u8]) -> Vec<Vec<u8>> + Send + 'static,
    ) -> Self {
        let [front, back] = [(); 2].map(|()| UdpSocket::bind(LOOPBACK).unwrap());
        back.connect(server).unwrap();
        let address = front.local_addr().unwrap().to_string();
        let quit = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&quit);
        let thread = std::thread::spawn(move || {
            for socket in [&front, &back] {
                socket.set_nonblocking(true).unwrap();
            }
            let (mut client, mut buffer) = (None, [0; 2_048]);
            while !is_over.load(Ordering::Relaxed) {
                let mut is_idle = true;
                while let Ok((count, from)) = front.recv_from(&mut buffer) {
                    (client, is_idle) = (Some(from), false);
                    for datagram in change(Way::ToServer, &buffer[..count]) {
                        back.send(&datagram).unwrap();
                    }
                }
                while let Ok(count) = back.recv(&mut buffer) {
                    is_idle = false;
                    for datagram in change(Way::ToClient, &buffer[..count]) {
                        front.send_to(&datagram, client.unwrap()).unwrap();
                    }
                }
                if is_idle {
                    std::thread::sleep(Duration::from_micros(100));
                }
            }
        });
        Self {
            address,
            quit,
            thread: Some(thread),
        }
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
        let ended = self.thread.take().map(JoinHandle::join);
        assert!(std::thread::panicking() || matches!(ended, Some(Ok(()))));
    }
}

/// The frame with this kind, suite and trailer in place of its own.
fn with_checksum(frame: &[u8], kind: u8) -> Vec<u8> {
    let mut forged = frame[..frame.len() - TAG].to_vec();
    (forged[3], forged[6]) = (kind, 0);
    let checksum = crc32(&forged).to_le_bytes();
    [forged, checksum.to_vec()].concat()
}

/// Datagrams that somebody without the key can make of one of the server.
fn forgeries(genuine: &[u8], before: &[u8], of_client: &[u8]) -> Vec<Vec<u8>> {
    let changed = |place: usize, value: u8| {
        let mut forged = genuine.to_vec();
        forged[place] = value;
        forged
    };
    let last = genuine.len() - 1;
    let is_state = genuine.len() == STATE;
    // A live session that is said to be over would end the client.
    let over = changed(PHASE.min(last), Phase::SafeDisconnect.code());
    let refusal = [
        &b"GT\x02\x07\x08\x00\x01\x00"[..],
        &[1, 0, 0, 0, 0, 0, 0, 0],
        &[0; TAG],
    ]
    .concat();
    let mut forged = vec![
        changed(last, genuine[last] ^ 1),
        changed(last + 1 - TAG, genuine[last + 1 - TAG] ^ 0x80),
        changed(3, 2),
        changed(3, 4),
        changed(3, 7),
        changed(3, 9),
        changed(2, 1),
        changed(6, 0),
        with_checksum(genuine, genuine[3]),
        with_checksum(&over, 4),
        with_checksum(&refusal, 7),
        refusal,
        b"GT\x01\x07\x08\x00\x08\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00".to_vec(),
        Vec::new(),
        genuine[..7].to_vec(),
        genuine[..last].to_vec(),
        [genuine, &[0]].concat(),
        [genuine, genuine].concat(),
        vec![0xff; 1_500],
        of_client.to_vec(),
        before.to_vec(),
    ];
    if is_state {
        forged.push(over);
    }
    forged
}

/// Forgeries stand before each genuine datagram, and it comes twice.
fn forged_datagrams() {
    let files = KeyFiles::new();
    let mut session = Session::listening(Transport::Datagram, Some(keyring()));
    let (mut before, mut of_client) = (Vec::new(), Vec::new());
    let relay = Relay::new(&session.address(), move |way, genuine| {
        if way == Way::ToServer {
            of_client = genuine.to_vec();
            return vec![genuine.to_vec()];
        }
        let mut datagrams = forgeries(genuine, &before, &of_client);
        before = genuine.to_vec();
        datagrams.extend([genuine.to_vec(), genuine.to_vec()]);
        datagrams
    });
    let key = files.path("control");
    let program = client(&relay.address, Transport::Datagram, Some(&key));
    let end = session.end_of(program);
    let heard = assert_left(&mut session, end);
    failures::assert_heard(session.rows.iter().map(failures::is_live), heard);
    session.quit();
}

/// The first of each kind is lost, but for what the server in lock-step would wait long for.
fn lost_datagrams() {
    let files = KeyFiles::new();
    for is_keyed in [true, false] {
        let mut session = Session::listening(Transport::Datagram, is_keyed.then(keyring));
        let mut seen = HashSet::new();
        let relay = Relay::new(&session.address(), move |way, genuine| {
            let kind = Kind::from_code(genuine[3]).unwrap();
            let is_lost = !matches!(kind, Kind::Welcome | Kind::Command);
            if is_lost && seen.insert((way == Way::ToServer, genuine[3])) {
                return Vec::new();
            }
            vec![genuine.to_vec()]
        });
        let key = files.path("control");
        let program = client(
            &relay.address,
            Transport::Datagram,
            is_keyed.then_some(&key),
        );
        let (code, said) = session.end_of(program);
        assert_eq!(code, Some(0), "{said}");
        assert_eq!(session.ramped(), Cause::Goodbye);
        session.quit();
    }
}

/// One bit of one State changes on the way.
fn forged_stream() {
    let files = KeyFiles::new();
    let mut session = Session::listening(Transport::Stream, Some(keyring()));
    let listener = TcpListener::bind(LOOPBACK).unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let server = session.address();
    let relay = std::thread::spawn(move || {
        let (client, _) = listener.accept().unwrap();
        let server = TcpStream::connect(server).unwrap();
        let [mut to_server, mut from_client] = [&server, &client].map(|s| s.try_clone().unwrap());
        let up = std::thread::spawn(move || {
            // A reset is an end as well.
            drop(std::io::copy(&mut from_client, &mut to_server));
            drop(to_server.shutdown(std::net::Shutdown::Write));
        });
        pass_on(server, client);
        up.join().unwrap();
    });
    let program = client(&address, Transport::Stream, Some(&files.path("control")));
    let (code, said) = session.end_of(program);
    let words = "gantry_tau: incompatible server: the stream is broken (the tag does not match)\n";
    assert_eq!((code, said.as_str()), (Some(5), words));
    assert_eq!(session.ramped(), Cause::Closed);
    relay.join().unwrap();
    session.quit();
}

/// Passes bytes of a server on. Behind 50 000 of them, one of each read is changed.
fn pass_on(mut server: TcpStream, mut client: TcpStream) {
    let (mut buffer, mut passed) = ([0; 4_096], 0);
    loop {
        let count = match server.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => count,
            Err(error) => {
                assert_eq!(error.kind(), ErrorKind::ConnectionReset);
                break;
            }
        };
        passed += count;
        if passed > 50_000 {
            buffer[count - 1] ^= 1;
        }
        if client.write_all(&buffer[..count]).is_err() {
            break;
        }
    }
    drop(server.shutdown(std::net::Shutdown::Both));
}

/// Reads a Hello: its nonce and cookie.
fn parts(hello: &[u8]) -> (Nonce, [u8; 16]) {
    assert_eq!((hello.len(), hello[3]), (HELLO, Kind::KeyedHello.code()));
    // Three axes; lock-step, and States with tags.
    assert_eq!(hello[8..12], [3, 0, 3, 0]);
    (
        hello[20..36].try_into().unwrap(),
        hello[36..52].try_into().unwrap(),
    )
}

/// The server asks for Hello after Hello. Over UDP the first is not answered, and said again.
fn challenges() {
    let files = KeyFiles::new();
    let key = Key::new(&CONTROL, Role::Control);
    let answer = |nonce: &Nonce, number: u8| {
        let mut frame = enclose(
            Kind::Challenge,
            &Challenge {
                cookie: [number; 16],
            },
        );
        frame.tag(key.greeting(), nonce);
        frame
    };
    let words =
        "gantry_tau: incompatible server: the server asks for another Hello after 8 of them\n";
    let listener = TcpListener::bind(LOOPBACK).unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let program = client(&address, Transport::Stream, Some(&files.path("control")));
    let (mut stream, _) = listener.accept().unwrap();
    stream.set_read_timeout(Some(DEADLINE)).unwrap();
    let mut hello = [0; HELLO];
    let mut first = None;
    for number in 1..=9 {
        stream.read_exact(&mut hello).unwrap();
        let (nonce, cookie) = parts(&hello);
        assert_eq!(*first.get_or_insert(nonce), nonce);
        assert_eq!(cookie, [number - 1; 16]);
        stream.write_all(&answer(&nonce, number)).unwrap();
    }
    assert_eq!(end_of(program), (Some(5), words.to_owned()));
    assert_eq!(stream.read(&mut hello).unwrap_or(0), 0, "no tenth Hello");

    let socket = UdpSocket::bind(LOOPBACK).unwrap();
    socket.set_read_timeout(Some(DEADLINE)).unwrap();
    let address = socket.local_addr().unwrap().to_string();
    let program = client(&address, Transport::Datagram, Some(&files.path("control")));
    let mut again = [0; HELLO + 1];
    let (count, peer) = socket.recv_from(&mut again).unwrap();
    let since = Instant::now();
    let (nonce, cookie) = parts(&again[..count]);
    assert!(cookie == [0; 16] && Some(nonce) != first);
    let first = again;
    assert_eq!(socket.recv_from(&mut again).unwrap(), (count, peer));
    assert!(since.elapsed() > Duration::from_millis(150), "{since:?}");
    assert_eq!(again, first);
    for number in 1..=9 {
        let challenge = answer(&nonce, number);
        // The second is none.
        for _ in 0..2 {
            socket.send_to(&challenge, peer).unwrap();
        }
        if number < 9 {
            while parts(&again[..count]).1 != [number; 16] {
                socket.recv(&mut again).unwrap();
            }
        }
    }
    assert_eq!(end_of(program), (Some(5), words.to_owned()));
}

/// A file that is taken leads to a server that is not there: exit code 3.
fn key_files() {
    let files = KeyFiles::new();
    let secret = hex(&CONTROL);
    let upper = secret.to_uppercase();
    let good = format!("gantry-tau-key 1\nrole control\nsecret {secret}\n");
    let line = |number: u8| format!(", line {number}: expected ");
    let mut cases = vec![
        (good.clone(), 3, "cannot be reached".to_owned()),
        (
            good.trim_end().to_owned(),
            3,
            "cannot be reached".to_owned(),
        ),
        (
            good.replace('\n', "\r\n"),
            3,
            "cannot be reached".to_owned(),
        ),
        (
            good.replace("control", "read"),
            3,
            "cannot be reached".to_owned(),
        ),
    ];
    let wrong = [
        (String::new(), 1),
        ("g".to_owned(), 1),
        (good.replace("key 1", "key 2"), 1),
        (format!("\u{feff}{good}"), 1),
        (format!("\n{good}"), 1),
        (good.replace('\n', "\r"), 1),
        (good.replace("role control\n", ""), 2),
        (good.replace("control", "owner"), 2),
        (good.replace("control", "control "), 2),
        (good.replace(&secret, &upper), 3),
        (good.replace(&secret, &secret[1..]), 3),
        (good.replace(&secret, &format!("{secret}0")), 3),
        (good.replace("secret ", "secret  "), 3),
        (good.replace("secret ", "key "), 3),
        (good.replace(&secret, ""), 3),
        (format!("{good}secret {secret}\n"), 4),
        (format!("{good}\n"), 4),
        (format!("{good}note 1\n"), 4),
        (format!("{good}{}", " ".repeat(1 << 20)), 4),
    ];
    cases.extend(wrong.map(|(text, number)| (text, 1, line(number))));
    let mut paths: Vec<(PathBuf, i32, String)> = cases
        .iter()
        .enumerate()
        .map(|(number, (text, code, words))| {
            let path = files.write(&format!("case {number}"), text.as_bytes(), 0o600);
            (path, *code, words.clone())
        })
        .collect();
    for mode in [0o640, 0o604, 0o620, 0o610, 0o644] {
        let path = files.write(&format!("mode {mode:o}"), good.as_bytes(), mode);
        let words = format!(
            "others may read or write it (mode {mode:04o}); run: chmod 600 {}",
            path.display()
        );
        paths.push((path, 1, words));
    }
    paths.push((
        files.write("mode 400", good.as_bytes(), 0o400),
        3,
        "cannot be reached".to_owned(),
    ));
    symlink(files.path("control"), files.path("link")).unwrap();
    let made = Command::new("mkfifo").arg(files.path("pipe")).status();
    assert!(made.unwrap().success());
    for (path, words) in [
        (
            files.path("link"),
            "is a symbolic link; name the file itself",
        ),
        (files.0.path().to_owned(), "is a folder; name a file"),
        (files.path("pipe"), "is a device, a pipe or a socket"),
        (
            PathBuf::from("/dev/zero"),
            "is a device, a pipe or a socket",
        ),
        (files.path("missing"), "No such file"),
        (PathBuf::new(), "No such file"),
    ] {
        paths.push((path, 1, words.to_owned()));
    }
    // One program for all: each takes a tenth of a second to begin.
    let gone = TcpListener::bind(LOOPBACK).unwrap().local_addr().unwrap();
    let script = "import sys; sys.path.insert(0, sys.argv[1]); import gantry_tau
for path in sys.argv[3:]:
    try:
        gantry_tau.run(None, sys.argv[2], key=path)
    except gantry_tau.Failure as failure:
        print(failure.exit_code, repr(failure), type(failure.__context__).__name__)";
    let output = python()
        .args(["-c", script])
        .arg(folder())
        .arg(gone.to_string())
        .args(paths.iter().map(|(path, ..)| path))
        .output()
        .unwrap();
    let said = [output.stdout, output.stderr]
        .map(|bytes| String::from_utf8(bytes).unwrap())
        .concat();
    assert_eq!(said.lines().count(), paths.len(), "{said}");
    for (line, (path, code, words)) in said.lines().zip(&paths) {
        let begins = format!("{code} ");
        let is_right = line.starts_with(&begins) && line.contains(words);
        assert!(is_right, "{}: {line}, not {code} {words}", path.display());
        assert!(
            *code == 3 || line.contains(&format!("key file {}", path.display())),
            "{line}"
        );
    }
    assert!(!said.contains(&secret[..8]), "{said}");
}
