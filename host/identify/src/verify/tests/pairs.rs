//! Pairs of windows in the rows of a table.

use gantry_tau_machine::model::L2;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_system::output::Name;

use super::WORKPIECE;
use super::simulated::{Draw, N, SETUP, identified, measured};
use crate::measurements::springs::{Campaign, SetupNoise, Window};
use crate::verify::verify;

/// The same windows in series of their own, each with its rows without a load; those of the second
/// mounted again, with other zeros.
fn in_two_series(campaign: &Campaign<N>) -> Campaign<N> {
    let mut split = campaign.clone();
    split.series = campaign
        .series
        .iter()
        .flat_map(|name| ["off", "on"].map(|state| Name::made(format_args!("{name} {state}"))))
        .collect();
    let mut names = std::collections::HashSet::new();
    for window in &mut split.windows {
        let is_second = !names.insert((window.series, window.window.clone()));
        window.series = 2 * window.series + usize::from(is_second);
    }
    let again: Vec<Window<N>> = split
        .windows
        .iter()
        .filter(|window| window.load.norm() < 50.0)
        .cloned()
        .collect();
    split.windows.extend(again.into_iter().map(|window| Window {
        series: window.series + 1,
        ..window
    }));
    for window in split
        .windows
        .iter_mut()
        .filter(|window| window.series % 2 == 1)
    {
        window
            .readings_m
            .iter_mut()
            .flatten()
            .for_each(|reading| *reading += 3e-4);
    }
    for (line, window) in (2..).zip(&mut split.windows) {
        window.line = line;
    }
    split
}

/// The error of a campaign that was changed.
fn refused(
    file: &RobotFile<L2, N>,
    campaign: &Campaign<N>,
    change: impl Fn(&mut Campaign<N>),
) -> String {
    let mut campaign = campaign.clone();
    change(&mut campaign);
    verify(file, &campaign, WORKPIECE).unwrap_err().to_string()
}

/// Index of the first window of a series with a load.
fn first_loaded(campaign: &Campaign<N>, series: usize) -> usize {
    campaign
        .windows
        .iter()
        .position(|window| window.series == series && window.load.norm() > 50.0)
        .unwrap()
}

/// Two series of a strap are judged as one that holds both windows, under any zeros of theirs.
#[test]
fn pairs_may_stand_in_series_of_their_own() {
    let mut file = identified();
    file.simulation.jump_gap_m = 0.0;
    let mut draw = Draw::new(7);
    let truth = draw.machine(&file);
    let together = measured(&file, &truth, SETUP, &mut draw);
    let apart = in_two_series(&together);
    let [one, two] =
        [&together, &apart].map(|campaign| verify(&file, campaign, WORKPIECE).unwrap());
    assert_eq!((one.pairs.len(), two.pairs.len()), (120, 120));
    for (one, two) in one.pairs.iter().zip(&two.pairs) {
        assert_eq!((&one.series, &one.window), (&two.series, &two.window));
        // The zeros are the same rows, moved by a third of a millimetre: rounding, and q of the
        // rows that is rounded to a nanometre.
        assert!(
            (one.after_m - two.after_m).abs() < 2e-9 && (one.before_m - two.before_m).abs() < 2e-9
        );
        assert!((one.z - two.z).abs() < 1e-3, "{} {}", one.z, two.z);
    }
    // Six gauges of twenty series have another zero, and two more readings for each.
    assert_eq!(two.fit.dof, one.fit.dof + 20 * 6);
    assert!(two.fit.p > 1e-3, "{two}");
    let [off, on] = [0, 1].map(|series| first_loaded(&apart, series));
    let alone = refused(&file, &apart, |campaign| {
        campaign.windows[on].window = Name::made("other");
    });
    assert!(
        alone.contains("window \"0\" must stand once in series \"s0 on\", its other half"),
        "{alone}"
    );
    let swapped = refused(&file, &apart, |campaign| campaign.series.swap(0, 1));
    assert!(swapped.contains("compensation was on"), "{swapped}");
    let moved = refused(&file, &apart, |campaign| {
        campaign
            .windows
            .iter_mut()
            .filter(|window| window.series == 1)
            .for_each(|window| window.mounting += 100);
    });
    assert!(moved.contains("must occur twice in its series"), "{moved}");
    let same = refused(&file, &apart, |campaign| {
        campaign.windows[on].q = campaign.windows[off].q;
    });
    assert!(
        same.contains("with compensation on it contains the offsets"),
        "{same}"
    );
    // A series that was broken off, and mounted again.
    let mut again = apart.clone();
    again.series.push(Name::made("s0 on.2"));
    let last = again.series.len() - 1;
    again
        .windows
        .iter_mut()
        .filter(|window| window.series == 1)
        .for_each(|window| window.series = last);
    let mut broken = Window {
        series: 1,
        window: Name::made("5"),
        ..again.windows[on].clone()
    };
    broken
        .readings_m
        .iter_mut()
        .flatten()
        .for_each(|reading| *reading += 1e-7);
    again.windows.push(broken);
    let found = verify(&file, &again, WORKPIECE).unwrap();
    assert_eq!((found.pairs.len(), found.fit.dof), (120, two.fit.dof));
}

#[test]
fn rows_without_a_partner_are_refused() {
    let file = identified();
    let good = measured(
        &file,
        file.compliances.as_ref().unwrap(),
        SetupNoise::default(),
        &mut Draw::new(4),
    );
    let alone = refused(&file, &good, |campaign| {
        campaign.windows[2].window = Name::made("other");
    });
    assert!(
        alone.starts_with("verify.csv:3: window \"0\" must occur twice"),
        "{alone}"
    );
    let same = refused(&file, &good, |campaign| {
        campaign.windows[2].q = campaign.windows[1].q;
    });
    assert!(
        same.starts_with("verify.csv:4: q is that of line 3"),
        "{same}"
    );
    let load = refused(&file, &good, |campaign| campaign.windows[2].load *= 0.5);
    assert!(
        load.starts_with("verify.csv:4: the load is not that of line 3"),
        "{load}"
    );
    let no_zero = refused(&file, &good, |campaign| {
        campaign.windows.retain(|window| window.load.norm() > 100.0);
    });
    assert!(no_zero.contains("no row without a load"), "{no_zero}");
    let none = refused(&file, &good, |campaign| {
        campaign.windows.retain(|window| window.load.norm() < 100.0);
    });
    assert!(none.contains("no pair of windows"), "{none}");
}
