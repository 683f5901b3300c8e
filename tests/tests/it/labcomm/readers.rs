//! Readers that never read, send garbage, reset, are one too many, or come from elsewhere: the
//! session beside them is the same.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};

use gantry_tau_core::model::robot::ARMS;
use gantry_tau_labcomm::Version;
use gantry_tau_server::links::Allowed;
use gantry_tau_server::links::subscribers::MAX_SUBSCRIBERS;
use gantry_tau_server::publication::{Publication, SampleName};
use gantry_tau_tests::client::Noise;
use gantry_tau_tests::server_fixture::LOOPBACK;
use gantry_tau_tests::{DEADLINE, wait_for};

use super::lockstep::{Lockstep, Session, stream};
use super::reader::{RESOLUTION_M, Reader, narrow, reset};

const SENSORS: &[SampleName] = &[SampleName::Data, SampleName::ForceSensor];
/// The force first: it is what ticks are counted by.
const ALL: &[SampleName] = &[
    SampleName::ForceSensor,
    SampleName::Data,
    SampleName::State,
    SampleName::Axes,
    SampleName::Tool,
    SampleName::SessionEvent,
];
/// Ticks of a session.
const TICKS: usize = 6_000;
/// Tick from which on two readers do not behave.
const CROWDED: usize = 400;
/// Tick in which another one comes.
const WAITING: usize = CROWDED + 10;
/// Longest time for which a port with so many bytes a tick keeps a reader that reads nothing,
/// ticks.
const KEPT: [usize; 2] = [5_000, 1_000];

/// A port for peers of this computer's first address.
fn port(names: &[SampleName]) -> (Publication, SocketAddr) {
    let port = Publication::bind::<ARMS>(LOOPBACK, Version::V2006, names, RESOLUTION_M).unwrap();
    let port = port.for_peers(Allowed::only(&["127.0.0.1".to_owned()]).unwrap());
    let address = port.address().unwrap();
    (port, address)
}

/// A session whose client takes its force from the port of sensors, without any other reader.
fn alone() -> Session {
    let (sensors, address) = port(SENSORS);
    Lockstep::start(vec![sensors]).session(stream(address), TICKS, |_, _| {})
}

/// Readers of one port that do not behave.
struct Crowd {
    port: SocketAddr,
    /// Readers that the port takes beside those that behave.
    places: usize,
    resetting: Option<TcpStream>,
    stranger: Option<TcpStream>,
    /// Reads nothing.
    still: Option<TcpStream>,
    /// Send garbage, and read.
    talking: Vec<Reader>,
    /// Comes when all places are taken.
    waiting: Option<Reader>,
    /// Tick in which it was served.
    served: Option<usize>,
}

impl Crowd {
    const fn at(port: SocketAddr, places: usize) -> Self {
        let talking = Vec::new();
        Self {
            port,
            places,
            resetting: None,
            stranger: None,
            still: None,
            talking,
            waiting: None,
            served: None,
        }
    }

    fn act(&mut self, tick: usize) {
        let own = [127, 0, 0, 1];
        match tick {
            ..CROWDED => match tick % 20 {
                5 => self.resetting = Some(narrow(own, self.port)),
                // Elsewhere this computer has one loopback address.
                10 if cfg!(target_os = "linux") => {
                    self.stranger = Some(narrow([127, 0, 0, 2], self.port))
                }
                15 => reset(self.resetting.take().unwrap()),
                19 => self.stranger.take().into_iter().for_each(assert_is_closed),
                _ => {}
            },
            CROWDED => {
                self.still = Some(narrow(own, self.port));
                self.talking
                    .extend((1..self.places).map(|_| Reader::of(self.port)));
                self.talking.iter().for_each(talk);
            }
            WAITING => self.waiting = Some(Reader::of(self.port)),
            _ => {
                let has_nothing = self.waiting.as_ref().is_none_or(Reader::has_nothing);
                if self.served.is_none() && !has_nothing {
                    self.served = Some(tick);
                }
            }
        }
    }
}

/// Sends garbage until the connection has ended; it is not read, so that the sender soon waits.
fn talk(reader: &Reader) {
    let mut stream = reader.stream.try_clone().unwrap();
    let mut noise = Noise::new(11);
    std::thread::spawn(move || while stream.write_all(&noise.bytes(1_000)).is_ok() {});
}

/// Nothing has come, and nothing will.
fn assert_is_closed(mut stream: TcpStream) {
    stream.set_read_timeout(Some(DEADLINE)).unwrap();
    match stream.read_to_end(&mut Vec::new()) {
        Ok(count) => assert_eq!(count, 0, "a stranger was served"),
        Err(error) => assert_eq!(error.kind(), ErrorKind::ConnectionReset),
    }
}

#[test]
fn readers_of_any_conduct_change_no_reference_and_no_tick() {
    let ((sensors, sensors_at), (all, all_at)) = (port(SENSORS), port(ALL));
    let mut server = Lockstep::start(vec![sensors, all]);
    let good = [Reader::of(sensors_at), Reader::of(all_at)];
    // A port takes one new reader per tick: the client, which is the second of the sensors, shall
    // have its first sample as early as alone.
    server.tick();
    let mut crowds = [Crowd::at(sensors_at, 2), Crowd::at(all_at, 3)];
    let session = server.session(stream(sensors_at), TICKS, |tick, _| {
        for crowd in &mut crowds {
            crowd.act(tick);
        }
    });
    assert!(session.client.is_ok(), "{:?}", session.client);
    session.assert_on_time();
    assert_eq!(session.rows.last().unwrap().state.on_time_of_100, 100);
    let alone = alone();
    alone.assert_on_time();
    assert!(
        session
            .obtained()
            .iter()
            .any(|offsets| offsets[1] < -45_000),
        "the client has compensated"
    );
    session.assert_is(&alone);
    for reader in &good {
        reader.assert_every_sample(&server.rows);
    }
    for (crowd, most) in crowds.iter().zip(KEPT) {
        // The one that waited was served once the one that read nothing had been dropped.
        let served = crowd.served.expect("the fifth reader was never served");
        assert!(
            (WAITING + 10..CROWDED + most).contains(&served),
            "served in tick {served}"
        );
        let rest = session.rows.len() - served;
        crowd
            .waiting
            .as_ref()
            .unwrap()
            .assert_last_samples(&server.rows, rest);
        for talking in &crowd.talking {
            talking.assert_last_samples(&server.rows, session.rows.len() - CROWDED - 10);
        }
    }
}

/// A port that nothing is written to does not learn from a write that its readers have gone.
#[test]
fn readers_that_have_gone_leave_their_places_on_a_silent_port() {
    let (events, address) = port(&[SampleName::SessionEvent]);
    let mut server = Lockstep::start(vec![events]);
    for _ in 0..MAX_SUBSCRIBERS {
        let mut reader = Reader::of(address);
        wait_for("a reader", || {
            server.tick();
            !reader.has_nothing()
        });
        // Garbage first: the end of the stream is behind it.
        reader
            .stream
            .write_all(&Noise::new(7).bytes(10_000))
            .unwrap();
        reader.stream.shutdown(Shutdown::Both).unwrap();
    }
    let late = Reader::of(address);
    wait_for("the reader after them", || {
        server.tick();
        !late.has_nothing()
    });
}
