//! Everybody else: others beside a session get their answers, and the session is what it would be
//! without them (T7).

use std::collections::VecDeque;
use std::io::Write;

use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::control::endpoint::CONNECTIONS;
use gantry_tau_core::control::message::{ClientMessage, Mode, Phase, Refusal};
use gantry_tau_core::control::wire::{Notice, PROTOCOL_VERSION, encode_client};
use gantry_tau_tests::client::{Client, Noise, enclose, hello};
use gantry_tau_tests::server_fixture::ServerFixture;
use gantry_tau_tests::session_fixture::SessionFixture;
use gantry_tau_tests::wait_for;

use super::AT;

/// The session goes on until `done`; its references do not move.
fn answer_until(
    session: &mut SessionFixture<3>,
    what: &str,
    mut done: impl FnMut(&mut SessionFixture<3>) -> bool,
) {
    wait_for(what, || {
        assert_eq!(session.answer(Mode::Obtain, AT).state.phase, Phase::Obtain);
        assert_eq!(session.server.bus.positions(), AT);
        done(session)
    });
}

fn other(session: &SessionFixture<3>) -> Client<3> {
    let mut other = Client::connect(session.server.address());
    // It knows everything the owner knows.
    other.epoch = session.client.epoch;
    other
}

#[test]
fn a_second_client_is_told_busy_and_closed() {
    let mut session = SessionFixture::obtained(AT);
    for _ in 0..10 {
        let mut other = other(&session);
        other.say_hello();
        answer_until(&mut session, "the refusal", |_| !other.is_quiet());
        assert_eq!(other.refusal(), Refusal::Busy);
    }
}

#[test]
fn a_non_owner_cannot_stop_leave_or_command_for_the_owner() {
    let mut session = SessionFixture::obtained(AT);
    let epoch = session.client.epoch;
    for count in 1..=9 {
        let mut other = other(&session);
        other.tick = session.client.tick;
        other.sequence = session.client.sequence + 100;
        let command = other.command(Mode::Obtain, [0; 3]);
        other.send(&match count % 3 {
            0 => ClientMessage::Stop(epoch),
            1 => ClientMessage::Goodbye(epoch),
            _ => ClientMessage::Command(command),
        });
        answer_until(&mut session, "the other's frame", |session| {
            session.server.non_owner() == count
        });
        assert!(other.is_quiet());
    }
}

#[test]
fn a_non_owner_with_broken_frames_or_too_many_is_closed() {
    let mut session = SessionFixture::obtained(AT);
    let mut noise = Noise::new(7);
    let frame = encode_client(&ClientMessage::<3>::Stop(session.client.epoch));
    for bytes in [noise.bytes(200), frame.repeat(2), frame.repeat(1_000)] {
        let mut other = other(&session);
        other.send_bytes(&bytes);
        answer_until(&mut session, "the other's end", |_| !other.is_quiet());
        other.assert_closed();
    }
}

#[test]
fn megabytes_of_a_non_owner_cost_it_its_connection() {
    let mut session = SessionFixture::obtained(AT);
    for bytes in [
        Noise::new(9).bytes(8 << 20),
        enclose(PROTOCOL_VERSION, 6, &session.client.epoch.0.to_le_bytes()).repeat(1 << 18),
    ] {
        let mut writer = other(&session).writer();
        let flood = std::thread::spawn(move || writer.write_all(&bytes).is_err());
        answer_until(&mut session, "the flood's end", |_| flood.is_finished());
        assert!(flood.join().unwrap(), "the server took it all");
    }
}

/// Connections that say nothing make room for those that come, the first of them first; the owner's
/// stays.
#[test]
fn for_the_seventh_the_connection_that_has_been_idle_longest_makes_room() {
    let mut session = SessionFixture::obtained(AT);
    let mut idle: VecDeque<_> = (1..CONNECTIONS).map(|_| other(&session)).collect();
    for _ in 0..2 * CONNECTIONS {
        let mut first = idle.pop_front().unwrap();
        // Still there: all places are taken.
        assert!(first.is_quiet());
        idle.push_back(other(&session));
        answer_until(&mut session, "the word for the first", |_| {
            !first.is_quiet()
        });
        assert_eq!(first.notice(), Notice::FULL);
        first.assert_closed();
    }
    for mut other in idle {
        assert!(other.is_quiet());
        other.say_hello();
        answer_until(&mut session, "the refusal", |_| !other.is_quiet());
        assert_eq!(other.refusal(), Refusal::Busy);
    }
}

/// Found from outside: six connections that say nothing, and come again, kept everybody from the
/// session.
#[test]
fn idle_connections_keep_nobody_from_the_session() {
    let mut server = ServerFixture::<3>::default();
    let mut idle = Vec::new();
    for _ in 0..20 {
        idle.extend((0..CONNECTIONS).map(|_| Client::<3>::connect(server.address())));
        let mut client = Client::<3>::connect(server.address());
        client.say_hello();
        server.step_until("the Welcome", |row| row.welcomed);
        client.welcome();
        drop(client);
        server.step_until("Listening", |row| row.state.phase == Phase::Listening);
    }
}

/// A session of 120 ticks with moving targets, misses and a ramp; beside each tick, `beside` is
/// called.
fn play(
    mut beside: impl FnMut(&SessionFixture<3>, usize),
) -> (SessionFixture<3>, Vec<[Reference; 3]>) {
    let mut session = SessionFixture::submitted_on(ServerFixture::default());
    let from = session.server.bus.writes();
    for tick in 0..120 {
        beside(&session, tick);
        let nm = i32::try_from(tick).unwrap();
        if tick % 10 == 9 {
            session.server.receive();
            session.tick();
        } else {
            session.answer(Mode::Obtain, [nm * 700, -nm * 900, nm % 7]);
        }
    }
    let written = session.server.bus.record().written[from..].to_vec();
    (session, written)
}

/// Frames that another client can think of.
fn mischief(noise: &mut Noise, session: &SessionFixture<3>) -> Vec<u8> {
    let epoch = session.client.epoch;
    match noise.below(6) {
        0 => encode_client(&hello::<3>()).to_vec(),
        1 => encode_client(&ClientMessage::<3>::Stop(epoch)).to_vec(),
        2 => encode_client(&ClientMessage::<3>::Goodbye(epoch)).to_vec(),
        3 => {
            let count = noise.below(2_000);
            noise.bytes(count)
        }
        4 => enclose(PROTOCOL_VERSION, 3, &noise.bytes(58)),
        _ => encode_client(&ClientMessage::<3>::Stop(epoch)).repeat(50),
    }
}

#[test]
fn a_crowd_changes_no_reference() {
    let (_, alone) = play(|_, _| {});
    for seed in 1..=5 {
        let mut noise = Noise::new(seed);
        let mut crowd = Vec::new();
        let (mut session, crowded) = play(|session, _| {
            for _ in 0..noise.below(4) {
                let mut other = other(session);
                other.send_bytes(&mischief(&mut noise, session));
                match noise.below(3) {
                    0 => other.reset(),
                    1 => drop(other),
                    _ => crowd.push(other),
                }
                if crowd.len() > 8 {
                    crowd.remove(0);
                }
            }
        });
        assert_eq!(crowded, alone, "seed {seed}");
        // The crowd was there.
        wait_for("another's frame", || {
            session.answer(Mode::Obtain, [0; 3]);
            session.server.non_owner() > 0
        });
    }
}

#[test]
fn a_crowd_before_the_first_session_is_no_session() {
    let mut server = ServerFixture::<3>::default();
    let mut noise = Noise::new(99);
    for _ in 0..200 {
        let mut other = Client::<3>::connect(server.address());
        let count = 6 + noise.below(300);
        other.send_bytes(&noise.bytes(count));
        server.receive();
        assert_eq!(server.step().state.phase, Phase::Listening);
    }
    let _ = SessionFixture::submitted_on(server);
}
