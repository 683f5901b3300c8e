//! Agreement of three records: the target's log, the States that the proxy recorded, and the
//! clients' recordings.

use std::collections::BTreeMap;
use std::path::Path;

use gantry_tau_core::control::message::{Capabilities, Phase};
use gantry_tau_core::control::monitor::Monitor;

use super::{AXES, State};
use crate::firmware::machine::robots;

/// Log of the target: lines of `name=value` words.
pub(super) struct Log<'a>(pub(super) &'a [String]);

impl Log<'_> {
    /// Returns the events of this name, by tick.
    fn events(&self, name: &str) -> BTreeMap<u64, &str> {
        let separator = format!(" {name}=");
        let events = self.0.iter().filter_map(|line| {
            let (tick, event) = line.split_once(&separator)?;
            Some((tick.strip_prefix("tick=")?.parse().unwrap(), event))
        });
        events.collect()
    }

    /// Returns a number of the last line.
    pub(super) fn total(&self, name: &str) -> u64 {
        let words = self.0.last().unwrap().split(' ');
        let mut words = words.filter_map(|word| word.strip_prefix(name)?.strip_prefix('='));
        words.next().unwrap().parse().unwrap()
    }
}

/// Checks that the proxy's States have the phases of the log.
pub(super) fn check_phases(log: &Log<'_>, states: &[State]) {
    let phases = log.events("phase");
    for state in states {
        let last = phases.range(..=state.tick.0).next_back();
        let phase = last.map_or("Listening", |(_, phase)| *phase);
        assert_eq!(phase, format!("{:?}", state.phase), "{:?}", state.tick);
    }
}

/// Checks a session: no State is missing, none breaks a rule of the monitor, and it ends by
/// `cause`. Returns its States, and the number of received commands.
pub(super) fn check_session(
    log: &Log<'_>,
    states: &[State],
    epoch: u64,
    cause: &str,
) -> (Vec<State>, u64) {
    let states = states.iter().filter(|state| state.epoch.0 == epoch);
    let states: Vec<State> = states.copied().collect();
    let parameters = robots::parameters(0, Capabilities::NONE).unwrap();
    let limits = parameters.axes.map(|axis| axis.limits);
    let mut monitor = Monitor::new(limits, None);
    for state in &states {
        monitor.check_state(state).unwrap();
    }
    for pair in states.windows(2) {
        assert_eq!(pair[0].tick.0 + 1, pair[1].tick.0, "a State is missing");
    }
    for phase in [Phase::Submit, Phase::Obtain] {
        let ticks = states.iter().filter(|state| state.phase == phase).count();
        assert!(ticks > 100, "{phase:?}: {ticks} ticks");
    }
    let ramp = i64::from(limits[0].position.ramp());
    let moved = states.iter().flat_map(positions).max().unwrap();
    assert!(moved > 100 * ramp, "the offsets moved by {moved} nm only");

    let welcomes = log.events("welcome");
    let welcome = welcomes
        .iter()
        .find(|(_, one)| **one == epoch.to_string())
        .unwrap();
    let ends = log.events("ended");
    let (tick, end) = ends.range(welcome.0..).next().unwrap();
    assert!(end.starts_with(&format!("{cause} ")), "{end}");
    if let Some(state) = states.iter().find(|state| state.tick.0 == *tick) {
        assert_eq!(state.phase, Phase::SafeDisconnect);
    }
    let (_, received) = end.split_once("received: ").unwrap();
    let received = received.split(',').next().unwrap().parse().unwrap();
    (states, received)
}

/// Checks the end of a session whose cable was pulled: two misses end it, and the proxy received
/// the whole ramp. The monitor has checked that the first miss holds the positions, and every step
/// of the ramp.
pub(super) fn check_pulled_cable(states: &[State]) {
    let end = states
        .iter()
        .position(|state| state.phase == Phase::SafeDisconnect);
    let (before, ramp) = states.split_at(end.unwrap());
    let [.., answered, held] = before else {
        panic!("a session of {} States", states.len());
    };
    let missed = answered.counters.missed;
    assert_eq!(held.accepted, answered.accepted, "the first miss holds");
    assert_eq!(held.counters.missed, missed + 1);
    assert_eq!(ramp[0].counters.missed, missed + 2);
    assert_eq!(positions(ramp.last().unwrap()), [0; AXES]);
}

/// State of a tick.
fn at(states: &[State], tick: u64) -> &State {
    states.iter().find(|state| state.tick.0 == tick).unwrap()
}

/// Checks that one client was refused in Obtain, and a later one in the ramp, `ramping` ticks
/// before its end.
pub(super) fn check_refusals(log: &Log<'_>, states: &[State], ramping: u32) {
    let refused = log.events("refused").into_iter().collect::<Vec<_>>();
    let [(early, "Busy"), (late, reason)] = refused[..] else {
        panic!("{refused:?}");
    };
    assert_eq!(at(states, early).phase, Phase::Obtain);
    assert_eq!(reason, format!("Ramping {{ ticks_left: {ramping} }}"));
    assert_eq!(at(states, late - 1).ramp_ticks_left, ramping);
    assert!(ramping > 0);
}

/// Checks that every row of a client's recording is the State that the target sent. Returns the
/// number of rows.
pub(super) fn check_recording(csv: &Path, states: &[State]) -> u64 {
    let states: BTreeMap<u64, &State> = states.iter().map(|state| (state.tick.0, state)).collect();
    let text = std::fs::read_to_string(csv).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let mut rows = 0;
    for line in lines {
        rows += 1;
        let fields: BTreeMap<&str, &str> = header.iter().copied().zip(line.split(',')).collect();
        let tick = fields["tick"].parse().unwrap();
        let state = states.get(&tick);
        let state = state.unwrap_or_else(|| panic!("the target sent no State of tick {tick}"));
        for (name, value) in expected_fields(state) {
            assert_eq!(fields[&*name], value, "{name} of tick {tick}");
        }
    }
    rows
}

/// Columns of a recording that a State gives, and their values.
fn expected_fields(state: &State) -> Vec<(String, String)> {
    let mut expected = vec![
        ("state".to_owned(), state.phase.name().to_owned()),
        ("cause".to_owned(), state.cause.name().to_owned()),
        ("missed".to_owned(), state.counters.missed.to_string()),
        (
            "ramp_ticks_left".to_owned(),
            state.ramp_ticks_left.to_string(),
        ),
    ];
    for (axis, number) in state.axes.iter().zip(1..) {
        let (nominal, offset) = (axis.nominal.0, i64::from(axis.offsets.position.0));
        expected.extend(
            [
                (format!("nominal_{number}_nm"), nominal),
                (format!("offset_{number}_nm"), offset),
                (format!("shadow_{number}_nm"), axis.shadow.position.0.into()),
                (format!("actual_{number}_nm"), axis.actual.position.0),
                (format!("reference_{number}_nm"), nominal + offset),
                (format!("flags_{number}"), axis.flags.bits().into()),
            ]
            .map(|(name, value)| (name, value.to_string())),
        );
    }
    expected
}

fn positions(state: &State) -> [i64; AXES] {
    state.axes.map(|axis| axis.offsets.position.0.into())
}
