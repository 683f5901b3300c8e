//! Mistakes that people make with a campaign are refused or named, and campaigns without one are
//! accused of nothing.

mod checks;
mod columns;
mod instruments;
mod without_mistake;

use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_test_support::seeds::Seeds;
use rand_chacha::ChaCha8Rng;

use super::examine;
use super::weak_campaigns::{options, strap};
use crate::fit::answer::Parameter;
use crate::measurements::springs::Noise;
use crate::springs::fixture::{FINE, HOOKS, Strap, TestBench, never, seeded, straps};

/// Spoils a campaign; returns the gauge that an error should name, if it should name one.
type Spoil<const N: usize> = fn(&mut TestBench<N>, &mut ChaCha8Rng) -> Option<usize>;

/// A mistake, and the words that an error should have.
struct MistakeCase<const N: usize>(&'static str, &'static str, Spoil<N>);

/// Verdict over a campaign.
#[derive(Debug, PartialEq)]
enum Verdict {
    /// Refused, with the error.
    Refused(String),
    /// Exit code 3, with the doubts that are not about springs that are not seen.
    Doubted(Vec<String>),
    /// Springs are not seen, which is exit code 3 too.
    Unseen,
    /// Exit code 0, and the largest deviation of a spring beyond three of its standard deviations,
    /// in true values.
    Written(f64),
}

fn verdict<const N: usize>(bench: &TestBench<N>, truth: &[f64]) -> Verdict {
    let found = match examine(&bench.problem(), &options()) {
        Err(error) => return Verdict::Refused(error.to_string()),
        Ok(found) => found,
    };
    let answer = found.answer("l2");
    let (unseen, doubts): (Vec<String>, Vec<String>) =
        found.doubts(&answer).into_iter().partition(|doubt| {
            doubt.contains("not observable") || doubt.contains("does not measure it")
        });
    match (doubts.is_empty(), unseen.is_empty()) {
        (false, _) => Verdict::Doubted(doubts),
        (true, false) => Verdict::Unseen,
        (true, true) => Verdict::Written(
            answer
                .parameters
                .iter()
                .zip(truth)
                .map(|(parameter, truth)| significant_error(parameter, *truth))
                .fold(0.0, f64::max),
        ),
    }
}

/// Error of a parameter in its true value; 0 within three standard deviations.
fn significant_error(parameter: &Parameter, truth: f64) -> f64 {
    let Parameter { value, sd, .. } = parameter;
    if (value - truth).abs() > 3.0 * sd {
        (value / truth - 1.0).abs()
    } else {
        0.0
    }
}

/// A campaign without a mistake, and the true springs.
fn good<const N: usize>(mut bench: TestBench<N>, seed: u64) -> (TestBench<N>, Vec<f64>) {
    let mut random = seeded(seed);
    let truth = bench.true_springs(&mut random);
    bench.measure(&truth, &mut random, 0.0, never);
    (bench, truth.vector().as_slice().to_vec())
}

fn gauge_name<const N: usize>(bench: &TestBench<N>, gauge: usize) -> String {
    bench.campaign.gauges[gauge].name.to_string()
}

fn fine(gauge_um: f64) -> Noise {
    Noise { gauge_um, ..FINE }
}

fn f1() -> TestBench<6> {
    f1_with(FINE)
}

/// Nine straps at home, each of seven windows.
fn f1_with(noise: Noise) -> TestBench<6> {
    let robot = RobotFile::builtin_f1().unwrap();
    let straps: Vec<Strap> = straps(1, &HOOKS)
        .into_iter()
        .map(|full| Strap {
            hook: full.hook,
            ..strap(full.direction, 300.0, 3)
        })
        .collect();
    TestBench::new(&robot, &[robot.home_m().into()], &straps, noise)
}

fn assert_named<const N: usize>(
    mistakes: impl IntoIterator<Item = MistakeCase<N>>,
    planned: impl Fn() -> TestBench<N>,
) {
    let mut failures = Vec::new();
    for MistakeCase(name, words, spoil) in mistakes {
        let mut rightly = 0;
        let mut count = 0;
        let mut example = String::new();
        for seed in Seeds::new(1, 1).iter() {
            let (mut bench, truth) = good(planned(), seed);
            let gauge =
                spoil(&mut bench, &mut seeded(1_000 + seed)).map(|gauge| gauge_name(&bench, gauge));
            let verdict = verdict(&bench, &truth);
            let said = match &verdict {
                Verdict::Refused(said) => said.clone(),
                Verdict::Doubted(doubts) => doubts.join("; "),
                Verdict::Unseen => String::new(),
                Verdict::Written(off) => {
                    if *off > 0.2 {
                        failures.push(format!(
                            "{name}, seed {seed}: written, {:.0} % off",
                            off * 100.0
                        ));
                    }
                    String::new()
                }
            };
            count += 1;
            let is_right = !said.is_empty()
                && said.contains(words)
                && gauge.as_ref().is_none_or(|gauge| said.contains(gauge));
            rightly += u32::from(is_right);
            if example.is_empty() || !is_right {
                example = format!("seed {seed}: {said}");
            }
        }
        if f64::from(rightly) < 0.95 * f64::from(count) {
            failures.push(format!("{name}: {rightly} of {count} rightly; {example}"));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
