//! Campaigns that do not show every spring: what an answer says of each must be true.

use std::collections::BTreeMap;

use gantry_tau_machine::elastic::gauge::{Body, Gauge};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_test_support::seeds::Seeds;
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::fit::answer::{Parameter, Status};
use crate::springs::fixture::{FINE, HOME, HOOKS, Strap, TestBench, seeded};

/// Sum of the tensions of cluster 3 at which the simulated play opens at home: that of 360 N in x.
pub(super) const OPENS_AT_N: f64 = -169.0;
/// Elongation of the links of cluster 3 beyond it, m.
pub(super) const GAP_M: f64 = -40e-6;

/// A kind of weak campaign.
pub(super) struct WeakCampaign {
    pub(super) name: &'static str,
    bench: fn() -> TestBench<3>,
    /// Gauges that are read in a series.
    read: fn(usize) -> Vec<usize>,
    gap_m: f64,
}

const ALL: fn(usize) -> Vec<usize> = |_| (0..9).collect();
const ON_PLATFORM: fn(usize) -> Vec<usize> = |_| (0..6).collect();
/// First the carts, then the links by three gauges at one point `[T 4.2.9]`.
const AS_THE_THESIS: fn(usize) -> Vec<usize> = |series| {
    if series == 0 {
        vec![6, 7, 8]
    } else {
        vec![0, 1, 2]
    }
};

pub(super) const WEAK_CAMPAIGNS: [WeakCampaign; 8] = [
    WeakCampaign {
        name: "one strap, 6 gauges, 100 N",
        bench: || one_strap(100.0),
        read: ON_PLATFORM,
        gap_m: 0.0,
    },
    WeakCampaign {
        name: "one strap, 9 gauges, 100 N",
        bench: || one_strap(100.0),
        read: ALL,
        gap_m: 0.0,
    },
    WeakCampaign {
        name: "one strap, 6 gauges, 300 N",
        bench: || one_strap(300.0),
        read: ON_PLATFORM,
        gap_m: 0.0,
    },
    WeakCampaign {
        name: "one strap, 9 gauges, 300 N",
        bench: || one_strap(300.0),
        read: ALL,
        gap_m: 0.0,
    },
    WeakCampaign {
        name: "x to 320 N",
        bench: || in_x(320.0),
        read: AS_THE_THESIS,
        gap_m: 0.0,
    },
    WeakCampaign {
        name: "x to 480 N, beyond the jump",
        bench: || in_x(480.0),
        read: AS_THE_THESIS,
        gap_m: GAP_M,
    },
    WeakCampaign {
        name: "two straps",
        bench: two_straps,
        read: ALL,
        gap_m: 0.0,
    },
    WeakCampaign {
        name: "gauges at one point",
        bench: at_one_point,
        read: |_| vec![0, 1, 2, 6, 7, 8],
        gap_m: 0.0,
    },
];

pub(super) fn strap(direction: Vector3<f64>, most_n: f64, steps: u8) -> Strap {
    let rising = (0..=steps).map(|step| most_n * f64::from(step) / f64::from(steps));
    let levels: Vec<f64> = rising.clone().chain(rising.rev().skip(1)).collect();
    Strap {
        pose: 0,
        hook: HOOKS[0],
        direction,
        levels,
    }
}

pub(super) fn on_home(straps: &[Strap]) -> TestBench<3> {
    TestBench::new(&RobotFile::builtin_l2().unwrap(), &[HOME], straps, FINE)
}

fn one_strap(most_n: f64) -> TestBench<3> {
    on_home(&[strap(Vector3::x(), most_n, 5)])
}

/// `[T 4.2.9]`: a strap in x for the carts, another for the links with three gauges at one point.
fn in_x(most_n: f64) -> TestBench<3> {
    let mut bench = on_home(&[
        strap(Vector3::x(), most_n, 8),
        strap(Vector3::x(), most_n, 8),
    ]);
    put_at_one_point(&mut bench);
    bench
}

fn two_straps() -> TestBench<3> {
    on_home(&[strap(Vector3::x(), 300.0, 5), strap(Vector3::y(), 300.0, 5)])
}

/// Three gauges at one point, and those of the carts.
fn at_one_point() -> TestBench<3> {
    let mut bench =
        on_home(&[Vector3::x(), Vector3::y(), Vector3::z()].map(|along| strap(along, 300.0, 5)));
    put_at_one_point(&mut bench);
    bench
}

fn put_at_one_point(bench: &mut TestBench<3>) {
    for (named, axis) in
        bench
            .campaign
            .gauges
            .iter_mut()
            .zip([Vector3::x(), Vector3::y(), Vector3::z()])
    {
        named.gauge = Gauge::Face {
            body: Body::Platform,
            point_m: Vector3::new(0.0, 0.0, 0.1),
            axis,
        };
    }
}

pub(super) fn measured(kind: &WeakCampaign, random: &mut ChaCha8Rng) -> (TestBench<3>, Vec<f64>) {
    let mut bench = (kind.bench)();
    let truth = bench.true_springs(random);
    bench.measure(&truth, random, kind.gap_m, |cluster_3_n, _| {
        f64::from(u8::from(cluster_3_n < OPENS_AT_N))
    });
    for window in &mut bench.campaign.windows {
        let read = (kind.read)(window.series);
        for (gauge, reading) in window.readings_m.iter_mut().enumerate() {
            *reading = reading.filter(|_| read.contains(&gauge));
        }
    }
    (bench, truth.vector().as_slice().to_vec())
}

pub(super) fn options() -> IdentifyOptions {
    IdentifyOptions::new(PathBuf::new(), "l2")
}

/// Intervals that hold, of how many, per status.
#[derive(Debug, Default)]
struct Tally(BTreeMap<&'static str, (u32, u32)>);

impl Tally {
    fn count(&mut self, parameter: &Parameter, file: f64, truth: f64) {
        let (held, all) = self.0.entry(parameter.status.name()).or_default();
        *all += 1;
        *held += u32::from(match parameter.interval() {
            None => parameter.value.to_bits() == file.to_bits(),
            Some([low, high]) => (low..=high).contains(&truth),
        });
    }

    fn count_of(&self, status: Status) -> f64 {
        self.0
            .get(status.name())
            .map_or(f64::NAN, |(_, all)| f64::from(*all))
    }

    fn share(&self, status: Status) -> Option<f64> {
        let (held, all) = self.0.get(status.name())?;
        Some(f64::from(*held) / f64::from(*all))
    }
}

fn tally(kind: &WeakCampaign, seeds: Seeds, failures: &mut Vec<String>) -> Tally {
    let mut tally = Tally::default();
    for seed in seeds.iter() {
        let (bench, truth) = measured(kind, &mut seeded(seed));
        let problem = bench.problem();
        match answer_of(problem, "l2", &options()) {
            Ok((answer, _)) => {
                let file = bench.file.vector();
                for (index, truth) in truth.iter().enumerate() {
                    tally.count(&answer.parameters[index], file[index], *truth);
                }
            }
            Err(error) => failures.push(format!("{}, seed {seed}: {error}", kind.name)),
        }
    }
    tally
}

/// 95 % intervals hold in 93 to 97 % where the readings say them, in more where the file's
/// uncertainty is part of them. A share of `n` scatters by the root of `0.05 0.95 / n`: three of
/// these are allowed on either side.
#[test]
fn what_is_said_of_a_spring_holds_in_weak_campaigns() {
    let seeds = Seeds::new(6, 200);
    let mut failures = Vec::new();
    for kind in &WEAK_CAMPAIGNS {
        let tally = tally(kind, seeds, &mut failures);
        for status in [Status::Identified, Status::Weak] {
            if let Some(share) = tally.share(status) {
                let scatter = 3.0 * (0.05 * 0.95 / tally.count_of(status)).sqrt();
                let slack = (scatter - 0.02).max(0.0);
                assert!(
                    (0.93 - slack..=0.97 + slack).contains(&share),
                    "{}: {status:?} {tally:?}",
                    kind.name
                );
            }
        }
        let least = 0.95 - seeds.widened(0.02);
        assert!(
            tally
                .share(Status::Depends)
                .is_none_or(|share| share >= least),
            "{}: {tally:?}",
            kind.name
        );
        assert!(
            tally.share(Status::Kept).is_none_or(|share| share >= 1.0),
            "{}: {tally:?}",
            kind.name
        );
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// The sentence names the spring, which keeps the file's value, and straps that do measure it.
#[test]
fn a_spring_whose_best_value_is_negative_is_not_measured() {
    let kind = &WEAK_CAMPAIGNS[3];
    let mut tried = 0;
    let seeds = Seeds::new(20, 60);
    for seed in seeds.iter() {
        let (bench, _) = measured(kind, &mut seeded(seed));
        let found = find(bench.problem(), &options()).unwrap();
        let answer = found.answer("l2");
        for spring in &found.not_positive {
            assert!(
                (-3.0 * spring.sd..=0.0).contains(&spring.factor),
                "{spring:?}"
            );
            let parameter = &answer.parameters[spring.spring];
            assert_eq!(
                (parameter.status, parameter.value),
                (Status::Kept, bench.file.vector()[spring.spring])
            );
            let said = found.not_measured(spring);
            assert!(found.doubts(&answer).contains(&said));
            let start = format!("the best value of {} would be negative, -", parameter.name);
            assert!(
                said.starts_with(&start)
                    && said.contains(" of the file's: this campaign does not measure it"),
                "{said}"
            );
            let (_, advice) = said.rsplit_once("; ").unwrap();
            let directions = [
                ("x", Vector3::x()),
                ("y", Vector3::y()),
                ("z", Vector3::z()),
            ];
            for (_, along) in directions
                .iter()
                .filter(|(name, _)| advice.split(' ').any(|word| word == *name))
            {
                let mut more = on_home(&[strap(Vector3::x(), 300.0, 5), strap(*along, 300.0, 5)]);
                more.measure(&bench.file, &mut seeded(seed), 0.0, |_, _| 0.0);
                let (answer, _) = answer_of(more.problem(), "l2", &options()).unwrap();
                let parameter = &answer.parameters[spring.spring];
                assert!(
                    parameter.status != Status::Kept && parameter.sd < 0.3 * parameter.value,
                    "{said}: {parameter:?}"
                );
                tried += 1;
            }
        }
    }
    assert!(20 * tried > seeds.count, "{tried}");
}
