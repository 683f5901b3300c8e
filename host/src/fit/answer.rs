//! Parts of an answer that every fit has: parameters with their intervals, and directions that are not seen.

use std::collections::BTreeMap;
use std::fmt;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::least_squares::{Direction, Seen};
use super::statistics::NORMAL_95;

/// Smallest component of a direction in an answer: less is rounding.
const LEAST: f64 = 1e-9;
/// Smallest component of a direction that is told people.
const NAMED: f64 = 0.01;

/// One parameter with its interval.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Its name, as in the robot file, with its place: `A_s[0].x`.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Unit of value, deviation and interval.
    pub unit: &'static str,
    /// Standard deviation.
    pub sd: f64,
    /// Lower end of the central 95 % interval.
    pub low95: f64,
    /// Upper end.
    pub high95: f64,
    /// Status of it by the measurements.
    pub status: Status,
}

/// Status of a parameter by the measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Known.
    Identified,
    /// Known to one digit at most.
    Weak,
    /// Not seen: the value of the robot file.
    Kept,
}

/// A combination of parameters that the measurements do not see, or hardly.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unobservable {
    /// Its standard deviation, in changes that would matter.
    pub relative_sd: f64,
    /// Components of the unit vector, by the names of the parameters; those above 1e-9.
    pub direction: BTreeMap<String, f64>,
}

impl Parameter {
    /// Parameters of a fit, in its order.
    #[must_use]
    pub fn list(
        names: &[(String, &'static str)],
        values: &DVector<f64>,
        covariance: &DMatrix<f64>,
        status: impl Fn(usize) -> Status,
    ) -> Vec<Self> {
        let parameter = |(index, (name, unit)): (usize, &(String, &'static str))| {
            let (value, sd) = (values[index], covariance[(index, index)].max(0.0).sqrt());
            let mut parameter =
                Self { name: name.clone(), value, unit, sd, low95: value, high95: value, status: status(index) };
            parameter.set_reach(NORMAL_95);
            parameter
        };
        names.iter().enumerate().map(parameter).collect()
    }

    /// Sets the interval to so many standard deviations on either side.
    pub fn set_reach(&mut self, deviations: f64) {
        (self.low95, self.high95) = (self.value - deviations * self.sd, self.value + deviations * self.sd);
    }
}

impl Unobservable {
    /// Names the components of directions.
    #[must_use]
    pub fn list(names: &[(String, &'static str)], directions: &[Direction]) -> Vec<Self> {
        let named = |direction: &Direction| {
            // Either sign is the same direction: the largest component is positive.
            let sign = direction.components[direction.components.iamax()].signum();
            let all = names.iter().zip(&direction.components).map(|((name, _), share)| (name.clone(), sign * share));
            let direction_named = all.filter(|(_, share)| share.abs() > LEAST).collect();
            Self { relative_sd: direction.relative_sd, direction: direction_named }
        };
        directions.iter().map(named).collect()
    }
}

impl fmt::Display for Unobservable {
    /// The components, the largest first: `c_cart[0] +1.000, c_link[0] -0.020`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shares: Vec<_> = self.direction.iter().filter(|(_, share)| share.abs() > NAMED).collect();
        shares.sort_by(|(_, one), (_, other)| other.abs().total_cmp(&one.abs()));
        let shares: Vec<String> = shares.into_iter().map(|(name, share)| format!("{name} {share:+.3}")).collect();
        f.write_str(&shares.join(", "))
    }
}

impl Status {
    /// Its name, as in an answer.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Identified => "identified",
            Self::Weak => "weak",
            Self::Kept => "kept",
        }
    }

    /// Of one parameter of a fit: kept, where more than half of its axis lies in lost directions, weak, where it does in weak ones.
    #[must_use]
    pub fn of(seen: &Seen, parameter: usize) -> Self {
        let share = |directions: &[Direction]| -> f64 {
            directions.iter().map(|direction| direction.components[parameter].powi(2)).sum()
        };
        if share(&seen.lost()) > 0.5 {
            Self::Kept
        } else if share(&seen.weak()) > 0.5 {
            Self::Weak
        } else {
            Self::Identified
        }
    }
}
