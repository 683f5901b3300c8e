//! `gauges` on an emulated bus, run as a user runs it.

use std::io::Read;
use std::net::TcpStream;

use gantry_tau_labcomm::samples::Data;
use gantry_tau_labcomm::{Decoded, Decoder, Event};
use gantry_tau_server::links::gauges::GaugeReader;
use gantry_tau_system::dial::NEVER;

use crate::experiment::{PLAN, serve};
use crate::process::{Folder, Running, address_behind};

/// The program was built with EtherCAT.
const HAS_ETHERCAT: bool = cfg!(all(feature = "ethercat", target_os = "linux"));

/// Length of a count, µm: four edges of a period of 2 µm.
const UM_PER_COUNT: f64 = 0.5;
const FREE: &str = "127.0.0.1:0";

/// Gauges of these names, at positions 1, 2 and so on.
pub(crate) fn file(names: &[&str]) -> String {
    let gauges = (1..).zip(names).map(|(position, name)| {
        format!(
            "[[gauge]]\nname = \"{name}\"\nposition = {position}\nproduct = 0x13ED3052\num_per_count = {UM_PER_COUNT:?}\n"
        )
    });
    gauges.collect()
}

/// Starts gauges; returns their address, too.
pub(crate) fn start(folder: &Folder, name: &str, options: &[&str]) -> (Running, String) {
    let arguments = [
        &["gauges", "emulated", "gauges.toml", "--publish", FREE],
        options,
    ]
    .concat();
    let mut gauges = folder.start(name, &arguments);
    gauges.await_words("Ctrl-C");
    let address = address_behind(&gauges.stdout(), ") on ");
    (gauges, address)
}

#[test]
fn a_program_without_ethercat_says_so() {
    let folder = Folder::new("gauges-without");
    folder.write("gauges.toml", &file(&["x"]));
    let ended = folder.run(&[
        "gauges",
        "nosuch",
        "gauges.toml",
        "--publish",
        FREE,
        "--record",
        "run.csv",
    ]);
    assert!(
        !folder.path("run.csv").exists(),
        "a run without a row leaves no file"
    );
    if HAS_ETHERCAT {
        let said = ended.failure(8);
        let reasons = [
            "gantry-tau: there is no network interface nosuch",
            "gantry-tau: raw sockets are not permitted",
        ];
        assert!(
            reasons.iter().any(|reason| said.starts_with(reason)),
            "{said}"
        );
    } else {
        assert!(ended.failure(1).contains("built without EtherCAT"));
    }
}

#[test]
fn a_wrong_use_is_refused_before_the_bus_is_touched() {
    if !HAS_ETHERCAT {
        return;
    }
    let folder = Folder::new("gauges-usage");
    folder.write("gauges.toml", &file(&["x", "y"]));
    folder.write(
        "second.toml",
        &file(&["x"]).replace("position = 1", "position = 2"),
    );
    folder.write("bad.toml", &file(&["x"]).replace("0.5", "nan"));
    let emulated = ["gauges", "emulated"];
    for (arguments, code, reason) in [
        (
            &["gauges.toml", "--labcomm", FREE][..],
            1,
            "publishes three gauges; here are 2",
        ),
        (
            &["second.toml"],
            1,
            "second.toml: x: the emulated bus has the gauges at positions 1, 2",
        ),
        (&["bad.toml"], 1, "bad.toml: gauge[0].um_per_count: is NaN"),
        (&["none.toml"], 1, "none.toml"),
        (
            &["gauges.toml", "--show", "127.0.0.1:9"],
            1,
            "no gauges at 127.0.0.1:9",
        ),
        (&["gauges.toml", "--publish", "0.0.0.0:0"], 1, "--allow"),
        (
            &["gauges.toml", "--record", "x.mcap"],
            2,
            "expected FILE.csv",
        ),
        (&[], 2, "FILE.toml"),
    ] {
        // A later --publish counts as an error of its own.
        let mut all = [&emulated[..], arguments].concat();
        if !arguments.contains(&"--publish") {
            all.extend(["--publish", FREE]);
        }
        let ended = folder.run(&all);
        assert_eq!(ended.code, Some(code), "{all:?}: {}", ended.stderr);
        assert!(ended.stderr.contains(reason), "{all:?}: {}", ended.stderr);
    }
    let ended = folder.run(&[
        "gauges",
        "lo",
        "gauges.toml",
        "--publish",
        FREE,
        "--show",
        FREE,
    ]);
    assert!(ended.failure(1).contains("--show is for the emulated bus"));
}

/// The link, LabComm and the table have the same; a second run has a file of its own.
#[test]
fn lengths_are_published_and_recorded() {
    if !HAS_ETHERCAT {
        return;
    }
    let folder = Folder::new("gauges-published");
    folder.write("gauges.toml", &file(&["x", "y", "z"]));
    let options = ["--record", "run.csv", "--labcomm", FREE];
    let (mut gauges, address) = start(&folder, "gauges", &options);
    let address: std::net::SocketAddr = address.parse().unwrap();
    let mut reader = GaugeReader::connect(address, &NEVER).unwrap();
    let lengths = loop {
        if let Some(lengths) = reader.latest().unwrap() {
            break lengths;
        }
        std::thread::yield_now();
    };
    assert_eq!(lengths.lengths_m(), [0.0; 3]);
    let labcomm = address_behind(&gauges.stdout(), "LabComm on ");
    let mut stream = TcpStream::connect(labcomm).unwrap();
    let mut bytes = Vec::new();
    let mut decoded = Vec::new();
    gauges.await_that("three samples", |_| {
        let mut chunk = [0; 256];
        let read = stream.read(&mut chunk).unwrap();
        bytes.extend_from_slice(&chunk[..read]);
        let mut decoder = Decoder::<8, 4_096>::new(4_096);
        let mut rest = &bytes[..];
        decoded.clear();
        while let Decoded::Event { event, used } = decoder.decode(rest).unwrap() {
            rest = &rest[used..];
            if let Event::Data { value, .. } = event {
                decoded.push(value.read::<Data>().unwrap());
            }
        }
        decoded.len() >= 3
    });
    assert!(decoded.iter().all(|data| *data == Data([0; 3])));
    gauges.stop().success();
    let table = folder.read("run.csv");
    let mut rows = table.lines();
    assert_eq!(rows.next(), Some("tick,x_um,y_um,z_um"));
    let rows: Vec<&str> = rows.collect();
    assert!(
        rows.len() >= 3 && rows.iter().all(|row| row.ends_with(",0.000,0.000,0.000")),
        "{table}"
    );
    let ticks: Vec<u64> = (rows.iter())
        .map(|row| row.split(',').next().unwrap().parse().unwrap())
        .collect();
    assert!(ticks.windows(2).all(|pair| pair[0] < pair[1]));
    let (again, _) = start(&folder, "again", &options);
    again.stop().success();
    assert_eq!(folder.read("run.csv"), table);
    assert!(folder.read("run-2.csv").starts_with("tick,"));
}

/// Means of the gauges of [`PLAN`] by window, µm.
fn gauge_columns(table: &str) -> Vec<Vec<f64>> {
    let mut lines = table.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let columns: Vec<usize> = (0..header.len())
        .filter(|index| ["px_um", "axis1_um"].contains(&header[*index]))
        .collect();
    assert_eq!(columns.len(), 2, "{table}");
    let rows = lines.map(|line| {
        let fields: Vec<&str> = line.split(',').collect();
        columns
            .iter()
            .map(|index| fields[*index].parse().unwrap())
            .collect()
    });
    rows.collect()
}

/// A campaign over terminals is that over the simulated link: windows differ by half a count.
#[test]
fn a_campaign_over_terminals_gives_the_windows_of_the_simulated_link() {
    if !HAS_ETHERCAT {
        return;
    }
    let folder = Folder::new("gauges-campaign");
    folder.write("plan.toml", PLAN);
    folder.write("gauges.toml", &file(&["px", "axis1"]));
    let measured = |output: &str, through_terminals: bool| {
        let (server, [link, listen]) = serve(&folder);
        let terminals = through_terminals.then(|| start(&folder, output, &["--show", &link]));
        let at = terminals.as_ref().map_or(&link, |(_, address)| address);
        folder
            .run(&[
                "experiment",
                "plan.toml",
                "--unattended",
                "--server",
                &listen,
                "--gauges",
                at,
                "-o",
                output,
            ])
            .success();
        if let Some((gauges, _)) = terminals {
            gauges.stop().success();
        }
        server.stop().success();
        gauge_columns(&folder.read(output))
    };
    let direct = measured("direct.csv", false);
    let through = measured("through.csv", true);
    assert_eq!((direct.len(), through.len()), (3, 3));
    for gauge in 0..2 {
        let of = |rows: &[Vec<f64>]| rows.iter().map(|row| row[gauge]).collect::<Vec<f64>>();
        let (direct, through) = (of(&direct), of(&through));
        assert!(
            (direct[1] - direct[0]).abs() > 0.5,
            "a gauge that shows nothing: {direct:?}"
        );
        // The zero of a terminal is its count at the start: a whole number of them.
        let zero_um = ((direct[0] - through[0]) / UM_PER_COUNT).round() * UM_PER_COUNT;
        for (direct, through) in direct.iter().zip(&through) {
            let rounded_um = through + zero_um - direct;
            assert!(
                rounded_um.abs() < UM_PER_COUNT / 2.0 + 0.01,
                "{direct} um, {through} um"
            );
        }
    }
}
