//! Expected standard deviations of a plan before anything is measured: the Cramer-Rao bound.

use std::fmt::{self, Write};

use nalgebra::{DMatrix, DVector};

use crate::fit::least_squares::{Direction, LOST, Observability, Rows, WEAK};
use crate::fit::statistics::float;

/// Share of a direction's largest component below which a component is not named.
const NAMED: f64 = 0.02;
/// Largest number of components that are named.
const MAX_NAMED: usize = 6;
/// Share of a parameter that measurements can determine, below which it is fixed.
const FIXED: f64 = 1e-9;
/// Share of a parameter that may lie in lost directions.
const MAX_LOST: f64 = 0.5;

/// Parameters of a plan.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Parameters {
    /// Their names.
    pub(super) names: Vec<String>,
    /// Units that their standard deviations are shown in, and the size of one scale in them.
    pub(super) shown: Vec<(f64, &'static str)>,
    /// Orthonormal columns: the combinations, in scales, that measurements can determine; the
    /// others are fixed by convention.
    pub(super) basis: DMatrix<f64>,
    /// Unit of the observability indices.
    pub(super) index_unit: &'static str,
}

/// Expected knowledge of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// To a tenth of its scale, or better.
    Seen,
    /// To one digit at most.
    Weak,
    /// Not: most of it lies in lost directions.
    Lost,
    /// Not, from no measurement: it is the file's by convention.
    Fixed,
}

/// A parameter, and its standard deviation.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpectedParameter {
    /// Its name.
    pub name: String,
    /// Standard deviation along the directions that are seen, in `unit`.
    pub sd: f64,
    /// `%` of the file's value, `um`, or `urad`.
    pub unit: &'static str,
    /// Its class.
    pub status: Status,
}

/// A combination of parameters that is badly seen, or not at all.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedDirection {
    /// Standard deviation, in scales.
    pub relative_sd: f64,
    /// Components by name, the largest first and 1; those below a fiftieth are left out.
    pub components: Vec<(String, f64)>,
}

/// Expected result of a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Expected {
    /// The parameters.
    pub parameters: Vec<ExpectedParameter>,
    /// Number of directions that will be seen, and of all that could.
    pub seen: (usize, usize),
    /// Directions that cannot be seen.
    pub lost: Vec<NamedDirection>,
    /// Directions that are badly seen.
    pub weak: Vec<NamedDirection>,
    /// Observability indices O1 to O5.
    pub indices: [f64; 5],
    /// Their unit; O2 has none.
    pub index_unit: &'static str,
    /// Number of readings.
    pub readings: usize,
    /// Root mean square of the predicted error of what is asked for, m, lost directions not
    /// counted.
    pub rms_m: f64,
    /// Covariance of the parameters, scaled, in the coordinates of their basis.
    covariance: DMatrix<f64>,
}

impl Expected {
    /// Of `rows`, whitened, in the coordinates of the parameters' basis; `goal` as of a search.
    pub(super) fn new(
        parameters: &Parameters,
        rows: DMatrix<f64>,
        readings: usize,
        goal: &DMatrix<f64>,
    ) -> Self {
        let size = parameters.basis.ncols();
        // The decomposition wants as many rows as columns.
        let rows = if rows.nrows() < size {
            rows.resize_vertically(size, 0.0)
        } else {
            rows
        };
        let seen = Observability::new(
            &Rows::new(DVector::zeros(rows.nrows()), rows),
            &DVector::repeat(size, 1.0),
        );
        let covariance = seen.covariance();
        let lost = seen.lost();
        let weak = seen.weak();
        let spread = &parameters.basis * &covariance * parameters.basis.transpose();
        Self {
            parameters: (0..parameters.names.len())
                .map(|index| parameters.expected_parameter(index, &lost, &spread))
                .collect(),
            seen: (seen.kept(), size),
            lost: lost
                .iter()
                .map(|direction| parameters.named(direction))
                .collect(),
            weak: weak
                .iter()
                .map(|direction| parameters.named(direction))
                .collect(),
            indices: indices(seen.singular_values(), readings),
            index_unit: parameters.index_unit,
            readings,
            rms_m: rms_m(&covariance, goal),
            covariance,
        }
    }

    /// Root mean square of the predicted error of something else, m, lost directions not counted.
    pub(super) fn rms_m_of(&self, goal: &DMatrix<f64>) -> f64 {
        rms_m(&self.covariance, goal)
    }

    /// True if every direction is seen.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.lost.is_empty()
    }
}

impl Parameters {
    /// A parameter with the standard deviation that follows from the covariance of all, `spread`.
    fn expected_parameter(
        &self,
        index: usize,
        lost: &[Direction],
        spread: &DMatrix<f64>,
    ) -> ExpectedParameter {
        let axis = self.basis.row(index).transpose();
        // What is fixed by convention has no share in it.
        let share: f64 = lost
            .iter()
            .map(|direction| axis.dot(&direction.components).powi(2))
            .sum();
        let deviation = spread[(index, index)].max(0.0).sqrt();
        let (scale, unit) = self.shown[index];
        let status = match deviation {
            _ if axis.norm_squared() < FIXED => Status::Fixed,
            _ if share > MAX_LOST * axis.norm_squared() => Status::Lost,
            deviation if deviation > WEAK => Status::Weak,
            _ => Status::Seen,
        };
        ExpectedParameter {
            name: self.names[index].clone(),
            sd: deviation * scale,
            unit,
            status,
        }
    }

    fn named(&self, direction: &Direction) -> NamedDirection {
        let components = &self.basis * &direction.components;
        let largest = components[components.icamax()];
        let mut named: Vec<(String, f64)> = self
            .names
            .iter()
            .cloned()
            .zip(components.iter().map(|component| component / largest))
            .collect();
        named.retain(|(_, component)| component.abs() >= NAMED);
        named.sort_by(|one, other| other.1.abs().total_cmp(&one.1.abs()));
        named.truncate(MAX_NAMED);
        NamedDirection {
            relative_sd: direction.relative_sd,
            components: named,
        }
    }
}

fn rms_m(covariance: &DMatrix<f64>, goal: &DMatrix<f64>) -> f64 {
    (covariance * goal).trace().max(0.0).sqrt()
}

/// O1 (Borm, Menq), O2 (Driels, Pathre), O3 (Nahvi, Hollerbach, Hayward), O4 (Nahvi, Hollerbach),
/// O5 (Sun, Hollerbach).
fn indices(values: &DVector<f64>, readings: usize) -> [f64; 5] {
    let largest = values.max();
    let least = values.min();
    let mean = values.iter().map(|value| value.ln()).sum::<f64>() / float(values.len());
    let inverse: f64 = values.iter().map(|value| 1.0 / value).sum();
    [
        mean.exp() / float(readings).sqrt(),
        least / largest,
        least,
        least * least / largest,
        1.0 / inverse,
    ]
}

impl fmt::Display for NamedDirection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = String::new();
        for (name, component) in &self.components {
            let comma = if text.is_empty() { "" } else { ", " };
            write!(text, "{comma}{name} {component:+.3}")?;
        }
        f.write_str(&text)
    }
}

impl fmt::Display for Expected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<14} {:>12}", "parameter", "expected sd")?;
        for ExpectedParameter {
            name,
            sd,
            unit,
            status,
        } in &self.parameters
        {
            let status = match status {
                Status::Seen => "",
                Status::Weak => "  weak",
                Status::Lost => "  not seen: the file's value stays",
                Status::Fixed => "  fixed: the file's value, by convention",
            };
            writeln!(f, "{name:<14} {sd:>9.3} {unit}{status}")?;
        }
        let (seen, all) = self.seen;
        writeln!(
            f,
            "\n{seen} of {all} directions are seen, by {} readings",
            self.readings
        )?;
        for (kind, directions) in [("not seen", &self.lost), ("weak", &self.weak)] {
            for direction in directions {
                match direction.relative_sd {
                    sd if sd < 1e3 => {
                        writeln!(f, "{kind}: {direction}   (sd {sd:.2} {})", self.index_unit)?
                    }
                    _ => writeln!(f, "{kind}: {direction}")?,
                }
            }
        }
        let [o1, o2, o3, o4, o5] = self.indices;
        write!(
            f,
            "observability    O1 {o1:.3}, O2 {o2:.3e} (no unit), O3 {o3:.3}, O4 {o4:.3}, O5 {o5:.3}; 1/({})",
            self.index_unit
        )
    }
}

const _: () = assert!(
    WEAK < LOST,
    "a weak direction is better known than a lost one"
);
