//! Loads on both machines.

use gantry_tau_tests::fuzzed::Loads;

use super::Seed;
use super::bytes::{fields, seeds};

fields!(Loads: gain, cutoff_hz, limits, scales, step, lost, wrenches);

pub(crate) fn seeds() -> Vec<Seed> {
    let none = Loads {
        gain: 4,
        cutoff_hz: 10,
        limits: [200_000; 6],
        scales: [1.0; 6],
        step: [0; 6],
        lost: None,
        wrenches: vec![[0.0; 6]],
    };
    let push = [360.0, -50.0, 12.0, 3.0, -2.0, 1.0];
    let pushed = |wrench: [f64; 6]| Loads { wrenches: vec![[0.0; 6], push, wrench], ..none.clone() };
    let mut no_moment = push;
    no_moment[3] = f64::NAN;
    seeds! {
        "no_load" => none.clone();
        "a_push_of_360_n" => pushed(push);
        "nan_force" => pushed([f64::NAN; 6]);
        "nan_moment" => pushed(no_moment);
        "infinite" => pushed([f64::NEG_INFINITY; 6]);
        "largest" => pushed([f64::MAX; 6]);
        "smallest" => pushed([5e-324; 6]);
        "beyond_the_range_of_the_sensor" => pushed([1.000_001e6; 6]);
        "limits_of_zero" => Loads { limits: [0; 6], ..pushed(push) };
        "limits_negative" => Loads { limits: [-1; 6], ..pushed(push) };
        "gain_too_large" => Loads { gain: 7, ..pushed(push) };
        "scales_that_are_none" => Loads { scales: [f64::NAN, 0.0, -1.0, 1e-7, f64::INFINITY, 1e4], ..pushed(push) };
        "at_the_edge_of_the_workspace" => Loads { step: [9_000, 2_000, 2_000, 3_000, -3_000, 3_000], ..pushed(push) };
        "lost" => Loads { lost: Some([f64::NAN, f64::INFINITY, 1e300, 0.0, -0.0, 1e-300]), ..pushed(push) };
        "positions_of_another_pose" => Loads { lost: Some([0.6, -0.6, 0.6, 0.1, -0.1, 0.0]), ..pushed(push) };
    }
}
