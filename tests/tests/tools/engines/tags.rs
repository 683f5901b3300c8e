//! Tags by other implementations of HMAC-SHA-256: a capture of both directions is computed again, frame
//! by frame, from the secret alone.

use std::path::Path;
use std::process::Command;

use gantry_tau_core::control::client::{Client, Event, Requirements};
use gantry_tau_core::control::endpoint::{Budget, Endpoint, Transport};
use gantry_tau_core::control::keys::{Key, Keyring, Role};
use gantry_tau_core::control::message::Mode;
use gantry_tau_core::{Config, EpochRange, OffsetNm, Offsets, PositionNm, Session, Start};
use gantry_tau_tests::server_fixture;
use libtest_mimic::Failed;

const AXES: usize = 6;
const SECRET: [u8; 32] = [0x3c; 32];
/// Frames of the capture, at least.
const FRAMES: usize = 10_000;
/// Ticks of a session.
const TICKS: usize = 500;

/// Lets an implementation compute every tag.
pub(super) fn judge(python: &Path, implementation: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("capture");
    std::fs::write(&path, capture())?;
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tools/engines/of_tags.py");
    let judged = Command::new(python)
        .arg("-B")
        .arg(script)
        .arg(implementation)
        .arg(&path)
        .current_dir(folder.path())
        .output()?;
    let said = [&judged.stdout, &judged.stderr].map(|text| String::from_utf8_lossy(text));
    println!("{}", said.concat());
    if judged.status.success() {
        return Ok(());
    }
    Err(said.concat().into())
}

/// The secret, and the frames of some sessions, each behind its length (`u16`, little-endian).
fn capture() -> Vec<u8> {
    let mut keyring = Keyring::new(&[0x55; 32]);
    keyring.add(Key::new(&SECRET, Role::Control)).unwrap();
    let mut server = Endpoint::keyed(session(), EpochRange::VOLATILE, keyring, Budget::default());
    let mut frames = Vec::new();
    for number in 0.. {
        if frames.len() >= FRAMES {
            break;
        }
        play(&mut server, number, &mut frames);
    }
    let mut bytes = SECRET.to_vec();
    for frame in frames {
        bytes.extend(u16::try_from(frame.len()).unwrap().to_le_bytes());
        bytes.extend(frame);
    }
    bytes
}

fn session() -> Session<AXES> {
    let config = Config::new(server_fixture::parameters()).unwrap();
    Session::new(config, &Start::at_rest([PositionNm(0); AXES])).unwrap()
}

/// One session, from the first Hello to its Goodbye.
fn play(server: &mut Endpoint<AXES>, number: u8, frames: &mut Vec<Vec<u8>>) {
    let connection = server.open(Transport::Stream).unwrap();
    let key = Key::new(&SECRET, Role::Control);
    let mut client = Client::<AXES>::keyed(
        Transport::Stream,
        Requirements::default(),
        key,
        [number; 16],
    );
    let mut said = client.hello().map(|frame| frame.to_vec());
    for tick in 0..TICKS {
        if let Some(frame) = said.take() {
            server.feed(connection, &frame);
            frames.push(frame);
        }
        server_fixture::taken(server.tick(&server_fixture::on_time([PositionNm(0); AXES])));
        let mut heard = Vec::new();
        while let Some((_, frame)) = server.poll_transmit() {
            heard.push(frame.to_vec());
        }
        for frame in heard {
            let event = client.feed(&frame).poll_event();
            frames.push(frame);
            if let Some(Ok(Event::Challenged)) = event {
                said = client.hello().map(|frame| frame.to_vec());
            }
        }
        let micrometres = i32::from(number) + 1;
        let targets = [Offsets::position(OffsetNm(1_000 * micrometres)); AXES];
        said = said.or_else(|| {
            let answer = client.answer(Mode::Obtain, &targets)?;
            Some(answer.frame.to_vec())
        });
        if tick + 100 == TICKS {
            said = client.goodbye().map(|frame| frame.to_vec());
        }
    }
    server.close(connection);
    while server.poll_close().is_some() {}
}
