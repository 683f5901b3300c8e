//! The agitation budget over sockets: who shakes is ended, the machine makes no step, and the black
//! box replays.

use gantry_tau::replay::Findings;
use gantry_tau_core::control::agitation::AgitationBudget;
use gantry_tau_core::control::message::{Cause, Mode, Phase};
use gantry_tau_core::control::session::config::Parameters;
use gantry_tau_core::units::EpochRange;
use gantry_tau_record::black_box;
use gantry_tau_server::black_box::HALF;
use gantry_tau_tests::fake_plant::Bus;
use gantry_tau_tests::server_fixture::{ServerFixture, parameters};
use gantry_tau_tests::session_fixture::SessionFixture;

/// Targets either side of zero, nm.
const SWING: i32 = 2_000;
/// Ticks of Obtain until the second differences, 8 um per tick, are above the budget of 100 um.
const SWINGS: usize = 14;

/// A server whose first axis has a budget of 100 nm per tick.
fn with_budget<const N: usize>() -> ServerFixture<N> {
    let mut parameters: Parameters<N> = parameters();
    parameters.axes[0].agitation = AgitationBudget::new(100);
    ServerFixture::start(parameters, Bus::default(), EpochRange::VOLATILE).unwrap()
}

/// Targets of a tick: every axis swings, or all but the first.
fn targets<const N: usize>(tick: usize, first: bool) -> [i32; N] {
    let swing = if tick % 2 == 0 { SWING } else { -SWING };
    let mut targets = [swing; N];
    if !first {
        targets[0] = 0;
    }
    targets
}

/// Every tick is watched by the monitor of the fixture, which knows the limits of all channels.
fn shaken<const N: usize>() {
    let (server, mut windows) = with_budget::<N>().handing_over();
    let mut session = SessionFixture::submitted_on(server);
    for tick in 0..SWINGS {
        let row = session.answer(Mode::Obtain, targets(tick, true));
        assert_eq!(
            (row.state.phase, row.ended),
            (Phase::Obtain, None),
            "{tick}"
        );
    }
    let last = session.server.bus.positions();
    let frame = session.client.frame(Mode::Obtain, targets(SWINGS, true));
    session.deliver(&frame);
    let mut server = session.assert_disconnect(last, Cause::Agitated);
    for _ in 0..HALF {
        server.step();
    }
    let window = windows.receive().expect("no black box was handed over");
    assert_eq!(window.end().cause, Some(Cause::Agitated));
    let text = black_box::encode(&window);
    let read = black_box::decode::<N>(&window.file_name(), text.as_bytes()).unwrap();
    assert_eq!(read, window);
    let findings = Findings::of(&read);
    assert_eq!(
        (findings.agreeing, findings.difference),
        (findings.ticks, None)
    );
    // Who shakes an axis without a budget is not ended; nor is who comes to rest.
    let mut session = SessionFixture::submitted_on(server);
    for tick in 0..10 * SWINGS {
        let row = session.answer(Mode::Obtain, targets(tick, false));
        assert_eq!(
            (row.state.phase, row.ended),
            (Phase::Obtain, None),
            "{tick}"
        );
    }
}

#[test]
fn a_client_that_shakes_is_ended_with_its_cause() {
    shaken::<3>();
    shaken::<6>();
}

/// Steps of 9 um, one in 200 ms: second differences of 50 um/s.
#[test]
fn a_client_that_works_is_not_ended() {
    let mut session = SessionFixture::submitted_on(with_budget::<3>());
    for tick in 0..3_000 {
        let side = if tick / 200 % 2 == 0 { 4_500 } else { -4_500 };
        let row = session.answer(Mode::Obtain, [side; 3]);
        assert_eq!(
            (row.state.phase, row.ended),
            (Phase::Obtain, None),
            "{tick}"
        );
    }
}
