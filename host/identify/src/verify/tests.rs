//! Machines drawn from what a file says of its springs, measured and predicted.

mod pairs;
mod prediction;
mod simulated;

use gantry_tau_machine::model::L2;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile, text_of};

use super::verify;
use crate::measurements::springs::SetupNoise;
use simulated::{Draw, N, SETUP, compliances, identified, measured, springs};

const WORKPIECE: f64 = 1e9;

/// Root mean square of the z-scores of machines out of those that the file takes for possible; none
/// may be doubted.
fn z_rms(machines: u32, setup: SetupNoise, seed: u64) -> f64 {
    let mut file = identified();
    // Every load counts: these machines have no play.
    file.simulation.jump_gap_m = 0.0;
    let mut draw = Draw::new(seed);
    let mut squares = 0.0;
    for _ in 0..machines {
        let truth = draw.machine(&file);
        let found = verify(&file, &measured(&file, &truth, setup, &mut draw), WORKPIECE).unwrap();
        assert_eq!((found.judged.pairs, found.at_the_jump.pairs), (120, 0));
        squares += found.judged.z_rms.powi(2);
        assert_eq!(found.doubts(30e-6), [""; 0], "{found}");
        assert!(found.judged.share < 0.03, "{found}");
    }
    (squares / f64::from(machines)).sqrt()
}

/// Remainders are as large as predicted, by springs and by noise; pooled, as the z-scores of one
/// machine share its springs.
#[test]
fn machines_that_the_file_knows_remain_as_predicted() {
    let found = z_rms(12, SetupNoise::default(), 1);
    assert!((0.8..1.2).contains(&found), "{found}");
}

#[test]
fn a_set_up_that_is_off_as_stated_changes_nothing() {
    let found = z_rms(12, SETUP, 5);
    assert!((0.8..1.2).contains(&found), "{found}");
    // The same errors, not stated, are taken for a wrong machine.
    let file = identified();
    let mut draw = Draw::new(6);
    let mut campaign = measured(&file, file.compliances.as_ref().unwrap(), SETUP, &mut draw);
    campaign.setup = SetupNoise::default();
    let found = verify(&file, &campaign, WORKPIECE).unwrap();
    assert!(found.fit.p < 1e-3, "{found}");
}

#[test]
fn springs_that_are_off_by_a_third_are_rejected() {
    let file = identified();
    let mut draw = Draw::new(2);
    let values = springs(file.compliances.as_ref().unwrap());
    let truth = compliances(&std::array::from_fn(|index| {
        values[index] * if index % 2 == 0 { 1.3 } else { 0.7 }
    }));
    let found = verify(
        &file,
        &measured(&file, &truth, SetupNoise::default(), &mut draw),
        WORKPIECE,
    )
    .unwrap();
    assert!(found.judged.z_rms > 5.0 && found.fit.p < 1e-12, "{found}");
    assert_eq!(found.doubts(20e-6).len(), 2, "{found}");
    // Loads across the jump are counted apart.
    assert!(
        found.at_the_jump.pairs > 10 && found.judged.pairs + found.at_the_jump.pairs == 120,
        "{found}"
    );
}

/// The L2 as if identified, without play, with offsets of at most so many µm.
fn with_limits(max_um: f64) -> RobotFile<L2, N> {
    let limits = format!("max_um = {:?}", [max_um; N]);
    let tight = text_of("l2")
        .unwrap()
        .replace("max_um = [2000.0, 2000.0, 2000.0]", &limits);
    let AnyRobotFile::L2(tight) = AnyRobotFile::parse("tight", &tight).unwrap() else {
        panic!("not an L2")
    };
    let mut file = identified();
    file.simulation.jump_gap_m = 0.0;
    file.limits = tight.limits;
    file
}

/// With every correction cut nothing was verified.
#[test]
fn pairs_of_which_none_is_judged_are_a_doubt() {
    let file = with_limits(5.0);
    let mut draw = Draw::new(8);
    let truth = draw.machine(&file);
    let found = verify(
        &file,
        &measured(&file, &truth, SetupNoise::default(), &mut draw),
        WORKPIECE,
    )
    .unwrap();
    assert_eq!(
        (found.judged.pairs, found.saturated.pairs),
        (0, 120),
        "{found}"
    );
    assert_eq!(
        found.doubts(1.0),
        ["no pair is judged: 0 across the jump, 120 at an offset limit"]
    );
}

/// A correction that a limit of the offsets cuts is not a fault of the springs: judged apart.
#[test]
fn corrections_that_a_limit_cuts_are_judged_apart() {
    let file = with_limits(300.0);
    let mut draw = Draw::new(8);
    let truth = draw.machine(&file);
    let found = verify(
        &file,
        &measured(&file, &truth, SetupNoise::default(), &mut draw),
        WORKPIECE,
    )
    .unwrap();
    assert!(
        found.saturated.pairs > 10 && found.judged.pairs > 10,
        "{found}"
    );
    assert_eq!(found.saturated.pairs + found.judged.pairs, 120, "{found}");
    assert!(found.saturated.after_largest_m > 50e-6, "{found}");
    // What the limits leave is predicted like everything else.
    assert!(
        found.saturated.z_rms < 2.0 && found.judged.share < 0.03,
        "{found}"
    );
    assert_eq!(found.doubts(30e-6), [""; 0], "{found}");
}
