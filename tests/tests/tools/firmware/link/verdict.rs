//! What the target says about itself, against what the tap heard and what the clients wrote down.

use std::collections::BTreeMap;
use std::path::Path;

use gantry_tau_core::control::message::Phase;

use super::{AXES, State};

/// Position offsets fall by so much in each tick of a ramp, nm: 0.1 µm per millisecond.
const RAMP_NM: u32 = 100;

/// The target's words.
pub(super) struct Told<'a>(pub(super) &'a [String]);

impl Told<'_> {
    /// The one line that begins with `link NAME=VALUE`, or `link NAME=` whatever the value.
    fn line(&self, name: &str, value: &str) -> &str {
        let begin = format!("link {name}={value}");
        let is_it = |line: &&String| {
            let rest = line.strip_prefix(&begin);
            rest.is_some_and(|rest| value.is_empty() || rest.is_empty() || rest.starts_with(' '))
        };
        let mut lines = self.0.iter().filter(is_it);
        let line = lines.next();
        let line = line.unwrap_or_else(|| panic!("no {begin:?} in\n{}", self.0.join("\n")));
        assert!(lines.next().is_none(), "{begin:?} twice");
        line
    }

    /// A number on that line.
    pub(super) fn number(&self, name: &str, value: &str, field: &str) -> u64 {
        self.word(name, value, field).parse().unwrap()
    }

    /// A word on that line.
    pub(super) fn word(&self, name: &str, value: &str, field: &str) -> &str {
        let rest = rest(self.line(name, value), field);
        rest.split(' ').next().unwrap()
    }

    /// The numbers of the axes at the end of that line.
    pub(super) fn axes(&self, name: &str, value: &str, field: &str) -> [i64; AXES] {
        let numbers = rest(self.line(name, value), field);
        let numbers = numbers
            .strip_prefix('[')
            .unwrap()
            .strip_suffix(']')
            .unwrap();
        let numbers: Vec<i64> = (numbers.split(", "))
            .map(|number| number.parse().unwrap())
            .collect();
        numbers.try_into().unwrap()
    }

    /// Who was refused: tick and reason.
    pub(super) fn refused(&self) -> Vec<(u64, &str)> {
        let refused = self.0.iter().filter(|line| line.contains(" refused="));
        refused
            .filter(|line| line.starts_with("link tick="))
            .map(|line| {
                let tick = rest(line, "tick").split(' ').next().unwrap();
                (tick.parse().unwrap(), rest(line, "refused"))
            })
            .collect()
    }
}

/// What follows `FIELD=` on a line.
fn rest<'a>(line: &'a str, field: &str) -> &'a str {
    let (_, rest) = line
        .split_once(&format!(" {field}="))
        .unwrap_or_else(|| panic!("no {field} in {line:?}"));
    rest
}

/// The target's account of a session is that of the tap; returns the States of the session.
pub(super) fn check_session(
    told: &Told<'_>,
    states: &[State],
    epoch: u64,
    cause: &str,
) -> Vec<State> {
    let number = epoch.to_string();
    let states: Vec<State> = (states.iter().filter(|state| state.epoch.0 == epoch))
        .copied()
        .collect();
    for pair in states.windows(2) {
        assert_eq!(pair[0].tick.0 + 1, pair[1].tick.0, "a State is missing");
    }
    assert_eq!(told.word("session", &number, "cause"), cause);
    let count = |phase| states.iter().filter(|state| state.phase == phase).count();
    for (field, phase) in [
        ("submit_ticks", Phase::Submit),
        ("obtain_ticks", Phase::Obtain),
    ] {
        let ticks = told.number("session", &number, field);
        assert_eq!(ticks, u64::try_from(count(phase)).unwrap(), "{field}");
        assert!(ticks > 100, "{field}: {ticks}");
    }
    for state in states.iter().filter(|state| state.phase == Phase::Submit) {
        assert_eq!(positions(state), [0; AXES], "Submit moves no drive");
    }
    let last = states.iter().rfind(|state| state.phase == Phase::Obtain);
    let from = told.axes("session", &number, "ramp_from_nm");
    assert_eq!(positions(last.unwrap()), from, "where the ramp begins");
    assert_eq!(
        told.number("session", &number, "ramp_ticks"),
        ramp_ticks(&from)
    );
    states
}

/// Ticks from these offsets to zero.
fn ramp_ticks(from: &[i64; AXES]) -> u64 {
    let largest = from
        .iter()
        .map(|offset| offset.unsigned_abs())
        .max()
        .unwrap();
    largest.div_ceil(RAMP_NM.into())
}

/// The end of a session whose cable was pulled, as the tap heard it: one miss holds, the second ends the session, and every offset
/// falls by exactly 0.1 µm per tick until it is zero.
pub(super) fn check_pulled_cable(states: &[State]) {
    let end = states
        .iter()
        .position(|state| state.phase == Phase::SafeDisconnect);
    let (before, ramp) = states.split_at(end.unwrap());
    let [.., answered, held] = before else {
        panic!("a session of two States");
    };
    assert_eq!(held.counters.missed, answered.counters.missed + 1);
    assert_eq!(positions(held), positions(answered), "one miss holds");
    let mut expected = positions(held);
    for state in ramp {
        for offset in &mut expected {
            *offset -= offset.signum() * i64::from(RAMP_NM).min(offset.abs());
        }
        assert_eq!(positions(state), expected, "tick {}", state.tick.0);
    }
    assert_eq!(expected, [0; AXES], "the tap heard the whole ramp");
    assert_eq!(ramp[0].counters.missed, held.counters.missed + 1);
}

/// One stranger found the session taken, and a later one the offsets on their way to zero, `ramping` ticks before they were there.
pub(super) fn check_refusals(told: &Told<'_>, states: &[State], ramping: u32) {
    let at = |tick: u64| states.iter().find(|state| state.tick.0 == tick).unwrap();
    let refused = told.refused();
    let [(early, busy), (late, reason)] = refused.as_slice() else {
        panic!("{refused:?}");
    };
    assert_eq!((*busy, at(*early).phase), ("Busy", Phase::Obtain));
    assert_eq!(*reason, format!("Ramping {{ ticks_left: {ramping} }}"));
    assert_eq!(
        at(*late - 1).ramp_ticks_left,
        ramping,
        "as the State before said"
    );
    assert!(ramping > 0);
}

/// Every row of a client's recording is the State that the target sent; returns how many there are.
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
        let mut expected = vec![
            ("state".to_owned(), format!("{:?}", state.phase)),
            ("cause".to_owned(), format!("{:?}", state.cause)),
            ("missed".to_owned(), state.counters.missed.to_string()),
            (
                "ramp_ticks_left".to_owned(),
                state.ramp_ticks_left.to_string(),
            ),
        ];
        for (axis, number) in state.axes.iter().zip(1..) {
            let mut expect = |name: &str, value: i64| {
                expected.push((
                    name.replace('#', &i32::to_string(&number)),
                    value.to_string(),
                ));
            };
            expect("nominal_#_nm", axis.nominal.0);
            expect("offset_#_nm", axis.offsets.position.0.into());
            expect("shadow_#_nm", axis.shadow.position.0.into());
            expect("actual_#_nm", axis.actual.position.0);
            expect(
                "reference_#_nm",
                axis.nominal.0 + i64::from(axis.offsets.position.0),
            );
            expect("flags_#", axis.flags.bits().into());
        }
        for (name, value) in expected {
            assert_eq!(fields[name.as_str()], value, "{name} of tick {tick}");
        }
    }
    rows
}

/// The largest changes in a tick that the target measured are those that the tap heard.
pub(super) fn check_changes(told: &Told<'_>, states: &[State]) {
    let offsets = largest(states, positions);
    let references = largest(states, |state| {
        state
            .axes
            .map(|axis| axis.nominal.0 + i64::from(axis.offsets.position.0))
    });
    println!("largest change per tick, nm: offsets {offsets:?}, references {references:?}");
    assert_eq!(
        told.axes("largest_offset_nm", "", "largest_offset_nm"),
        offsets
    );
    assert_eq!(
        told.axes("largest_reference_nm", "", "largest_reference_nm"),
        references
    );
    assert!(
        offsets.iter().any(|offset| *offset > i64::from(RAMP_NM)),
        "nothing moved"
    );
}

fn largest(states: &[State], of: impl Fn(&State) -> [i64; AXES]) -> [i64; AXES] {
    let mut largest = [0; AXES];
    for pair in states
        .windows(2)
        .filter(|pair| pair[0].tick.0 + 1 == pair[1].tick.0)
    {
        for ((largest, before), now) in largest.iter_mut().zip(of(&pair[0])).zip(of(&pair[1])) {
            *largest = (now - before).abs().max(*largest);
        }
    }
    largest
}

fn positions(state: &State) -> [i64; AXES] {
    state.axes.map(|axis| axis.offsets.position.0.into())
}
