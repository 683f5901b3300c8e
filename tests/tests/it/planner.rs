//! A planner that breaks its own limit of acceleration, as LinuxCNC did (issue 3773): small arcs at
//! 1 kHz under a limit of 1 750 mm/s², of which one tick asked for 14 220 mm/s², 8.1 times as much.
//! The server passes the path on as it is, and says which tick and axis it was.

use std::num::NonZeroU32;

use gantry_tau_core::control::client::{Client, Requirements};
use gantry_tau_core::control::endpoint::{Endpoint, Transport};
use gantry_tau_core::control::message::{AxisFlags, Mode, Phase};
use gantry_tau_core::control::session::config::NominalAccel;
use gantry_tau_core::{
    Config, EpochRange, OffsetNm, Offsets, PositionNm, Reference, Session, Start,
};
use gantry_tau_tests::server_fixture;

const AXES: usize = 3;
/// 1 750 mm/s² at 1 kHz, nm per tick².
const LIMIT_NM: u32 = 1_750;
/// 14 219.86 mm/s².
const PEAK_NM: i64 = 14_220;
/// Tick of the peak, in an arc of the second axis.
const PEAK: usize = 700;
const TICKS: usize = 1_200;

/// Path of an axis: to and fro with an acceleration just within its limit, and one tick beyond it.
fn path(axis: usize) -> Vec<PositionNm> {
    let (mut place, mut velocity) = (0_i64, 0_i64);
    (0..TICKS)
        .map(|tick| {
            let within = i64::from(LIMIT_NM);
            let peak = axis == 1 && tick == PEAK;
            // A period of 40 ticks, half of it forwards.
            let forwards = (tick + 10 * axis) % 40 < 10 || (tick + 10 * axis) % 40 >= 30;
            velocity += match (peak, forwards) {
                (true, _) => PEAK_NM,
                (false, true) => within,
                (false, false) => -within,
            };
            place += velocity;
            PositionNm(place)
        })
        .collect()
}

/// Ticks in which a server flags an axis, and the references it gave.
struct Run {
    flagged: Vec<(usize, usize)>,
    references: Vec<[Reference; AXES]>,
    phase: Phase,
}

fn run(limit: Option<NominalAccel>) -> Run {
    let mut parameters = server_fixture::parameters();
    for axis in &mut parameters.axes {
        axis.nominal_accel = limit;
    }
    let config = Config::new(parameters).unwrap();
    let start = Start::at_rest([PositionNm(0); AXES]);
    let mut server = Endpoint::new(Session::new(config, &start).unwrap(), EpochRange::VOLATILE);
    let connection = server.open(Transport::Stream).unwrap();
    let mut client = Client::<AXES>::new(Transport::Stream, Requirements::default());
    server.feed(connection, &client.hello().unwrap());
    let paths: [_; AXES] = std::array::from_fn(path);
    let places = (0..TICKS).map(|tick| std::array::from_fn(|axis: usize| paths[axis][tick]));
    let (mut flagged, mut references) = (Vec::new(), Vec::new());
    for (tick, nominal) in places.enumerate() {
        server_fixture::taken(server.tick(&server_fixture::on_time(nominal)));
        let output = server.output().unwrap();
        references.push(output.references);
        let states = output.state.axes.iter().enumerate();
        flagged.extend(
            states
                .filter(|(_, state)| state.flags.contains(AxisFlags::NOMINAL_ACCEL))
                .map(|(axis, _)| (tick, axis)),
        );
        let mut frames = Vec::new();
        while let Some((_, frame)) = server.poll_transmit() {
            frames.push(frame.to_vec());
        }
        for frame in frames {
            let _ = client.feed(&frame).poll_event();
        }
        let targets = [Offsets::position(OffsetNm(40_000)); AXES];
        if let Some(answer) = client.answer(Mode::Obtain, &targets) {
            server.feed(connection, &answer.frame);
        }
    }
    Run {
        flagged,
        references,
        phase: server.session().phase(),
    }
}

#[test]
fn eight_times_the_acceleration_is_flagged_in_its_tick_and_passed_on() {
    let limit = NominalAccel {
        nm: NonZeroU32::new(LIMIT_NM).unwrap(),
        is_fault: false,
    };
    let (judged, unjudged) = (run(Some(limit)), run(None));
    assert_eq!(judged.flagged, [(PEAK, 1)], "in its tick, on its axis");
    assert!(unjudged.flagged.is_empty());
    assert_eq!(
        (judged.phase, unjudged.phase),
        (Phase::Obtain, Phase::Obtain)
    );
    assert!(
        judged.references == unjudged.references,
        "the path is the planner's"
    );
    let offset = judged.references[TICKS - 1][1].position.0 - path(1)[TICKS - 1].0;
    assert_eq!(offset, 40_000, "and what the client adds");
}

#[test]
fn it_stops_the_machine_where_the_file_says_so() {
    let limit = NominalAccel {
        nm: NonZeroU32::new(LIMIT_NM).unwrap(),
        is_fault: true,
    };
    let stopped = run(Some(limit));
    assert_eq!(stopped.flagged.first(), Some(&(PEAK, 1)));
    assert_eq!(stopped.phase, Phase::Fault);
}
