//! Loads on both machines.

use gantry_tau_tests::fuzzed::Loads;

use super::Seed;
use super::bytes::{fields, seeds};

fields!(Loads: gain, cutoff_hz, notches, limits, scales, step, lost, wrenches);

const PUSH: [f64; 6] = [360.0, -50.0, 12.0, 3.0, -2.0, 1.0];

fn none() -> Loads {
    Loads {
        gain: 4,
        cutoff_hz: 10,
        notches: None,
        limits: [200_000; 6],
        scales: [1.0; 6],
        step: [0; 6],
        lost: None,
        wrenches: vec![[0.0; 6]],
    }
}

/// No wrench, a push, and then this one.
fn pushed(wrench: [f64; 6]) -> Loads {
    Loads {
        wrenches: vec![[0.0; 6], PUSH, wrench],
        ..none()
    }
}

pub(crate) fn seeds() -> Vec<Seed> {
    let mut no_moment = PUSH;
    no_moment[3] = f64::NAN;
    seeds! {
        "no_load" => none();
        "a_push_of_360_n" => pushed(PUSH);
        "a_push_and_notches" => Loads { notches: Some([207, 476, 0]), ..pushed(PUSH) };
        "nan_force" => pushed([f64::NAN; 6]);
        "nan_moment" => pushed(no_moment);
        "infinite" => pushed([f64::NEG_INFINITY; 6]);
        "largest" => pushed([f64::MAX; 6]);
        "smallest" => pushed([5e-324; 6]);
        "beyond_the_range_of_the_sensor" => pushed([1.000_001e6; 6]);
        "limits_of_zero" => Loads { limits: [0; 6], ..pushed(PUSH) };
        "limits_negative" => Loads { limits: [-1; 6], ..pushed(PUSH) };
        "gain_too_large" => Loads { gain: 7, ..pushed(PUSH) };
        "scales_that_are_none" => Loads { scales: [f64::NAN, 0.0, -1.0, 1e-7, f64::INFINITY, 1e4], ..pushed(PUSH) };
        "at_the_edge_of_the_workspace" => Loads { step: [9_000, 2_000, 2_000, 3_000, -3_000, 3_000], ..pushed(PUSH) };
        "lost" => Loads { lost: Some([f64::NAN, f64::INFINITY, 1e300, 0.0, -0.0, 1e-300]), ..pushed(PUSH) };
        "positions_of_another_pose" => Loads { lost: Some([0.6, -0.6, 0.6, 0.1, -0.1, 0.0]), ..pushed(PUSH) };
    }
}
