//! The outside of frames: split, merged, broken, and too many.

use std::io::Write;

use gantry_tau_core::control::message::{Cause, Mode, Phase, ServerMessage};
use gantry_tau_core::control::wire::{HEADER_LEN, Notice};
use gantry_tau_tests::client::Noise;
use gantry_tau_tests::server_fixture::ServerFixture;
use gantry_tau_tests::session_fixture::SessionFixture;

use super::AT;

/// Bytes of a command for three axes.
const COMMAND: usize = 70;
/// Index of the low byte of the body's length.
const LENGTH_BYTE: usize = 4;
/// Index of the version.
const VERSION_BYTE: usize = 2;

#[test]
fn a_frame_may_be_split_at_every_byte() {
    let mut session = SessionFixture::obtained([0; 3]);
    for cut in 1..COMMAND {
        let nm = i32::try_from(cut).unwrap();
        let target = [10 * nm, -nm, 0];
        let frame = session.client.frame(Mode::Obtain, target);
        assert_eq!(frame.len(), COMMAND);
        assert_eq!(session.deliver(&frame[..cut]), 0);
        assert_eq!(session.deliver(&frame[cut..]), 1);
        assert_eq!(session.tick().state.phase, Phase::Obtain);
        assert_eq!(session.server.bus.positions(), target);
    }
    let frame = session.client.frame(Mode::Obtain, AT.map(|nm| nm / 10));
    let counts: Vec<u8> = frame.iter().map(|byte| session.deliver(&[*byte])).collect();
    assert_eq!(counts.iter().sum::<u8>(), 1);
    assert_eq!(session.tick().state.counters.missed, 0);
    assert_eq!(session.server.bus.positions(), AT.map(|nm| nm / 10));
}

#[test]
fn a_frame_that_straddles_a_tick_is_late_and_not_broken() {
    for cut in 1..COMMAND {
        let mut session = SessionFixture::obtained([300, 0, 0]);
        let frame = session.client.frame(Mode::Obtain, [5_000; 3]);
        assert_eq!(session.deliver(&frame[..cut]), 0);
        assert_eq!(session.assert_held().state.counters.missed, 1);
        assert_eq!(session.deliver(&frame[cut..]), 1);
        if cut % 2 == 0 {
            // The late one alone does not help.
            let _ = session.assert_disconnect([300, 0, 0], Cause::NetworkLate);
        } else {
            assert_eq!(session.deliver_answer([400, 0, 0]), 2);
            let row = session.tick();
            assert_eq!(
                (row.state.phase, session.server.bus.positions()),
                (Phase::Obtain, [400, 0, 0])
            );
            assert_eq!((row.state.counters.late, row.state.counters.missed), (1, 1));
        }
    }
}

#[test]
fn one_wrong_byte_ends_the_session_wherever_it_is() {
    let mut server = ServerFixture::default();
    for index in 0..COMMAND {
        let from = [250, -150, 0];
        let mut session = SessionFixture::submitted_on(server).obtain(from);
        let mut frame = session.client.frame(Mode::Obtain, [0; 3]);
        frame[index] ^= 0xff;
        assert_eq!(session.deliver(&frame), 0);
        if index == LENGTH_BYTE {
            // The server waits for the rest of a longer body: that is silence.
            session.assert_held();
            server = session.assert_disconnect(from, Cause::ClientLate);
            continue;
        }
        session.server.assert_disconnect(from, Cause::Malformed);
        match index {
            VERSION_BYTE => assert_eq!(session.client.notice(), Notice::VERSION),
            6 | 7 => assert_eq!(session.client.notice(), Notice::suite(0)),
            _ => session.client.assert_closed(),
        }
        server = session.server;
    }
}

#[test]
fn random_bytes_end_the_session_even_after_a_good_frame() {
    let mut noise = Noise::new(2013);
    let mut server = ServerFixture::default();
    for round in 0..40 {
        let from = [250, -150, 50];
        let mut session = SessionFixture::submitted_on(server).obtain(from);
        let mut bytes = Vec::new();
        if round % 2 == 0 {
            bytes = session.client.frame(Mode::Obtain, [2_000; 3]);
        }
        // A header is judged once it is whole.
        let count = HEADER_LEN + noise.below(600);
        bytes.extend(noise.bytes(count));
        assert_eq!(session.deliver(&bytes), u8::from(round % 2 == 0));
        session.server.assert_disconnect(from, Cause::Malformed);
        session.client.assert_closed();
        server = session.server;
    }
}

#[test]
fn a_ninth_frame_counts_across_visits_to_the_socket() {
    let mut session = SessionFixture::obtained(AT);
    for count in 1..=8 {
        assert_eq!(session.deliver_answer(AT), count);
    }
    assert_eq!(session.deliver_answer(AT), 8);
    session.server.assert_disconnect(AT, Cause::Flood);
    session.client.assert_closed();
}

#[test]
fn megabytes_of_good_frames_end_the_session_and_nothing_else() {
    let mut session = SessionFixture::obtained(AT);
    let frame = session.client.frame(Mode::Obtain, AT);
    let bytes = frame.repeat(8 * 1024 * 1024 / COMMAND);
    let mut writer = session.client.writer();
    let flood = std::thread::spawn(move || writer.write_all(&bytes).is_err());
    session.server.await_bytes(9 * COMMAND);
    session.server.assert_disconnect(AT, Cause::Flood);
    assert!(flood.join().unwrap(), "the server took eight megabytes");
    let mut next = SessionFixture::submitted_on(session.server);
    assert_eq!(next.answer(Mode::Obtain, [5; 3]).state.phase, Phase::Obtain);
    assert_eq!(next.server.bus.positions(), [5; 3]);
}

#[test]
fn one_visit_takes_a_bounded_part_of_a_flood() {
    let mut session = SessionFixture::obtained(AT);
    let frame = session.client.frame(Mode::Obtain, AT);
    let flood = frame.repeat(60_000 / COMMAND);
    session.client.send_bytes(&flood);
    session.server.await_bytes(flood.len());
    session.server.receive();
    let taken = flood.len() - session.server.unread(flood.len());
    assert!((9 * COMMAND..=8_192).contains(&taken), "{taken} bytes");
    session.server.assert_disconnect(AT, Cause::Flood);
}

#[test]
fn a_flood_during_the_ramp_costs_the_flooder_its_connection_only() {
    let mut session = SessionFixture::obtained(AT);
    session.tick();
    session.tick();
    let frame = session.client.frame(Mode::Obtain, AT);
    session.deliver(&frame.repeat(9));
    let ramping = AT.map(|nm: i32| nm.signum() * (nm.abs() - 100).max(0));
    session.server.assert_ramp(ramping, Phase::SafeDisconnect);
    while let Some(message) = session.client.receive() {
        assert!(matches!(message, ServerMessage::State(_)), "{message:?}");
    }
}
