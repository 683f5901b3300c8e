//! Samples of `serve` over LabComm, and a client that takes its force from them, over real sockets.

use std::collections::HashMap;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::process::Stdio;
use std::time::Duration;

use gantry_tau_labcomm::samples::{Axes, Data, ForceSensor, SessionEvent, State, Tool};
use gantry_tau_labcomm::{Decoded, Decoder, Event, Version};
use gantry_tau_test_support::recordings::csv_rows;
use socket2::{Domain, Socket, Type};

use crate::process::{Folder, Running};
use crate::signals::{assert_no_jump, await_obtain, rows, serve_pulling};

const ALL: &str = "127.0.0.1:0=data,forcesensor,state,axes,tool,session_event";

/// Addresses of the LabComm ports, in the order of the options.
pub(crate) fn ports(server: &mut Running) -> Vec<SocketAddr> {
    server.await_words("; Ctrl-C");
    let said = server.stdout();
    let listed = said.split(", LabComm on ").skip(1);
    listed
        .map(|rest| rest.split([',', ';']).next().unwrap().parse().unwrap())
        .collect()
}

/// Reads until the server closes. A reader that is behind by more than the buffers hold is dropped,
/// as it should be; so that a busy machine does not make this one such a reader, its own buffer
/// holds seconds.
fn read_all(address: SocketAddr) -> std::thread::JoinHandle<Vec<u8>> {
    let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
    socket.set_recv_buffer_size(1 << 22).unwrap();
    socket.connect(&address.into()).unwrap();
    let mut stream = TcpStream::from(socket);
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        bytes
    })
}

/// Rows of the server's record by their ticks; each a map from column to text.
pub(crate) fn record(folder: &Folder) -> HashMap<i64, HashMap<String, String>> {
    csv_rows(&folder.path("serve.csv"))
}

/// Compares every sample with the record of the same run; returns the number of ticks, and the
/// texts of the events.
fn compare(
    bytes: &[u8],
    version: Version,
    record: &HashMap<i64, HashMap<String, String>>,
) -> (usize, Vec<String>) {
    let mut decoder = Decoder::<8, 4_096>::new(4_096);
    let (mut rest, mut ticks, mut texts) = (bytes, Vec::new(), Vec::new());
    let mut wrench = None;
    while let Decoded::Event { event, used } = decoder.decode(rest).unwrap() {
        rest = &rest[used..];
        let Event::Data { definition, value } = event else {
            continue;
        };
        if definition.is::<Axes<3>>() {
            let axes: Axes<3> = value.read().unwrap();
            let row = &record[&axes.tick];
            for (axis, number) in axes.axis.iter().zip(1..) {
                let columns = [
                    ("nominal_{}_nm", axis.nominal_nm),
                    ("reference_{}_nm", axis.reference_nm),
                    ("offset_{}_nm", axis.position_offset_nm.into()),
                    ("velocity_offset_{}_um_s", axis.velocity_offset_um_s.into()),
                    (
                        "torque_offset_{}_permille",
                        axis.torque_offset_permille.into(),
                    ),
                    ("shadow_{}_nm", axis.shadow_nm.into()),
                    ("actual_{}_nm", axis.actual_nm),
                    ("actual_velocity_{}_um_s", axis.actual_velocity_um_s.into()),
                    (
                        "actual_torque_{}_permille",
                        axis.actual_torque_permille.into(),
                    ),
                    ("flags_{}", axis.flags.into()),
                ];
                for (column, sent) in columns {
                    let column = column.replace("{}", &format!("{number}"));
                    assert_eq!(row[&column], i64::to_string(&sent), "{column}");
                }
            }
            ticks.push(axes.tick);
        } else if definition.is::<State>() {
            let state: State = value.read().unwrap();
            assert_eq!(record[&state.tick]["missed"], state.counters[1].to_string());
            assert_eq!(
                record[&state.tick]["ramp_ticks_left"],
                state.ramp_ticks_left.to_string()
            );
        } else if definition.is::<Tool>() {
            let tool: Tool = value.read().unwrap();
            assert_eq!(record[&tool.tick]["force_x_n"], tool.load[0].to_string());
        } else if definition.is::<ForceSensor>() {
            wrench = Some(value.read::<ForceSensor>().unwrap());
        } else if definition.is::<SessionEvent>() {
            let event: SessionEvent = value.read().unwrap();
            texts.push(String::from_utf8(event.text.as_bytes().to_vec()).unwrap());
        } else {
            assert!(definition.is::<Data>());
        }
    }
    assert_eq!((rest, decoder.version()), (&[][..], Some(version)));
    assert!(
        wrench
            .unwrap()
            .0
            .iter()
            .all(|component| component.is_finite())
    );
    assert!(
        ticks.windows(2).all(|pair| pair[1] == pair[0] + 1),
        "each tick once"
    );
    (ticks.len(), texts)
}

#[test]
fn a_client_compensates_by_labcomm_and_readers_get_what_is_recorded() {
    for (generation, version) in [
        ("2006", Version::V2006),
        ("2014", Version::V2014),
        ("2014.0", Version::V2014_0),
    ] {
        let folder = Folder::new(&format!("publication-{generation}"));
        let further = [
            "--record",
            "serve.csv",
            "--labcomm",
            "127.0.0.1:0",
            "--labcomm",
            ALL,
            "--labcomm-version",
            generation,
        ];
        let (mut server, address) = serve_pulling(&folder, ["60", "0.5"], &further);
        let ports = ports(&mut server);
        let reader = read_all(ports[1]);
        // The stream carries gauges too, which the client walks over.
        let sensor = format!("labcomm:{}", ports[0]);
        let client = folder.start_with(
            "client",
            &["client", &address, "--sensor", &sensor],
            Stdio::null(),
        );
        await_obtain(&mut server, 1);
        server.await_that("Obtain", |_| {
            folder.read("serve.csv").matches(",Obtain,").count() > 1_500
        });
        let said = client.stop().success();
        assert!(said.contains("left with Goodbye after "), "{said}");
        server.await_words("SafeDisconnect -> Listening");
        server.stop().success();
        let record = record(&folder);
        let (ticks, texts) = compare(&reader.join().unwrap(), version, &record);
        assert!(ticks > 2_000, "{ticks}");
        for text in ["session granted", "Submit -> Obtain", "session ended"] {
            assert!(
                texts.iter().any(|seen| seen.starts_with(text)),
                "{text}: {texts:?}"
            );
        }
        assert_no_jump(&rows(&folder));
        // 60 N ask for -47.6 um of the second axis (robots/l2.toml).
        let least = record.values().filter(|row| row["state"] == "Obtain");
        let least = least
            .map(|row| row["offset_2_nm"].parse::<f64>().unwrap())
            .fold(0.0, f64::min);
        assert!((-50e3..-45e3).contains(&least), "{least}");
    }
}

/// A connection that takes as little as the system allows, from an address of this computer.
fn narrow(from: [u8; 4], to: SocketAddr) -> TcpStream {
    let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
    socket.set_recv_buffer_size(1).unwrap();
    socket.bind(&SocketAddr::from((from, 0)).into()).unwrap();
    socket.connect(&to.into()).unwrap();
    socket.into()
}

#[test]
fn readers_of_any_conduct_cost_no_tick_and_strangers_get_nothing() {
    let folder = Folder::new("publication-crowd");
    let further = [
        "--record",
        "serve.csv",
        "--allow",
        "127.0.0.1",
        "--labcomm",
        "127.0.0.1:0",
        "--labcomm",
        ALL,
    ];
    let (mut server, address) = serve_pulling(&folder, ["60", "0.5"], &further);
    let ports = ports(&mut server);
    let good = read_all(ports[1]);
    let sensor = format!("labcomm:{}", ports[0]);
    let client = folder.start_with(
        "client",
        &["client", &address, "--sensor", &sensor],
        Stdio::null(),
    );
    await_obtain(&mut server, 1);
    let own = [127, 0, 0, 1];
    for port in ports {
        for _ in 0..20 {
            Socket::from(narrow(own, port))
                .set_linger(Some(Duration::ZERO))
                .unwrap();
        }
        #[cfg(target_os = "linux")]
        {
            let mut stranger = narrow([127, 0, 0, 2], port);
            stranger
                .set_read_timeout(Some(Duration::from_secs(60)))
                .unwrap();
            match stranger.read_to_end(&mut Vec::new()) {
                Ok(count) => assert_eq!(count, 0, "a stranger was served"),
                Err(error) => assert_eq!(error.kind(), std::io::ErrorKind::ConnectionReset),
            }
        }
        let still = narrow(own, port);
        let mut talking = TcpStream::connect(port).unwrap();
        std::thread::spawn(move || while talking.write_all(&[0x5a; 1_000]).is_ok() {});
        // One place is taken by the good reader or the client; one of two more has to wait until
        // one of those that read nothing is dropped.
        let mut further = [(); 2].map(|()| TcpStream::connect(port).unwrap());
        for reader in &mut further {
            reader
                .set_read_timeout(Some(Duration::from_secs(60)))
                .unwrap();
            reader.read_exact(&mut [0; 1_000]).unwrap();
        }
        drop(still);
    }
    let ended = client.stop().success();
    assert!(ended.contains("left with Goodbye after "), "{ended}");
    server.await_words("SafeDisconnect -> Listening");
    server.stop().success();
    let record = record(&folder);
    let (ticks, _) = compare(&good.join().unwrap(), Version::V2006, &record);
    assert!(ticks > 500, "{ticks}");
    assert!(record.values().all(|row| row["missed"] == "0"));
    assert_no_jump(&rows(&folder));
}

#[test]
fn a_sample_of_another_type_is_refused_with_both_types() {
    let folder = Folder::new("publication-type");
    let (mut server, address) =
        serve_pulling(&folder, ["60", "0.5"], &["--labcomm", "127.0.0.1:0"]);
    let sensor = format!("labcomm:{}/data", ports(&mut server)[0]);
    let said = folder
        .run(&["client", &address, "--sensor", &sensor])
        .failure(8);
    for part in [
        "sample \"data\" has the type [\"array\",[3],\"int\"]",
        "[\"array\",[6],\"float\"]",
    ] {
        assert!(said.contains(part), "{said}");
    }
    server.stop().success();
}

#[test]
fn wrong_options_are_refused_by_name() {
    let folder = Folder::new("publication-options");
    for (option, words) in [
        (
            "127.0.0.1:0=force",
            "there is no sample \"force\"; expected data, forcesensor,",
        ),
        ("127.0.0.1:0=data,data", "sample data is named twice"),
        ("here=data", "invalid"),
    ] {
        let said = folder.run(&["serve", "--labcomm", option]).failure(2);
        assert!(said.contains(words), "{said}");
    }
}
