//! One factor on all compliances: a unit of the load that is not the newton, which the readings
//! themselves cannot tell.

use super::IdentifiedSprings;
use super::answer::SpringsAnswer;
use crate::fit::answer::{Parameter, Status};

/// Factor between a compliance and the robot file's that needs no explanation, and standard
/// deviation of the logarithm of such factors.
const USUAL_FACTOR: f64 = 2.5;
const SCATTER: f64 = 0.3;
/// Standard deviations by which the common factor must be beyond it.
const SURE_SD: f64 = 2.0;
/// Units of a force, N. A factor of thousands is refused before a fit.
const UNITS: [(&str, f64); 4] = [
    ("kgf", 9.806_65),
    ("daN", 10.0),
    ("lbf", 4.448_22),
    ("ozf", 0.278_014),
];
/// Ratio of a factor to that of a unit which it may be.
const NEAR: f64 = 1.5;

/// Logarithm of the ratio of a compliance to the robot file's, and its weight in their mean.
struct LogRatio {
    value: f64,
    weight: f64,
}

impl LogRatio {
    fn of(parameter: &Parameter, file: f64) -> Self {
        let sd = parameter.sd / parameter.value;
        Self {
            value: (parameter.value / file).ln(),
            weight: 1.0 / (sd.powi(2) + SCATTER.powi(2)),
        }
    }
}

impl<const N: usize> IdentifiedSprings<'_, N> {
    /// Says that all springs differ from the robot file's by one factor.
    pub(super) fn common_factor(&self, answer: &SpringsAnswer) -> Option<String> {
        let springs = answer.parameters.iter().zip(&self.problem.relative_to);
        let ratios: Vec<LogRatio> = springs
            .filter(|(parameter, _)| matches!(parameter.status, Status::Identified | Status::Weak))
            .map(|(parameter, file)| LogRatio::of(parameter, *file))
            .collect();
        let weights: f64 = ratios.iter().map(|ratio| ratio.weight).sum();
        let mean = ratios
            .iter()
            .map(|ratio| ratio.weight * ratio.value)
            .sum::<f64>()
            / weights;
        let is_one_side = ratios.iter().all(|ratio| ratio.value * mean > 0.0);
        let is_beyond = mean.abs() - SURE_SD / weights.sqrt() > USUAL_FACTOR.ln();
        (is_one_side && is_beyond).then(|| {
            let factor = mean.exp();
            let near = UNITS.iter().filter(|(_, unit)| (factor / unit).ln().abs() < NEAR.ln());
            let near = near.map(|(name, unit)| format!("{name} is {unit:.2} N")).collect::<Vec<_>>().join(", ");
            let near = if near.is_empty() { near } else { format!(" ({near})") };
            format!(
                "all compliances seen are about {factor:.2} times the robot file's: check the unit of forces and moments{near}; if the file's are wrong by so much, begin from better ones"
            )
        })
    }
}
