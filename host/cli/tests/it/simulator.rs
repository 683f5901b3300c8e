//! `serve --plant socket:`: what it refuses. docs/simulators.md is run by `docs`, and everything that
//! a simulator can do wrong is in tests/tests/it/simulators.rs.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;

use serde_json::Value;

use crate::process::{Ended, Folder};

const LOCKSTEP: [&str; 2] = ["--pace", "lockstep"];

fn serve(folder: &Folder, plant: &str, options: &[&str]) -> Ended {
    let mut arguments = vec!["serve", "--listen", "127.0.0.1:0", "--plant", plant];
    arguments.extend(options);
    folder.run(&arguments)
}

#[test]
fn what_a_simulator_cannot_do_is_refused_before_it_is_reached() {
    let folder = Folder::new("simulator-options");
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.set_nonblocking(true).unwrap();
    let plant = format!("socket:{}", listener.local_addr().unwrap());
    let cases: [(&[&str], &str); 7] = [
        (&[], "goes in lock-step only: --pace lockstep"),
        (
            &["--motion", "10"],
            "--motion needs drives of this program: the path is the simulator's",
        ),
        (
            &["--tap", "100,20"],
            "--tap and --milling need a simulated tool",
        ),
        (
            &["--milling", "100"],
            "--tap and --milling need a simulated tool",
        ),
        (
            &["--force-max", "100"],
            "--force-max and --step-seconds need a simulated tool",
        ),
        (
            &["--step-seconds", "1"],
            "--force-max and --step-seconds need a simulated tool",
        ),
        (
            &["--quasi-static"],
            "need the simulated machine: --plant simulated",
        ),
    ];
    for (options, reason) in cases {
        let pace: &[&str] = if options.is_empty() { &[] } else { &LOCKSTEP };
        let said = serve(&folder, &plant, &[options, pace].concat()).failure(1);
        assert!(said.contains(reason), "{options:?}: {said}");
    }
    assert!(listener.accept().is_err(), "none of them has connected");
}

#[test]
fn a_simulator_that_is_not_there_is_an_error() {
    let folder = Folder::new("simulator-missing");
    // A port that was free a moment ago.
    let free = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let said = serve(&folder, &format!("socket:{free}"), &LOCKSTEP).failure(1);
    assert_eq!(
        said,
        format!("gantry-tau: the machine at {free} could not be reached: Connection refused")
    );
    for address in ["socket:", "socket:7020", "socket:127.0.0.1"] {
        let said = serve(&folder, address, &LOCKSTEP).failure(2);
        assert!(
            said.contains(&format!("invalid value '{address}'")),
            "{said}"
        );
    }
}

/// Keys of an object and of those in it, in no order.
fn keys(value: &Value) -> Vec<String> {
    let Value::Object(fields) = value else {
        return Vec::new();
    };
    let below = |(key, value): (&String, &Value)| {
        let inner = keys(value)
            .into_iter()
            .map(move |inner| format!("{key}.{inner}"));
        std::iter::once(key.clone())
            .chain(inner.collect::<Vec<_>>())
            .collect::<Vec<_>>()
    };
    let mut all: Vec<String> = fields.iter().flat_map(below).collect();
    all.sort();
    all
}

/// The server says what docs/simulators.md shows, call by call, and takes the answers of the page.
#[test]
fn the_exchange_of_the_page_is_what_is_said() {
    let page = std::fs::read_to_string(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../docs/simulators.md"
    ));
    let page = page.unwrap().replace(",\n   \"axes\"", ",\"axes\"");
    let lines = |sign: &str| -> Vec<Value> {
        let said = page.lines().filter_map(|line| line.strip_prefix(sign));
        said.filter_map(|line| serde_json::from_str(line).ok())
            .collect()
    };
    let (calls, answers) = (lines("> "), lines("< "));
    assert_eq!((calls.len(), answers.len()), (5, 5));
    let folder = Folder::new("simulator-page");
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let plant = format!("socket:{}", listener.local_addr().unwrap());
    let mut serve = vec!["serve", "--listen", "127.0.0.1:0", "--plant", &plant];
    serve.extend(LOCKSTEP);
    let _server = folder.start("serve", &serve);
    let (stream, _) = listener.accept().unwrap();
    let mut port = BufReader::new(stream);
    for (call, answer) in calls.iter().zip(&answers) {
        let mut said = String::new();
        port.read_line(&mut said).unwrap();
        let said: Value = serde_json::from_str(&said).unwrap();
        assert_eq!((&said["n"], &said["call"]), (&call["n"], &call["call"]));
        assert_eq!(keys(&said), keys(call), "{said}");
        writeln!(port.get_mut(), "{answer}").unwrap();
    }
    // The last answer was taken.
    let mut next = String::new();
    port.read_line(&mut next).unwrap();
    assert!(next.contains(r#""n":6,"call":"read""#), "{next}");
}
