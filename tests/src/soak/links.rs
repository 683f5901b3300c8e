//! Links of all kinds.

use std::time::Duration;

use gantry_tau::faults::plan::{Act, Cue, Odds, Plan, When};
use gantry_tau::faults::{Direction, Fault, Medium};

use crate::client::Noise;

const MS: Duration = Duration::from_millis(1);

/// How many kinds of links there are.
pub(super) const KINDS: usize = 5;

/// A link of a kind: clean, rough, very rough, late, and scripted.
pub(super) fn plan(kind: usize, noise: &mut Noise, medium: Medium) -> Plan {
    let rough = [
        (Fault::Drop, 2e-3),
        (Fault::Duplicate, 2e-3),
        (Fault::Reorder, 2e-3),
        (Fault::Corrupt, 5e-4),
        (Fault::Truncate, 5e-4),
        (Fault::Split, 5e-3),
        (Fault::Burst, 1e-3),
        (Fault::Stall, 5e-4),
        (Fault::HalfOpen, 3e-4),
        (Fault::Reset, 3e-4),
    ];
    let odds = |factor: f64| {
        let odds = rough.into_iter().map(|(fault, per_frame)| {
            let odds = Odds {
                per_frame: factor * per_frame,
                parameter: None,
            };
            (fault, odds)
        });
        odds.filter(|(fault, _)| fault.suits(medium)).collect()
    };
    let plan = Plan {
        seed: noise.number(),
        delay: MS / 10,
        jitter: if kind == 3 { 2 * MS } else { MS / 10 },
        odds: match kind {
            1 => odds(1.0),
            2 => odds(10.0),
            _ => Vec::new(),
        },
        direction: [None, Some(Direction::Up), Some(Direction::Down)][noise.below(3)],
        script: if kind == 4 {
            script(noise, medium)
        } else {
            Vec::new()
        },
    };
    plan.check(medium).unwrap();
    plan
}

/// Whether it takes longer than a tick, now and then, without any fault.
pub(super) fn is_slow(plan: &Plan) -> bool {
    plan.jitter > MS / 4
}

/// A few faults at stated frames and ticks.
fn script(noise: &mut Noise, medium: Medium) -> Vec<Cue> {
    let cues = (0..4).map(|index| {
        let fault = Fault::ALL[noise.below(Fault::ALL.len())];
        let at = 100 * index + noise.below(100);
        let timed = [Fault::Burst, Fault::Stall].contains(&fault);
        Cue {
            when: if noise.below(2) == 0 {
                When::Frame(u64::try_from(at).unwrap() + 1)
            } else {
                When::Since(MS * u32::try_from(at).unwrap())
            },
            direction: [Some(Direction::Up), Some(Direction::Down)][noise.below(2)],
            act: Act {
                fault,
                parameter: timed.then(|| u32::try_from(noise.below(30)).unwrap()),
            },
        }
    });
    cues.filter(|cue| cue.act.fault.suits(medium)).collect()
}
