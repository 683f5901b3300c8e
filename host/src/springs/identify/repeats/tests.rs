use super::*;
use crate::measurements::springs::Noise;
use crate::springs::campaigns::{Bench, FINE, campaign_a, never, seeded};
use crate::springs::lines::State;

fn measured(seed: u64) -> Bench<3> {
    let mut random = seeded(seed);
    let mut bench = campaign_a(FINE);
    let truth = bench.true_springs(&mut random);
    bench.measure(&truth, &mut random, 0.0, never);
    bench
}

fn repeats(bench: &Bench<3>) -> Repeats {
    let question = bench.question();
    let agreement = Agreement::find(&question, &Choice::all(&bench.campaign), State::start(&question), true).unwrap();
    Repeats::of(&question, &agreement).unwrap()
}

/// 11 windows at 6 levels, nine gauges, nine series: 5 repeats each. The noise that they show is that of the campaign, and the model is not
/// accused more often than it should be, whatever noise the set-up states.
#[test]
fn repeats_show_the_noise() {
    let (mut noise, mut accused, mut small) = (0.0, 0, 0);
    let campaigns = 100;
    for seed in 0..campaigns {
        let mut bench = measured(seed);
        let Repeats { pure, lack, .. } = repeats(&bench);
        // A clean reading is refused now and then.
        let refused = 801 - lack.degrees - pure.degrees;
        assert!(refused <= 2 && lack.degrees == 801 - 405 && pure.degrees == 9 * 9 * 5 - refused, "{seed}");
        noise += pure.mean() / campaigns as f64;
        // Three times the noise is stated: ratios stay.
        bench.campaign.noise = Noise { gauge_um: 3.0, force_n: 3.0, moment_nm: 0.15 };
        let Repeats { pure: ninth, .. } = repeats(&bench);
        assert!((ninth.mean() * 9.0 / pure.mean() - 1.0).abs() < 0.1, "{seed}");
        let found = repeats(&bench);
        accused += usize::from(found.p() < 0.05);
        small += found.standing_out.len();
    }
    // 100 times 405 degrees: the deviation of the mean is 0.7 %; of 100 with 5 % more than 13 are 0.1 %.
    assert!((noise - 1.0).abs() < 0.025, "{noise}");
    assert!(accused <= 13 && small <= 1, "{accused} {small}");
}

/// `[T 6.1]`: a gauge on the back of a cart gave a non-linear result. Its bow of 6 um over the strokes is seen, and the gauge is named.
#[test]
fn a_gauge_with_a_bow_is_named() {
    for seed in 0..10 {
        let mut bench = measured(seed);
        let mut bowed = 0.0;
        for window in &mut bench.campaign.windows {
            let share = window.load.fixed_rows::<3>(0).norm() / 300.0;
            let bow = 24e-6 * share * (1.0 - share);
            window.readings_m[7] = window.readings_m[7].map(|reading| reading + bow);
            bowed = f64::max(bowed, bow);
        }
        assert!((5e-6..6.1e-6).contains(&bowed));
        let found = repeats(&bench);
        assert!(found.p() < 1e-4, "{seed}: {found:?}");
        assert_eq!(found.standing_out.first(), Some(&7), "{seed}: {found:?}");
        assert!((found.pure.mean() - 1.0).abs() < 0.3, "{seed}: the repeats know nothing of it: {found:?}");
    }
}

#[test]
fn nothing_repeated_says_nothing() {
    let mut bench = measured(1);
    // Strokes up only: every level once.
    let mut kept = Vec::new();
    std::mem::swap(&mut kept, &mut bench.campaign.windows);
    bench.campaign.windows = kept.into_iter().filter(|window| window.stroke > 0).collect();
    let question = bench.question();
    let agreement = Agreement::find(&question, &Choice::all(&bench.campaign), State::start(&question), true).unwrap();
    assert_eq!(Repeats::of(&question, &agreement), None);
}

/// Drifts of 0.5 um/min take degrees of freedom from the repeats: they are nearly orthogonal to levels that go up and down again.
#[test]
fn drifts_are_no_lack_of_fit() {
    let (mut noise, mut accused) = (0.0, 0);
    let campaigns = 30;
    for seed in 0..campaigns {
        let mut bench = measured(seed);
        for (index, window) in bench.campaign.windows.iter_mut().enumerate() {
            let seconds = 15.0 * float(index);
            window.time_s = Some(seconds);
            for (gauge, reading) in window.readings_m.iter_mut().enumerate() {
                *reading = reading.map(|reading| reading + 0.5e-6 / 60.0 * seconds * (float(gauge) - 4.0) / 4.0);
            }
        }
        let question = bench.question();
        let choice = Choice { has_drift: true, ..Choice::all(&bench.campaign) };
        let agreement = Agreement::find(&question, &choice, State::start(&question), true).unwrap();
        let found = Repeats::of(&question, &agreement).unwrap();
        // Nine series of nine gauges: five repeats and a drift each; a clean reading is refused now and then.
        assert!((81 * 4 - 2..=81 * 4).contains(&found.pure.degrees), "{seed}: {found:?}");
        noise += found.pure.mean() / campaigns as f64;
        accused += usize::from(found.p() < 0.05);
    }
    // 30 times 324 degrees: the deviation of the mean is 1.4 %; of 30 with 5 % more than 6 are 0.1 %.
    assert!((noise - 1.0).abs() < 0.05, "{noise}");
    assert!(accused <= 6, "{accused}");
}
