//! `monitor --web`: the page, its pictures, and requests that are refused.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_test_support::labcomm_port::{Double, Named, Scene};
use serde_json::Value;

use crate::process::{Folder, Running};

const PATIENCE: Duration = Duration::from_secs(30);

/// Starts a monitor with a page; returns it and the page's address.
fn start(folder: &Folder, double: &Double, more: &[&str]) -> (Running, SocketAddr) {
    page_of(folder, double.address, more)
}

/// The same for any server.
pub(super) fn page_of(folder: &Folder, server: SocketAddr, more: &[&str]) -> (Running, SocketAddr) {
    let server = server.to_string();
    let mut monitor = folder.start(
        "page",
        &[&["monitor", &server, "--web", "127.0.0.1:0"], more].concat(),
    );
    monitor.await_words("page on http://");
    let said = monitor.stdout();
    let address = said
        .split_once("http://")
        .unwrap()
        .1
        .split_once('/')
        .unwrap()
        .0;
    (monitor, address.parse().unwrap())
}

/// Sends bytes; returns the answer to its end.
fn answer(page: SocketAddr, request: &[u8]) -> String {
    let mut stream = TcpStream::connect(page).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    // A server that has refused already may not take the rest.
    let _ = stream.write_all(request);
    let mut bytes = Vec::new();
    let _ = stream.read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

pub(super) fn get(page: SocketAddr, path: &str) -> String {
    answer(
        page,
        format!("GET {path} HTTP/1.1\r\nHost: {page}\r\n\r\n").as_bytes(),
    )
}

/// A reader of the pictures.
pub(super) struct Reader(BufReader<TcpStream>);

impl Reader {
    pub(super) fn of(page: SocketAddr) -> Self {
        let mut stream = TcpStream::connect(page).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        write!(
            stream,
            "GET /live HTTP/1.1\r\nHost: {page}\r\nOrigin: http://{page}\r\n\r\n"
        )
        .unwrap();
        Self(BufReader::new(stream))
    }

    /// The next event of a kind, `message` for a picture.
    pub(super) fn next(&mut self, kind: &str) -> Value {
        let (mut named, mut data) = (String::from("message"), None);
        loop {
            let mut line = String::new();
            let count = self.0.read_line(&mut line).unwrap();
            assert!(count > 0, "the pictures end");
            if let Some(name) = line.strip_prefix("event: ") {
                name.trim_end().clone_into(&mut named);
            } else if let Some(json) = line.strip_prefix("data: ") {
                data = Some(serde_json::from_str(json).unwrap());
            } else if line == "\n" {
                match data.take() {
                    Some(data) if named == kind => return data,
                    _ => "message".clone_into(&mut named),
                }
            }
        }
    }
}

#[test]
fn pictures_have_the_status_the_machine_and_the_events() {
    let folder = Folder::new("monitor_page");
    let double = Double::of(Scene::of(Phase::Obtain, Cause::Goodbye));
    let (monitor, page) = start(&folder, &double, &[]);
    let mut readers = [(); 3].map(|()| Reader::of(page));
    for reader in &mut readers {
        let machine = reader.next("machine");
        assert_eq!(
            (&machine["axes"], machine["arms"].as_array().unwrap().len()),
            (&3.into(), 3)
        );
        let picture = loop {
            let picture = reader.next("message");
            if picture["live"] == true {
                break picture;
            }
        };
        assert_eq!(picture["status"]["phase"], "obtain");
        assert_eq!(
            picture["figure"]["tool_displacement"],
            serde_json::json!([1e-4, -5e-5, 2e-5])
        );
        // Cart 1 slides along x; its offset is -10 µm.
        assert_eq!(
            picture["figure"]["cart_offsets"][0],
            serde_json::json!([-1e-5, 0.0, 0.0])
        );
        let later = reader.next("message");
        assert!(later["status"]["tick"].as_i64() > picture["status"]["tick"].as_i64());
    }
    let status = get(page, "/status");
    let (head, body) = status.split_once("\r\n\r\n").unwrap();
    assert!(
        head.starts_with("HTTP/1.1 200 OK\r\nContent-Type: application/json"),
        "{head}"
    );
    let mut of_page: Value = serde_json::from_str(body).unwrap();
    let said = super::status(&folder, &double).success();
    let mut of_command: Value = serde_json::from_str(&said).unwrap();
    for status in [&mut of_page, &mut of_command] {
        // What differs from tick to tick, and the lag of the first.
        for key in ["tick", "sequence"] {
            status[key] = Value::Null;
        }
        for axis in status["axes"].as_array_mut().unwrap() {
            axis["lag_nm"] = Value::Null;
        }
    }
    assert_eq!(of_page, of_command);
    drop(monitor);
}

#[test]
fn a_lost_server_is_told_to_the_readers_and_nothing_old_is_told_as_new() {
    let folder = Folder::new("monitor_page_lost");
    let double = Double::of(Scene::of(Phase::Submit, Cause::None));
    let (_monitor, page) = start(&folder, &double, &[]);
    let mut reader = Reader::of(page);
    while reader.next("message")["live"] != true {}
    drop(double);
    let lost = loop {
        let picture = reader.next("message");
        if picture["live"] == false {
            break picture;
        }
    };
    assert!(
        lost["trouble"].as_str().unwrap().contains("server"),
        "{lost}"
    );
    assert_eq!(lost["status"], Value::Null);
    assert!(get(page, "/status").starts_with("HTTP/1.1 503 "));
}

#[test]
fn another_machine_than_the_robot_files_is_not_drawn() {
    let folder = Folder::new("monitor_page_robot");
    let double = Double::of(Scene::of(Phase::Submit, Cause::None));
    let (_monitor, page) = start(&folder, &double, &["--robot", "f1"]);
    let mut reader = Reader::of(page);
    let picture = loop {
        let picture = reader.next("message");
        if picture["live"] == true {
            break picture;
        }
    };
    assert_eq!(picture["figure"], Value::Null);
    assert_eq!(picture["status"]["axes"].as_array().unwrap().len(), 3);
}

/// Found from outside: the page drew the built-in L2 at the positions of a smaller machine, and
/// called it live.
#[test]
fn a_machine_of_other_kinematics_or_without_a_name_is_not_drawn() {
    let folder = Folder::new("monitor_page_machine");
    for (machine, words) in [
        (
            Named::Other,
            &["small.toml (kinematics 0badcafe)", "--robot"][..],
        ),
        (
            Named::None,
            &["Unknown machine", "session_event,drives,machine"],
        ),
    ] {
        let double = Double::of(Scene {
            machine,
            ..Scene::of(Phase::Submit, Cause::None)
        });
        let (_monitor, page) = start(&folder, &double, &[]);
        let mut reader = Reader::of(page);
        let picture = loop {
            let picture = reader.next("message");
            if picture["live"] == true {
                break picture;
            }
        };
        assert_eq!(picture["figure"], Value::Null);
        let said = picture["stranger"].as_str().unwrap();
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
    }
}

/// The page draws the machine whose robot file the server sends, and no built-in one.
#[test]
fn a_machine_whose_robot_file_is_sent_is_drawn() {
    let folder = Folder::new("monitor_page_sent");
    let double = Double::of(Scene {
        machine: Named::Sent,
        ..Scene::of(Phase::Submit, Cause::None)
    });
    let (_monitor, page) = start(&folder, &double, &[]);
    let mut reader = Reader::of(page);
    assert_eq!(reader.next("machine")["name"], "small.toml");
    let picture = loop {
        let picture = reader.next("message");
        if picture["live"] == true {
            break picture;
        }
    };
    assert_eq!(picture["stranger"], Value::Null);
    // The links of arm 3, which are the longest of this machine, are drawn with their length.
    let figure = &picture["figure"];
    let length = (0..3)
        .map(|axis| {
            let [joint, on_platform] =
                ["joints", "platform"].map(|end| figure[end][5][axis].as_f64().unwrap());
            (joint - on_platform).powi(2)
        })
        .sum::<f64>()
        .sqrt();
    assert!((length - 1.01).abs() < 2e-5, "{length}");
}

/// A recording without `--robot` is that of the machine whose robot file the server sends.
#[test]
fn a_machine_whose_robot_file_is_sent_is_recorded() {
    let folder = Folder::new("monitor_record_sent");
    let double = Double::of(Scene {
        machine: Named::Sent,
        ..Scene::of(Phase::Submit, Cause::None)
    });
    let address = double.address.to_string();
    for file in ["sent.csv", "sent.mcap"] {
        let ended = folder.run(&["monitor", &address, "--record", file, "--quit-after", "1"]);
        assert!(ended.stderr.contains("recorded "), "{}", ended.stderr);
        ended.success();
    }
    let origin: Value = serde_json::from_str(&folder.read("sent.csv.json")).unwrap();
    assert_eq!(origin["robot"], "small.toml");
    #[cfg(unix)]
    {
        let bytes = std::fs::read(folder.path("sent.mcap")).unwrap();
        assert_eq!(
            crate::recording::mcap::origin(&bytes)["robot"],
            "small.toml"
        );
        let samples = crate::recording::mcap::samples(&bytes);
        assert!(!samples.of("scene").is_empty());
    }
}

/// As the page: what would be drawn wrong is not recorded, and the reason is told.
#[test]
fn a_machine_of_other_kinematics_is_not_recorded_as_this_one() {
    let folder = Folder::new("monitor_record_machine");
    for (machine, file, words) in [
        (
            Named::Other,
            "other.csv",
            "the server's machine has kinematics 0badcafe",
        ),
        (
            Named::Other,
            "other.mcap",
            "the server's machine has kinematics 0badcafe",
        ),
        (
            Named::None,
            "none.mcap",
            "does not say which machine it has",
        ),
    ] {
        let double = Double::of(Scene {
            machine,
            ..Scene::of(Phase::Submit, Cause::None)
        });
        let address = double.address.to_string();
        let ended = folder.run(&["monitor", &address, "--record", file, "--quit-after", "1"]);
        assert!(ended.stderr.contains(words), "{file}: {}", ended.stderr);
    }
}

#[test]
fn the_page_needs_nothing_else_and_runs_only_its_own_script() {
    let folder = Folder::new("monitor_page_policy");
    let double = Double::of(Scene::of(Phase::Submit, Cause::None));
    let (_monitor, page) = start(&folder, &double, &[]);
    let (first, second) = (get(page, "/"), get(page, "/"));
    let (head, body) = first.split_once("\r\n\r\n").unwrap();
    let policy = head
        .lines()
        .find(|line| line.starts_with("Content-Security-Policy: "))
        .unwrap();
    assert!(
        policy.starts_with("Content-Security-Policy: default-src 'none'; "),
        "{policy}"
    );
    assert!(
        !policy.contains("unsafe") && !policy.contains('*'),
        "{policy}"
    );
    let nonce = policy
        .split_once("'nonce-")
        .unwrap()
        .1
        .split_once('\'')
        .unwrap()
        .0;
    assert_eq!(nonce.len(), 32);
    assert!(!second.contains(nonce), "another nonce each time");
    assert_eq!(
        body.matches("<script").count(),
        body.matches(&format!("<script nonce=\"{nonce}\"")).count()
    );
    assert_eq!(
        body.matches("<style").count(),
        body.matches(&format!("<style nonce=\"{nonce}\"")).count()
    );
    for word in [
        "http://",
        "https://",
        " src=",
        "@import",
        "url(",
        "innerHTML",
        "eval(",
        "NONCE",
        "STYLE",
        "SCRIPT",
    ] {
        assert!(!body.contains(word), "{word}");
    }
    for field in [
        "X-Content-Type-Options: nosniff",
        "X-Frame-Options: DENY",
        "Cache-Control: no-store",
    ] {
        assert!(head.contains(field), "{field}");
    }
}

/// Bytes of a request with further fields.
fn request(page: SocketAddr, line: &str, fields: &str) -> Vec<u8> {
    format!("{line} HTTP/1.1\r\nHost: {page}\r\n{fields}\r\n").into_bytes()
}

#[test]
fn hostile_requests_are_refused_and_the_page_goes_on() {
    let folder = Folder::new("monitor_page_hostile");
    let double = Double::of(Scene::of(Phase::Submit, Cause::None));
    let (_monitor, page) = start(&folder, &double, &[]);
    let long = format!("X: {}\r\n", "a".repeat(100_000));
    let many = "X: y\r\n".repeat(1_000);
    let cases: [(&str, Vec<u8>); 19] = [
        (
            "421",
            b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n".to_vec(),
        ),
        (
            "421",
            format!(
                "GET / HTTP/1.1\r\nHost: evil.example:{}\r\n\r\n",
                page.port()
            )
            .into_bytes(),
        ),
        ("421", b"GET / HTTP/1.1\r\n\r\n".to_vec()),
        ("421", request(page, "GET /", &format!("Host: {page}\r\n"))),
        (
            "403",
            request(page, "GET /live", "Origin: http://evil.example\r\n"),
        ),
        ("403", request(page, "GET /live", "Origin: null\r\n")),
        (
            "403",
            request(page, "GET /status", &format!("Origin: https://{page}\r\n")),
        ),
        ("405", request(page, "POST /", "Content-Length: 3\r\n")),
        ("405", request(page, "DELETE /live", "")),
        ("405", request(page, "OPTIONS *", "")),
        ("405", request(page, "CONNECT evil.example:80", "")),
        ("400", request(page, "GET /", "Content-Length: 3\r\n")),
        (
            "400",
            request(page, "GET /", "Transfer-Encoding: chunked\r\n"),
        ),
        ("404", request(page, "GET /../../etc/passwd", "")),
        ("404", request(page, "GET http://evil.example/", "")),
        ("431", request(page, "GET /", &long)),
        ("431", request(page, "GET /", &many)),
        (
            "400",
            b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03".to_vec(),
        ),
        ("400", vec![0; 100_000]),
    ];
    for (code, request) in cases {
        let said = answer(page, &request);
        let front = String::from_utf8_lossy(&request[..request.len().min(60)]).into_owned();
        assert!(
            said.starts_with(&format!("HTTP/1.1 {code} ")),
            "{front:?}: {said}"
        );
    }
    assert!(get(page, "/").starts_with("HTTP/1.1 200 OK"));
}

#[test]
fn slow_requests_are_ended_and_slow_readers_dropped_while_others_see_every_tick() {
    let folder = Folder::new("monitor_page_slow");
    let double = Double::of(Scene::of(Phase::Submit, Cause::None));
    let (mut monitor, page) = start(&folder, &double, &[]);
    // One byte of the head after the other.
    let mut slow = TcpStream::connect(page).unwrap();
    let began = Instant::now();
    let mut said = Vec::new();
    // Bytes that come after the answer reset the connection, and may take the answer with them.
    let mut was_reset = false;
    slow.set_read_timeout(Some(Duration::from_millis(50)))
        .unwrap();
    while said.is_empty() && !was_reset {
        assert!(began.elapsed() < PATIENCE);
        let _ = slow.write_all(b"G");
        let mut chunk = [0; 512];
        match slow.read(&mut chunk) {
            Ok(0) => break,
            Ok(count) => said.extend_from_slice(&chunk[..count]),
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) => {}
            Err(_) => was_reset = true,
        }
    }
    // `GGG` is a method that has no end, or that took too long.
    assert!(
        was_reset || said.starts_with(b"HTTP/1.1 4"),
        "{}",
        String::from_utf8_lossy(&said)
    );
    // A reader that takes nothing.
    let mut still = TcpStream::connect(page).unwrap();
    write!(still, "GET /live HTTP/1.1\r\nHost: {page}\r\n\r\n").unwrap();
    let mut reader = Reader::of(page);
    monitor.await_that("a slow reader is dropped", |monitor| {
        let picture = reader.next("message");
        assert!(picture["live"] == false || picture["status"]["phase"] == "submit");
        monitor.stdout().contains("was dropped") || monitor.stderr().contains("was dropped")
    });
    drop(still);
}

#[test]
fn connections_are_bounded() {
    let folder = Folder::new("monitor_page_many");
    let double = Double::of(Scene::of(Phase::Submit, Cause::None));
    let (_monitor, page) = start(&folder, &double, &[]);
    let idle: Vec<TcpStream> = (0..100)
        .map(|_| TcpStream::connect(page).unwrap())
        .collect();
    // Those that say nothing are ended after two seconds, and then there is room again.
    let began = Instant::now();
    while !get(page, "/").starts_with("HTTP/1.1 200 OK") {
        assert!(began.elapsed() < PATIENCE);
        std::thread::sleep(Duration::from_millis(20));
    }
    drop(idle);
}

#[test]
fn a_page_for_other_machines_needs_their_names() {
    let folder = Folder::new("monitor_page_allow");
    let said = folder.run(&["monitor", "--web", "0.0.0.0:0"]).failure(1);
    assert!(said.contains("--allow"), "{said}");
    folder
        .run(&[
            "monitor",
            "--web",
            "0.0.0.0:0",
            "--allow",
            "127.0.0.1",
            "--quit-after",
            "0.05",
        ])
        .success();
    let said = folder
        .run(&["monitor", "--web", "127.0.0.1:0", "--allow", "here"])
        .failure(1);
    assert!(said.contains("\"here\""), "{said}");
    let double = Double::of(Scene::of(Phase::Submit, Cause::None));
    let (_monitor, page) = start(&folder, &double, &["--allow", "10.0.0.0/8"]);
    assert_eq!(get(page, "/"), "", "loopback is not in that network");
}
