//! Fault plans of the soak.

use std::time::Duration;

use gantry_tau::faults::Fault;
use gantry_tau::faults::plan::{Directions, FaultPlan, FaultRate, ScriptedFault, When};
use gantry_tau_core::control::endpoint::Transport;

use crate::client::Noise;

const MS: Duration = Duration::from_millis(1);

/// Number of kinds.
pub(super) const KINDS: usize = 5;

/// Faults per frame of a rough link.
const ROUGH: [(Fault, f64); 10] = [
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

/// So many times the faults of a rough link, as far as the transport can have them.
fn rates(factor: f64, transport: Transport) -> Vec<(Fault, FaultRate)> {
    ROUGH
        .into_iter()
        .filter(|(fault, _)| fault.suits(transport))
        .map(|(fault, per_frame)| {
            let rate = FaultRate {
                per_frame: factor * per_frame,
                parameter: None,
            };
            (fault, rate)
        })
        .collect()
}

/// A plan of this kind: clean, rough, very rough, late, scripted.
pub(super) fn plan(kind: usize, noise: &mut Noise, transport: Transport) -> FaultPlan {
    let plan = FaultPlan {
        seed: noise.number(),
        delay: MS / 10,
        jitter: if kind == 3 { 2 * MS } else { MS / 10 },
        rates: match kind {
            1 => rates(1.0, transport),
            2 => rates(10.0, transport),
            _ => Vec::new(),
        },
        direction: [Directions::Both, Directions::Up, Directions::Down][noise.below(3)],
        script: if kind == 4 {
            script(noise, transport)
        } else {
            Vec::new()
        },
    };
    plan.check(transport).unwrap();
    plan
}

/// True if a frame sometimes takes longer than a tick without any fault.
pub(super) fn is_slow(plan: &FaultPlan) -> bool {
    plan.jitter > MS / 4
}

/// A few faults at stated frames and ticks.
fn script(noise: &mut Noise, transport: Transport) -> Vec<ScriptedFault> {
    let script = (0..4).map(|index| {
        let fault = Fault::ALL[noise.below(Fault::ALL.len())];
        let at = 100 * index + noise.below(100);
        let timed = [Fault::Burst, Fault::Stall].contains(&fault);
        ScriptedFault {
            when: if noise.below(2) == 0 {
                When::Frame(u64::try_from(at).unwrap() + 1)
            } else {
                When::Since(MS * u32::try_from(at).unwrap())
            },
            direction: [Directions::Up, Directions::Down][noise.below(2)],
            fault,
            parameter: timed.then(|| u32::try_from(noise.below(30)).unwrap()),
        }
    });
    script
        .filter(|entry| entry.fault.suits(transport))
        .collect()
}
