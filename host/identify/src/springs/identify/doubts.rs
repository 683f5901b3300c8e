//! Reasons to look at an identification again, and not to trust it as it is.

use gantry_tau_core::model::robot::ARMS;
use gantry_tau_machine::elastic::ElasticMachine;
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::gauge::Gauge;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use nalgebra::DMatrix;

use super::answer::SpringsAnswer;
use super::regimes::TwoRegimes;
use super::{IdentifiedSprings, names};
use crate::fit::answer::Unobservable;
use crate::fit::goodness::{self, MIN_P};
use crate::fit::held_directions::HeldDirections;
use crate::fit::statistics::float;
use crate::measurements::plan::before_remount;
use crate::measurements::springs::Campaign;
use crate::springs::decision::unobservable;
use crate::springs::preload::Preload;
use crate::springs::robust_fit::{RobustFit, deviations};

/// Largest share of readings that may be left out.
pub(super) const MAX_OUTLIERS: f64 = 0.1;
/// Largest chi-squared per degree of freedom, by the noise of usual instruments, that is believed
/// without repeats.
const MAX_UNPROVEN: f64 = 4.0;
/// Standard deviations of its prior that a constant of the set-up may move by before it is named.
const MAX_MOVED_SD: f64 = 3.0;

impl<const N: usize> IdentifiedSprings<'_, N> {
    /// Result in one line.
    pub(super) fn summary(&self, answer: &SpringsAnswer) -> String {
        let lost = self
            .robust_fit
            .active
            .held
            .as_ref()
            .map_or(0, HeldDirections::count);
        let readings = readings(self.problem.campaign);
        let left_out = answer.outliers.len();
        let play = match &answer.play {
            None => String::new(),
            Some(play) => format!(
                "; play of {:.1} +- {:.1} um",
                play.gap_m * 1e6,
                1.96 * play.sd_m * 1e6
            ),
        };
        let repeats = match &self.lack_of_fit {
            None => String::new(),
            Some(repeats) => {
                format!(
                    "; noise by repeats {:.2}, lack of fit p {:.2}",
                    repeats.pure.mean().sqrt(),
                    repeats.p()
                )
            }
        };
        let regimes = match &self.regimes {
            None | Some(Err(_)) => String::new(),
            Some(Ok(regimes)) => format!("; {}", regimes_summary(regimes)),
        };
        let reduced = answer.fit.reduced();
        // Noise that is taken from the residuals is right by itself.
        let p = if self.intervals.is_scaled {
            String::new()
        } else {
            format!(", p {:.2}", answer.fit.p)
        };
        format!(
            "{} of {} parameters seen; chi2/dof {reduced:.2}{p}{repeats}; {left_out} of {readings} readings left out{play}{regimes}",
            answer.parameters.len() - lost,
            answer.parameters.len(),
        )
    }

    /// Warnings: findings that need a look.
    pub(super) fn warnings(&self, answer: &SpringsAnswer) -> Vec<String> {
        let moved = answer
            .setup
            .iter()
            .filter(|constant| constant.moved_sd.abs() > MAX_MOVED_SD)
            .map(|constant| {
                format!(
                    "{} has moved by {:.1} of its standard deviations; look at it",
                    constant.name, constant.moved_sd
                )
            });
        let inside = self
            .play
            .iter()
            .flat_map(|play| &play.inside)
            .map(|window| {
                let window = &self.problem.campaign.windows[*window];
                let series = &self.problem.campaign.series[window.series];
                format!(
                    "window {} of series {series} is inside the jump, and left out",
                    window.window
                )
            });
        let names = self.names(&self.dropped);
        let dropped = (!names.is_empty()).then(|| {
            format!(
                "hysteresis below two standard deviations is left out: {}",
                names.join(", ")
            )
        });
        let regimes = match &self.regimes {
            Some(Err(reason)) => Some(format!("two regimes are not compared: {reason}")),
            None | Some(Ok(_)) => None,
        };
        self.not_measured_at_all()
            .chain(moved)
            .chain(inside)
            .chain(dropped)
            .chain(regimes)
            .chain(self.standing_out())
            .collect()
    }

    /// Series of the plan without a window, and gauges without a reading.
    fn not_measured_at_all(&self) -> impl Iterator<Item = String> {
        let campaign = self.problem.campaign;
        let missing = campaign.plan.iter().filter(|planned| {
            !campaign
                .series
                .iter()
                .any(|name| before_remount(name) == &*planned.name)
        });
        let silent = campaign.gauges.iter().enumerate().filter(|(gauge, _)| {
            !campaign
                .windows
                .iter()
                .any(|window| window.readings_m[*gauge].is_some())
        });
        missing
            .map(|planned| format!("series {} of the plan is not in the table", planned.name))
            .chain(silent.map(|(_, gauge)| format!("gauge {} has no reading", gauge.name)))
    }

    /// Gauges that the model does not describe, with the advice of `[T 6.1]`.
    fn standing_out(&self) -> Option<String> {
        let repeats = self.lack_of_fit.as_ref()?;
        let names = self.names(&repeats.standing_out);
        (!names.is_empty()).then(|| {
            let names = names.join(", ");
            let place = self.another_place(&repeats.standing_out);
            format!(
                "gauge {names}: what it shows at a level deviates by more than repeats do{place}"
            )
        })
    }

    fn names(&self, gauges: &[usize]) -> Vec<&str> {
        gauges
            .iter()
            .map(|gauge| self.problem.campaign.gauges[*gauge].name.as_str())
            .collect()
    }

    /// Reasons not to trust it as it is.
    pub(super) fn doubts(&self, answer: &SpringsAnswer) -> Vec<String> {
        let mut doubts = Vec::new();
        if !self.intervals.is_scaled {
            let too_large = goodness::too_large(answer.fit.chi2, answer.fit.dof).map(|sentence| {
                let largest = self.largest_contributors();
                let gauges: Vec<usize> = largest.iter().map(|(_, gauge)| *gauge).collect();
                format!(
                    "{sentence}, most of it from {}{}",
                    self.listed(&largest),
                    self.another_place(&gauges)
                )
            });
            doubts
                .extend(too_large.or_else(|| goodness::too_small(answer.fit.chi2, answer.fit.dof)));
        }
        // A model that is wrong as a whole is named above.
        if doubts.is_empty() {
            doubts.extend(self.uneven());
            doubts.extend(self.quiet());
            doubts.extend(self.instrument_errors());
        }
        doubts.extend(self.often_shifted());
        doubts.extend(self.mostly_left_out());
        match self.common_factor(answer) {
            Some(common) => doubts.push(common),
            None => doubts.extend(self.far_off()),
        }
        doubts.extend(self.lack_of_fit_doubt(doubts.is_empty()));
        doubts.extend(
            self.not_positive
                .iter()
                .map(|spring| self.not_measured(spring)),
        );
        let RobustFit {
            solution, active, ..
        } = &self.robust_fit;
        let [lost, _] = unobservable(&self.problem, active, solution);
        let names = names(&self.problem, active, self.play.is_some());
        for direction in Unobservable::list(&names, &lost) {
            doubts.push(format!(
                "not observable, kept at the file's value: {direction}"
            ));
        }
        let readings = readings(self.problem.campaign);
        if float(answer.outliers.len()) > MAX_OUTLIERS * float(readings) {
            doubts.push(format!(
                "{} of {readings} readings do not agree with the others",
                answer.outliers.len()
            ));
        }
        doubts
    }

    /// Doubt about the model by repeated readings: chi-squared says nothing of noise that is taken
    /// from the residuals, and too little of noise that is stated too large.
    pub(super) fn lack_of_fit_doubt(&self, is_first: bool) -> Option<String> {
        let is_scaled = self.intervals.is_scaled;
        let Some(repeats) = &self.lack_of_fit else {
            let reduced = self.robust_fit.solution.rows.chi_squared()
                / float(self.robust_fit.solution.degrees());
            return (is_scaled && reduced > MAX_UNPROVEN).then(|| {
                format!(
                    "the readings leave {:.1} times the deviation of {} instruments, and no level was measured twice, which would tell noise from a wrong model: state [noise], or measure strokes up and down",
                    reduced.sqrt(),
                    if self.problem.campaign.is_noise_stated { "the stated" } else { "usual" }
                )
            });
        };
        ((is_scaled || is_first) && repeats.p() < MIN_P).then(|| {
            format!(
                "the model is wrong: it leaves {:.1} times the variance of repeats (lack of fit, p = {:.1e}), most of it from {}",
                repeats.f(),
                repeats.p(),
                self.listed(&self.largest_contributors())
            )
        })
    }

    /// A play that opens at a far smaller force than the robot file expects.
    pub(super) fn unexpected_play<K: MachineKind<N>>(
        &self,
        robot: &RobotFile<K, N>,
    ) -> Option<String> {
        let play = self.play.as_ref()?;
        let machine = ElasticMachine::new(
            *self.problem.geometry,
            self.problem.file.machine,
            Backlash::NONE,
        );
        let expected = Preload::of(robot, &machine)?;
        let found: Vec<[f64; 2]> = play.preload_n.into_iter().flatten().collect();
        let (least_n, most_n) = found
            .iter()
            .flatten()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), end| {
                (least.min(*end), most.max(*end))
            });
        (!found.iter().any(|interval| expected.may_be(*interval))).then(|| {
            format!(
                "a play is found that opens at a preload of {least_n:.0} to {most_n:.0} N, where {:.0} N is expected by the robot file: a force or moment that is cut looks like it; look at the windows of the largest forces",
                expected.force_n()
            )
        })
    }

    /// Advice of `[T 6.1]`, if one of these gauges is on a cart.
    pub(super) fn another_place(&self, gauges: &[usize]) -> &'static str {
        let has_cart = gauges.iter().any(|gauge| {
            let gauge = &self.problem.campaign.gauges[*gauge].gauge;
            matches!(gauge, Gauge::Axis { axis, .. } if *axis < ARMS)
        });
        if has_cart {
            "; another place on the cart may help [T 6.1]"
        } else {
            ""
        }
    }

    fn listed(&self, of_series: &[(usize, usize)]) -> String {
        let campaign = self.problem.campaign;
        let named: Vec<String> = of_series
            .iter()
            .map(|(series, gauge)| {
                let gauge = &campaign.gauges[*gauge].name;
                format!("gauge {gauge} in series {}", campaign.series[*series])
            })
            .collect();
        named.join(", ")
    }

    /// The three series and gauges with the largest residuals.
    fn largest_contributors(&self) -> Vec<(usize, usize)> {
        let campaign = self.problem.campaign;
        let deviations = deviations(
            &self.problem,
            &self.robust_fit.active,
            &self.robust_fit.solution,
        );
        let mut sums = DMatrix::zeros(campaign.series.len(), campaign.gauges.len());
        for (index, window) in campaign.windows.iter().enumerate() {
            for (gauge, deviation) in deviations[index]
                .iter()
                .enumerate()
                .filter(|(_, deviation)| !deviation.is_nan())
            {
                sums[(window.series, gauge)] +=
                    self.robust_fit.active.weights[index][gauge] * deviation.powi(2);
            }
        }
        let mut all: Vec<(f64, usize, usize)> = (0..campaign.series.len())
            .flat_map(|series| (0..campaign.gauges.len()).map(move |gauge| (series, gauge)))
            .map(|(series, gauge)| (sums[(series, gauge)], series, gauge))
            .collect();
        all.sort_by(|(one, ..), (other, ..)| other.total_cmp(one));
        all.into_iter()
            .take(3)
            .map(|(_, series, gauge)| (series, gauge))
            .collect()
    }
}

fn readings<const N: usize>(campaign: &Campaign<N>) -> usize {
    campaign
        .windows
        .iter()
        .flat_map(|window| &window.readings_m)
        .flatten()
        .count()
}

/// Result of a comparison of two regimes in a clause.
fn regimes_summary(regimes: &TwoRegimes) -> String {
    let TwoRegimes {
        f,
        degrees: [unknowns, rest],
        p,
        ..
    } = regimes;
    let test = format!("F({unknowns}, {rest}) {f:.1}, p {p:.1e}");
    if !regimes.differs() {
        return format!("links have the same compliances beyond the jump ({test})");
    }
    let seen = regimes
        .links
        .iter()
        .filter(|link| link.is_seen)
        .map(|link| link.ratio);
    let (least, most) = seen.fold((f64::INFINITY, 0.0_f64), |(least, most), ratio| {
        (least.min(ratio), most.max(ratio))
    });
    format!("beyond the jump links have {least:.2} to {most:.2} of their compliances ({test})")
}
