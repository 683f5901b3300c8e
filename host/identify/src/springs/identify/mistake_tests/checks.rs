//! Each check by itself.

use gantry_tau_machine::robot_file::RobotFile;
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;

use super::{f1, fine, gauge_name, good};
use crate::springs::fixture::{FINE, campaign_a, never, normal, seeded};
use crate::springs::identify::weak_campaigns::{GAP_M, OPENS_AT_N, on_home, options, strap};
use crate::springs::identify::{examine, find};

/// Sentences about gauges and springs, each check by itself, of an F1 whose readings of one gauge
/// were changed.
fn sentences_of_gauge(
    gauge: usize,
    change: impl Fn(usize, f64, &mut ChaCha8Rng) -> f64,
) -> [Vec<String>; 4] {
    let (mut bench, _) = good(f1(), 0);
    let mut random = seeded(9);
    for (row, window) in bench.campaign.windows.iter_mut().enumerate() {
        window.readings_m[gauge] =
            window.readings_m[gauge].map(|reading| change(row, reading, &mut random));
    }
    let found = find(bench.problem(), &options()).unwrap();
    [
        found.uneven(),
        found.quiet(),
        found.far_off(),
        found.mostly_left_out().collect(),
    ]
}

/// Each check finds its own, whether or not another one does; gauge 11 is that of the last plate.
#[test]
fn checks_of_gauges_and_springs_find_their_own() {
    assert_eq!(
        sentences_of_gauge(11, |_, reading, _| reading).concat(),
        [""; 0]
    );
    let [_, quiet, ..] = sentences_of_gauge(11, |_, _, random| 0.2e-6 * normal(random));
    assert!(
        quiet
            .concat()
            .contains("axis6 scatters from series 0 on by 0.2"),
        "{quiet:?}"
    );
    let [uneven, ..] = sentences_of_gauge(11, |_, reading, _| -reading);
    assert!(uneven.concat().contains("gauge axis6 shows "), "{uneven:?}");
    let [.., left_out] = sentences_of_gauge(0, |row, reading, random| {
        reading
            + if row % 3 == 0 {
                40e-6 * normal(random)
            } else {
                0.0
            }
    });
    assert!(
        left_out
            .concat()
            .contains(" readings of gauge pz1 do not agree"),
        "{left_out:?}"
    );
}

/// A part that is softer than its file by far, and no other.
#[test]
fn a_spring_that_is_far_from_the_files_is_named() {
    let mut bench = f1();
    let mut random = seeded(1);
    let mut springs = bench.file.vector();
    springs[11] *= 4.0;
    let truth = bench.file.with(&springs);
    bench.measure(&truth, &mut random, 0.0, never);
    let found = find(bench.problem(), &options()).unwrap();
    let far_off = found.far_off();
    assert!(
        far_off.len() == 1 && far_off.concat().starts_with("c_act[5] is "),
        "{far_off:?}"
    );
    assert_eq!([found.uneven(), found.quiet()].concat(), [""; 0]);
}

/// The advice of `[T 6.1]` is about gauges on carts: not about those on the platform, nor on
/// plates.
#[test]
fn another_place_is_advised_for_gauges_on_carts() {
    let (bench, _) = good(f1(), 0);
    let found = find(bench.problem(), &options()).unwrap();
    let advised =
        (0..bench.campaign.gauges.len()).filter(|gauge| !found.another_place(&[*gauge]).is_empty());
    let names: Vec<String> = advised.map(|gauge| gauge_name(&bench, gauge)).collect();
    assert_eq!(names, ["axis1", "axis2", "axis3"]);
}

/// A play that opens at less than half of the expected preload is doubted; one where it is expected
/// is not.
#[test]
fn a_play_needs_forces_beyond_half_of_the_expected_preload() {
    let robot = RobotFile::builtin_l2().unwrap();
    for (opens_at_n, is_doubted) in [(OPENS_AT_N, false), (0.3 * OPENS_AT_N, true)] {
        let mut bench = on_home(
            &[Vector3::x(), Vector3::y(), Vector3::z()].map(|along| strap(along, 480.0, 12)),
        );
        let mut random = seeded(5);
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, GAP_M, |cluster_3_n, _| {
            f64::from(u8::from(cluster_3_n < opens_at_n))
        });
        let found = examine(&bench.problem(), &options()).unwrap();
        assert!(found.play.is_some(), "opens at {opens_at_n} N");
        let doubt = found.unexpected_play(&robot);
        assert_eq!(doubt.is_some(), is_doubted, "{doubt:?}");
        assert!(
            doubt.is_none_or(
                |doubt| doubt.starts_with("a play is found that opens at a preload of ")
            )
        );
    }
}

/// Without a stated noise the residuals are their own measure, and without repeats nothing else is.
#[test]
fn large_residuals_without_noise_and_repeats_are_not_believed() {
    for (noise_um, is_doubted) in [(1.0, false), (4.0, true)] {
        let (mut bench, _) = good(campaign_a(fine(noise_um)), 4);
        bench.campaign.windows.retain(|window| window.stroke > 0);
        bench.campaign.noise = FINE;
        bench.campaign.is_noise_stated = false;
        let found = find(bench.problem(), &options()).unwrap();
        let doubt = found.lack_of_fit_doubt(true);
        assert_eq!(doubt.is_some(), is_doubted, "{noise_um} um: {doubt:?}");
        assert!(doubt.is_none_or(|doubt| doubt.contains("no level was measured twice")));
    }
}

#[test]
fn more_than_a_tenth_of_the_readings_left_out_is_a_doubt() {
    for (every, is_doubt) in [(12, false), (8, true)] {
        let (mut bench, _) = good(campaign_a(FINE), 4);
        let readings = bench
            .campaign
            .windows
            .iter_mut()
            .flat_map(|window| &mut window.readings_m)
            .flatten();
        for (index, reading) in readings.skip(3).step_by(every).enumerate() {
            *reading += if index % 2 == 0 { 40e-6 } else { -40e-6 };
        }
        let found = find(bench.problem(), &options()).unwrap();
        let answer = found.answer("l2");
        let said = found
            .doubts(&answer)
            .iter()
            .any(|doubt| doubt.contains("of 891 readings do not agree"));
        assert_eq!(said, is_doubt, "one in {every}: {}", answer.outliers.len());
    }
}
