//! `client` at the hands of an operator who types `[T 4.2.4]`, over real pipes.

use std::process::Stdio;

use crate::process::{Folder, Running};
use crate::signals::{assert_no_jump, await_obtain, rows, serve_pulling};

/// Starts a client whose standard input is a pipe.
fn operated(folder: &Folder, server: &str, further: &[&str]) -> Running {
    let arguments = [&["client", server][..], further].concat();
    folder.start_with("operated", &arguments, Stdio::piped())
}

/// Types a line, and waits until the process has said something that it had not said before.
fn typed(client: &mut Running, line: &str, answer: &str) {
    let before = client.said().matches(answer).count();
    client.write(&format!("{line}\n"));
    client.await_that(answer, |client| {
        client.said().matches(answer).count() > before
    });
}

/// Waits for so many bytes more of the server's record: each row has some 350.
fn await_rows(folder: &Folder, server: &mut Running, count: u64) {
    let path = folder.path("serve.csv");
    let enough = path.metadata().unwrap().len() + 350 * count;
    server.await_that("more rows", |_| path.metadata().unwrap().len() > enough);
}

/// Offsets of the second axis, um, in Obtain, where the tool has been pulled with 60 N for 200
/// ticks.
fn settled_um(folder: &Folder) -> Vec<f64> {
    let csv = folder.read("serve.csv");
    let mut lines = csv.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let [state, offset, force] = ["state", "offset_2_nm", "force_x_n"]
        .map(|name| header.iter().position(|column| *column == name).unwrap());
    let mut pulled = 0;
    let mut settled = Vec::new();
    for line in lines {
        let fields: Vec<&str> = line.split(',').collect();
        pulled = if fields[force] == "60" && fields[state] == "Obtain" {
            pulled + 1
        } else {
            0
        };
        if pulled > 200 {
            settled.push(fields[offset].parse::<f64>().unwrap() * 1e-3);
        }
    }
    settled
}

#[test]
fn the_operator_switches_submit_obtain_and_gain_without_a_jump() {
    let folder = Folder::new("operator");
    let (mut server, addresses) = serve_pulling(&folder, ["60", "0.5"], &["--record", "serve.csv"]);
    let mut client = operated(&folder, &addresses, &[]);
    await_obtain(&mut server, 1);
    typed(
        &mut client,
        "fly",
        "unknown command \"fly\": expected submit, obtain, gain X (0 to 1), status or quit",
    );
    typed(
        &mut client,
        "gain 1.5",
        "gain \"1.5\" is not a number from 0 to 1",
    );
    typed(&mut client, "status", ", obtain: offsets ");
    await_rows(&folder, &mut server, 2_400);
    for gain in ["0", "0.5"] {
        typed(
            &mut client,
            &format!("gain {gain}"),
            &format!("gain {gain}: the server moves the offsets"),
        );
        await_rows(&folder, &mut server, 2_400);
    }
    typed(&mut client, "submit", "submitting: ");
    server.await_words("Obtain -> Submit");
    typed(
        &mut client,
        "status",
        ", submit: offsets 0.0, 0.0, 0.0 um, computed ",
    );
    client.write("obtain\n");
    await_obtain(&mut server, 2);
    client.write("quit\n");
    let ended = client.end();
    assert!(
        !ended.stderr.contains("obtaining as soon as"),
        "{}",
        ended.stderr
    );
    let said = ended.success();
    assert!(said.contains("left with Goodbye after "), "{said}");
    server.await_words("SafeDisconnect -> Listening");
    server.stop().success();

    assert_no_jump(&rows(&folder));
    // 300 N ask for -238 um of the second axis (robots/l2.toml): 60 N for 48 um.
    let settled = settled_um(&folder);
    for expected_um in [-47.6, 0.0, -23.8] {
        let near = settled
            .iter()
            .filter(|offset| (*offset - expected_um).abs() < 1.5)
            .count();
        assert!(near > 100, "{expected_um}: {near} of {}", settled.len());
    }
}

/// A load beyond what the offsets may compensate: cut at the limit, reported once, counted and
/// recorded.
#[test]
fn a_correction_that_is_cut_is_told_and_counted() {
    let folder = Folder::new("operator-cut");
    let l2 = include_str!("../../../../robots/l2.toml");
    folder.write(
        "narrow.toml",
        &l2.replacen(
            "max_um = [2000.0, 2000.0, 2000.0]",
            "max_um = [34.0, 34.0, 34.0]",
            1,
        ),
    );
    let robot = ["--robot", "narrow.toml"];
    let further = [["--record", "serve.csv"].as_slice(), &robot].concat();
    let (mut server, addresses) = serve_pulling(&folder, ["60", "0.3"], &further);
    let mut client = operated(
        &folder,
        &addresses,
        &[["--record", "client.csv"].as_slice(), &robot].concat(),
    );
    await_obtain(&mut server, 1);
    client.await_words("the correction is cut at the limit of the offset");
    await_rows(&folder, &mut server, 1_500);
    client.write("quit\n");
    let ended = client.end();
    assert_eq!(
        ended.stderr.matches("the correction is cut").count(),
        1,
        "{}",
        ended.stderr
    );
    let said = ended.success();
    server.await_words("SafeDisconnect -> Listening");
    server.stop().success();
    let [of_their_own, answered] = ["of their own, ", "left with Goodbye after "].map(|before| {
        let rest = said.split_once(before).unwrap().1;
        rest[..rest.find(' ').unwrap()].parse::<usize>().unwrap()
    });
    let csv = folder.read("client.csv");
    let cut = csv
        .lines()
        .skip(1)
        .filter(|line| !line.ends_with(",0"))
        .count();
    assert!(cut > 300, "{cut}");
    assert_eq!(of_their_own, cut, "{said}");
    // Every State of the session, and the one that acknowledges the Goodbye.
    let answers = rows(&folder)
        .iter()
        .filter(|row| ["Handshake", "Submit", "Obtain"].contains(&row.state.as_str()))
        .count();
    assert_eq!(answered, answers + 1, "{said}");
    // 60 N ask for (-38, -48, -30) um: more on two axes, bits 0 and 1.
    assert!(
        csv.lines().any(|line| line.ends_with(",3")),
        "{:?}",
        csv.lines().last()
    );
}

#[test]
fn the_end_of_the_input_is_no_quit() {
    let folder = Folder::new("operator-gone");
    let (mut server, addresses) = serve_pulling(&folder, ["60", "0.5"], &[]);
    let mut client = operated(&folder, &addresses, &["--submit-only"]);
    // Typed before the tare is done; the last line has no end.
    client.write("gain 0.5\nobtain\nstat");
    client.close_input();
    client.await_words("obtaining as soon as the force sensor is tared");
    await_obtain(&mut server, 1);
    client.await_words("unknown command \"stat\"");
    let said = client.stop().success();
    assert!(said.starts_with("left with Goodbye after "), "{said}");
    server.stop().success();
}
