//! Parts of an answer that every fit has: parameters with their intervals, and directions that are
//! not seen.

use std::collections::BTreeMap;
use std::fmt;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::held_directions::HeldDirections;
use super::least_squares::{Direction, Observability, Rows, WEAK};
use super::statistics::{NORMAL_95, chi_squared_above, float};

/// Smallest component of a direction in an answer: less is rounding.
const MIN_COMPONENT: f64 = 1e-9;
/// Smallest component of a direction in a message.
const NAMED: f64 = 0.01;
/// Share of a parameter's own deviation that what is not seen may add, without the parameter
/// depending on it.
const MIN_DEPENDENCE: f64 = 0.1;

/// Residuals of a fit beside the stated noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FitSummary {
    /// Sum of the squares of the residuals, in standard deviations.
    pub chi2: f64,
    /// Degrees of freedom.
    pub dof: usize,
    /// Probability of such a sum, or a larger one, if the model and the noise are right.
    pub p: f64,
}

impl FitSummary {
    /// Summary of a sum of squares with its degrees of freedom.
    #[must_use]
    pub fn new(chi2: f64, dof: usize) -> Self {
        Self {
            chi2,
            dof,
            p: chi_squared_above(chi2, dof),
        }
    }

    /// Sum of the squares per degree of freedom.
    #[must_use]
    pub fn reduced(&self) -> f64 {
        self.chi2 / float(self.dof)
    }
}

/// One parameter with its interval.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Its name, as in the robot file, with its place: `A_s[0].x`.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Unit of value, deviation and interval.
    pub unit: &'static str,
    /// Standard deviation; 0 of a value that is kept.
    pub sd: f64,
    /// Lower end of the central 95 % interval; none (null) of a value that is kept.
    pub low95: Option<f64>,
    /// Upper end.
    pub high95: Option<f64>,
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
    /// Known as well as the robot file knows what is not seen: its interval includes that.
    Depends,
    /// Not seen: the value of the robot file, to the bit.
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
        let mut parameters = Vec::with_capacity(names.len());
        for (index, (name, unit)) in names.iter().enumerate() {
            let value = values[index];
            let sd = covariance[(index, index)].max(0.0).sqrt();
            let mut parameter = Self {
                name: name.clone(),
                value,
                unit,
                sd,
                low95: None,
                high95: None,
                status: status(index),
            };
            parameter.set_interval([value - NORMAL_95 * sd, value + NORMAL_95 * sd]);
            parameters.push(parameter);
        }
        parameters
    }

    /// Central 95 % interval; none of a value that is kept.
    #[must_use]
    pub fn interval(&self) -> Option<[f64; 2]> {
        Some([self.low95?, self.high95?])
    }

    /// Sets the interval of a value that is not kept.
    pub fn set_interval(&mut self, [low, high]: [f64; 2]) {
        if self.status != Status::Kept {
            (self.low95, self.high95) = (Some(low), Some(high));
        }
    }
}

/// Uncertainty of the parameters of a fit: that of what is seen, and that of what is not, which
/// others follow.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertainty {
    held: HeldDirections,
    scales: DVector<f64>,
    /// Covariance with what is held as it is.
    own: DMatrix<f64>,
    /// Changes by one standard deviation of what is held, a column per direction.
    following: DMatrix<f64>,
}

impl Uncertainty {
    /// Uncertainty where what is held has a standard deviation of one scale.
    #[must_use]
    pub fn new(rows: &Rows, seen: &Observability, held: &HeldDirections) -> Self {
        let following = DMatrix::from_diagonal(seen.scales()) * held.following(rows, seen);
        Self {
            held: held.clone(),
            scales: seen.scales().clone(),
            own: seen.covariance(),
            following,
        }
    }

    /// The same with another factor of the covariance of what is held, in scales: a row per
    /// direction.
    #[must_use]
    pub fn with_prior(self, factor: &DMatrix<f64>) -> Self {
        Self {
            following: self.following * factor,
            ..self
        }
    }

    /// The same with noise of another variance, in stated ones.
    #[must_use]
    pub fn scaled(self, variance: f64) -> Self {
        Self {
            own: self.own * variance,
            ..self
        }
    }

    /// Variance of a parameter by what is not seen.
    #[must_use]
    pub fn of_unseen(&self, parameter: usize) -> f64 {
        if self.held.is_kept(parameter) {
            0.0
        } else {
            self.following.row(parameter).norm_squared()
        }
    }

    /// Variance of a parameter by what is seen.
    #[must_use]
    pub fn of_seen(&self, parameter: usize) -> f64 {
        self.own[(parameter, parameter)].max(0.0)
    }

    /// Covariance of the parameters, that of what is not seen included.
    #[must_use]
    pub fn whole_covariance(&self) -> DMatrix<f64> {
        &self.own + &self.following * self.following.transpose()
    }

    /// Covariance of the parameters; none of those that are kept.
    #[must_use]
    pub fn covariance(&self) -> DMatrix<f64> {
        let mut covariance = self.whole_covariance();
        for kept in self.held.kept() {
            covariance.row_mut(*kept).fill(0.0);
            covariance.column_mut(*kept).fill(0.0);
        }
        covariance
    }

    /// Status of a parameter.
    #[must_use]
    pub fn status(&self, parameter: usize) -> Status {
        if self.held.is_kept(parameter) {
            return Status::Kept;
        }
        let [seen, unseen] = [self.of_seen(parameter), self.of_unseen(parameter)].map(f64::sqrt);
        Status::of(seen, unseen, self.scales[parameter])
    }
}

impl Unobservable {
    /// Names the components of directions.
    #[must_use]
    pub fn list(names: &[(String, &'static str)], directions: &[Direction]) -> Vec<Self> {
        directions
            .iter()
            .map(|direction| Self::named(names, direction))
            .collect()
    }

    fn named(names: &[(String, &'static str)], direction: &Direction) -> Self {
        // Either sign is the same direction: the largest component is positive.
        let sign = direction.components[direction.components.iamax()].signum();
        let components = names
            .iter()
            .zip(&direction.components)
            .map(|((name, _), share)| (name.clone(), sign * share));
        Self {
            relative_sd: direction.relative_sd,
            direction: components
                .filter(|(_, share)| share.abs() > MIN_COMPONENT)
                .collect(),
        }
    }
}

impl fmt::Display for Unobservable {
    /// The components, the largest first: `c_cart[0] +1.000, c_link[0] -0.020`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shares: Vec<_> = self
            .direction
            .iter()
            .filter(|(_, share)| share.abs() > NAMED)
            .collect();
        shares.sort_by(|(_, one), (_, other)| other.abs().total_cmp(&one.abs()));
        let shares: Vec<String> = shares
            .into_iter()
            .map(|(name, share)| format!("{name} {share:+.3}"))
            .collect();
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
            Self::Depends => "depends",
            Self::Kept => "kept",
        }
    }

    /// Status of a value that is not kept, with these standard deviations by what is seen and by
    /// what is not, where `scale` would matter.
    #[must_use]
    pub fn of(seen: f64, unseen: f64, scale: f64) -> Self {
        if unseen > MIN_DEPENDENCE * seen {
            Self::Depends
        } else if seen > WEAK * scale {
            Self::Weak
        } else {
            Self::Identified
        }
    }
}
