//! `serve --plant socket:`: what it refuses. docs/simulators.md is run by `docs`, and everything that
//! a simulator can do wrong is in tests/tests/it/simulators.rs.

use std::net::TcpListener;

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
    let cases: [(&[&str], &str); 5] = [
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
