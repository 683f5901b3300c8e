//! Departures from the model of an F1 that a robot file has no place for: an axis of plate 3 of its
//! own, a distance between its two axes, gain and periodic error of each screw. Each is fitted
//! along with the parameters and judged by an F-test; none is ever written.

use std::f64::consts::TAU;
use std::fmt;

use gantry_tau_core::model::f1::{self, AXES};
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::robot::{ARM_OF_LINK, LINKS};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix6, Vector2, Vector3, Vector6};

use super::derivative::{Turns, forward, lines};
use super::{Calibrated, Poses};
use crate::fit::frames::across;
use crate::fit::least_squares::eliminated;
use crate::fit::statistics::{f_above, float};
use crate::geometry::robust_fit::Model;

/// Arms that have a plate, by the axes that turn it: `q_4`, `q_5`, `q_6`.
const ARM_OF_SCREW: [usize; 3] = [1, 2, 2];
/// Periods over the measured range of a screw that are tried, in halves: from one to as many as a
/// screw of 5 mm lead has.
const HALF_PERIODS: std::ops::RangeInclusive<u8> = 2..=30;
/// Poses that a period needs: fewer than four show nothing of its shape.
const POSES_PER_PERIOD: usize = 4;
/// Smallest share of a departure that the parameters do not explain already.
const MIN_OWN: f64 = 1e-6;
/// Probability at which a departure is named, of all that are judged together.
const NAMED_P: f64 = 0.01;

/// A departure from the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Departure {
    /// Angle between the axis that plate 3 is turned by and that of plate 2, rad.
    OwnAxis,
    /// Distance between the two axes of plate 3, along `ax x ax6`, m.
    AxisOffset,
    /// Relative error of how far a screw turns its plate; the axis, 4 to 6.
    Gain(usize),
    /// Periodic error of a screw, rad.
    Periodic {
        /// The axis, 4 to 6.
        axis: usize,
        /// Length of the most significant period, rad.
        period_rad: f64,
    },
}

impl fmt::Display for Departure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OwnAxis => f.write_str("angle between the axes of plates 2 and 3"),
            Self::AxisOffset => f.write_str("distance between the two axes of plate 3"),
            Self::Gain(axis) => write!(f, "gain of screw {axis}"),
            Self::Periodic { axis, period_rad } => {
                write!(
                    f,
                    "error of screw {axis} with a period of {period_rad:.3} rad"
                )
            }
        }
    }
}

/// A departure, and how much of it the poses show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Diagnostic {
    /// Kind of departure.
    pub departure: Departure,
    /// Its size, m, rad, or relative; of two components their length.
    pub size: f64,
    /// Standard deviation of a component.
    pub sd: f64,
    /// Probability of such a size, or a larger one, in a machine without the departure (F-test).
    pub p: f64,
}

impl Diagnostic {
    /// True where so many departures are judged, and this one is there.
    #[must_use]
    pub fn is_found(&self, judged: usize) -> bool {
        self.p * float(judged) < NAMED_P
    }

    /// Size and standard deviation in units that can be read.
    #[must_use]
    pub fn magnitude(&self) -> String {
        let (unit, factor) = match self.departure {
            Departure::OwnAxis | Departure::Periodic { .. } => ("urad", 1e6),
            Departure::AxisOffset => ("um", 1e6),
            Departure::Gain(_) => ("per mille", 1e3),
        };
        format!(
            "{:.2} +- {:.2} {unit}",
            self.size * factor,
            self.sd * factor
        )
    }
}

/// Residuals, and columns of departures, without what the parameters explain; by rows of whitened
/// poses.
struct Left {
    residuals: DVector<f64>,
    departures: DMatrix<f64>,
    /// Lengths of the columns before.
    lengths: Vec<f64>,
    degrees: usize,
}

impl Poses<'_> {
    /// Judges the departures from the model at a calibrated machine; empty where its poses cannot
    /// be predicted. A departure that the parameters can stand for is left out.
    #[must_use]
    pub fn diagnostics(&self, calibrated: &Calibrated) -> Vec<Diagnostic> {
        let used = calibrated.used(self.count());
        let screws = [0, 1, 2].map(|screw| {
            Screw::of(
                screw,
                used.iter().map(|index| self.poses[*index].q[3 + screw]),
            )
        });
        let Some(left) = self.left(&calibrated.fit.state, &used, &screws) else {
            return Vec::new();
        };
        let mut found = vec![
            left.judge(Departure::OwnAxis, 0..2),
            left.judge(Departure::AxisOffset, 2..3),
        ];
        let mut first = 3;
        for screw in &screws {
            found.push(left.judge(Departure::Gain(screw.axis()), first..first + 1));
            first += 1;
            let mut periodic = Vec::new();
            for &period_rad in &screw.periods_rad {
                let departure = Departure::Periodic {
                    axis: screw.axis(),
                    period_rad,
                };
                periodic.extend(left.judge(departure, first..first + 2));
                first += 2;
            }
            // The most significant of several tries is not as rare as one alone.
            let tries = float(periodic.len());
            let best = periodic
                .into_iter()
                .min_by(|one, other| one.p.total_cmp(&other.p));
            found.push(best.map(|best| Diagnostic {
                p: (best.p * tries).min(1.0),
                ..best
            }));
        }
        found.into_iter().flatten().collect()
    }

    fn left(&self, geometry: &f1::Geometry, used: &[usize], screws: &[Screw; 3]) -> Option<Left> {
        let kinematics = Self::kinematics(geometry).ok()?;
        let rows = self.rows(geometry, used).ok()?;
        let width = 3 + screws
            .iter()
            .map(|screw| 1 + 2 * screw.periods_rad.len())
            .sum::<usize>();
        // The rows that hold what no pose shows are not readings.
        let readings = 6 * used.len();
        let mut whole = DMatrix::zeros(readings, width + 1);
        whole.set_column(width, &rows.residuals.rows(0, readings));
        for (place, index) in used.iter().enumerate() {
            let measured = &self.poses[*index];
            let pose = forward(&kinematics, &measured.q, &measured.pose()?).ok()?;
            let columns = self.whitening * columns(geometry, &measured.q, &pose, screws)?;
            whole
                .view_mut((6 * place, 0), (6, width))
                .copy_from(&columns);
        }
        let lengths = whole.column_iter().map(|column| column.norm()).collect();
        let known = rows.derivatives.rows(0, readings).into_owned();
        let left = eliminated(known, whole);
        let degrees = left.nrows();
        Some(Left {
            residuals: left.column(width).into_owned(),
            departures: left.columns(0, width).into_owned(),
            lengths,
            degrees,
        })
    }
}

impl Left {
    /// Judges one or two columns; `None` where the parameters stand for them.
    fn judge(&self, departure: Departure, columns: std::ops::Range<usize>) -> Option<Diagnostic> {
        let count = columns.len();
        let whole = columns
            .clone()
            .map(|column| self.lengths[column])
            .fold(f64::MAX, f64::min);
        // One column is two, of which the second explains nothing.
        let mut squares = Matrix2::identity();
        let mut products = Vector2::zeros();
        for (row, one) in columns.clone().enumerate() {
            products[row] = self.departures.column(one).dot(&self.residuals);
            for (column, other) in columns.clone().enumerate() {
                squares[(row, column)] = self
                    .departures
                    .column(one)
                    .dot(&self.departures.column(other));
            }
        }
        let least = squares.symmetric_eigenvalues().min();
        let is_own = count == 1 && squares[(0, 0)] > (MIN_OWN * whole).powi(2)
            || count == 2 && least > (MIN_OWN * whole).powi(2);
        if !is_own || self.degrees <= count {
            return None;
        }
        let inverse = squares.try_inverse()?;
        let size = inverse * products;
        let explained = products.dot(&size);
        let degrees = self.degrees - count;
        let left = (self.residuals.norm_squared() - explained).max(f64::MIN_POSITIVE);
        let ratio = (explained / float(count)) / (left / float(degrees));
        let variance = (0..count).map(|row| inverse[(row, row)]).sum::<f64>() / float(count);
        let size = if count == 1 { size.x } else { size.norm() };
        Some(Diagnostic {
            departure,
            size,
            sd: variance.sqrt(),
            p: f_above(ratio, count, degrees),
        })
    }
}

/// Measured range of a screw, and the periods that are tried in it.
struct Screw {
    number: usize,
    from_rad: f64,
    periods_rad: Vec<f64>,
}

impl Screw {
    fn of(number: usize, positions: impl Iterator<Item = f64> + Clone) -> Self {
        let poses = positions.clone().count();
        let (from_rad, to_rad) = positions.fold((f64::MAX, f64::MIN), |(least, most), q| {
            (least.min(q), most.max(q))
        });
        let most = float(poses / POSES_PER_PERIOD);
        let periods = HALF_PERIODS
            .map(|halves| f64::from(halves) / 2.0)
            .filter(|periods| *periods <= most);
        let range_rad = to_rad - from_rad;
        let periods_rad = if range_rad > 0.0 {
            periods.map(|periods| range_rad / periods).collect()
        } else {
            Vec::new()
        };
        Self {
            number,
            from_rad,
            periods_rad,
        }
    }

    /// Number of its axis, counted from 1.
    const fn axis(&self) -> usize {
        self.number + 4
    }
}

/// Columns of a pose: two of an own axis, one of an offset; per screw the gain, and sine and cosine
/// of each period. `None` in a singular pose.
fn columns(
    geometry: &f1::Geometry,
    q: &[f64; AXES],
    pose: &Pose,
    screws: &[Screw; 3],
) -> Option<DMatrix<f64>> {
    let stance = Stance::of(geometry, q, pose)?;
    let turn_axis = geometry.turn_axis.normalize();
    let tilt_axis = geometry.tilt_axis.normalize();
    let mut columns = Vec::new();
    for d in across(&turn_axis) {
        columns.push(stance.moved(2, |plate_joint, Turns { turn, tilt }| {
            let tilted = tilt * plate_joint;
            d.cross(&(turn * tilted)) - turn * d.cross(&tilted)
        }));
    }
    let between = turn_axis.cross(&tilt_axis).normalize();
    columns.push(stance.moved(2, |_, Turns { turn, .. }| turn * between));
    for screw in screws {
        let arm = ARM_OF_SCREW[screw.number];
        let rate = stance.moved(arm, |plate_joint, Turns { turn, tilt }| {
            let tilted = tilt * plate_joint;
            match screw.number {
                2 => turn * tilt_axis.cross(&tilted),
                plate => geometry.turn_signs[plate].sign() * turn_axis.cross(&(turn * tilted)),
            }
        });
        let position = q[3 + screw.number];
        columns.push(rate * position);
        for period in &screw.periods_rad {
            let (sine, cosine) = (TAU * (position - screw.from_rad) / period).sin_cos();
            columns.extend([rate * sine, rate * cosine]);
        }
    }
    Some(DMatrix::from_fn(6, columns.len(), |row, column| {
        columns[column][row]
    }))
}

/// Machine in a pose that is not singular.
struct Stance<'a> {
    geometry: &'a f1::Geometry,
    q: &'a [f64; AXES],
    lines: Matrix6<f64>,
    inverse: Matrix6<f64>,
}

impl<'a> Stance<'a> {
    fn of(geometry: &'a f1::Geometry, q: &'a [f64; AXES], pose: &Pose) -> Option<Self> {
        let lines = lines(geometry, q, pose);
        Some(Self {
            geometry,
            q,
            lines,
            inverse: lines.try_inverse()?,
        })
    }

    /// Change of the pose where the joints on the plate of an arm move by `shift` of each.
    fn moved(
        &self,
        arm: usize,
        shift: impl Fn(Vector3<f64>, &Turns) -> Vector3<f64>,
    ) -> Vector6<f64> {
        let turns = Turns::of(self.geometry, self.q, arm);
        let shifts: [Vector3<f64>; LINKS] = std::array::from_fn(|link| {
            if ARM_OF_LINK[link] == arm {
                shift(self.geometry.plate_joints_m[link], &turns)
            } else {
                Vector3::zeros()
            }
        });
        let along = Vector6::from_fn(|link, _| {
            self.lines
                .fixed_view::<1, 3>(link, 0)
                .transpose()
                .dot(&shifts[link])
        });
        self.inverse * along
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_screw_has_periods_that_four_poses_each_can_show() {
        // Twenty poses over 1.9 rad: one period of the range, 1.5, ... 5.
        let screw = Screw::of(1, (0..20_u8).map(|pose| 0.1 * f64::from(pose) - 0.5));
        assert_eq!(
            (screw.number, screw.axis(), screw.periods_rad.len()),
            (1, 5, 9)
        );
        for (found, expected) in [
            (screw.from_rad, -0.5),
            (screw.periods_rad[0], 1.9),
            (screw.periods_rad[1], 1.9 / 1.5),
            (screw.periods_rad[8], 1.9 / 5.0),
        ] {
            assert!((found - expected).abs() < 1e-12, "{found}, not {expected}");
        }
        assert_eq!(
            Screw::of(0, [0.3; 20].into_iter()).periods_rad,
            [0.0; 0],
            "it has not moved"
        );
    }
}
