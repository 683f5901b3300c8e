//! Reach, condition and compliance of a machine at each place of a grid.

use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::robot::ARM_OF_LINK;
use gantry_tau_core::model::statics::LineMatrix;
use nalgebra::{Matrix6, Vector3};

use crate::elastic::joints::joint;
use crate::model::MachineKind;
use crate::robot_file::RobotFile;

/// Places in a box, a cube of side `pitch_m` around each; one of them is home.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Home of the tool centre point, world axes, m.
    pub home_m: Vector3<f64>,
    /// Distance of neighbours, m.
    pub pitch_m: f64,
    /// Steps from home to the lower end, in x, y, z.
    pub below: [u32; 3],
    /// Steps from home to the upper end.
    pub above: [u32; 3],
}

/// The machine at one place, platform unturned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridPlace<const N: usize> {
    /// The tool centre point, world axes, m.
    pub tool_m: Vector3<f64>,
    /// Values of the machine there, or the reason why it does not reach.
    pub reached: Result<Reached<N>, KinematicsError>,
}

/// The machine at a place it reaches within its nominal travel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reached<const N: usize> {
    /// Positions of the axes, q-units.
    pub q: [f64; N],
    /// Condition number, as of [`condition`].
    pub condition: f64,
    /// Largest displacement of the tool centre point per force on it, over all directions of the
    /// force, m/N; absent where the robot file has no compliances.
    pub compliance_m_per_n: Option<f64>,
}

impl Grid {
    /// Creates a grid over the box of all places to which all links reach with their carts inside
    /// the nominal travel (plates at 0). Its longest side has `cells` steps.
    #[must_use]
    pub fn of<K: MachineKind<N>, const N: usize>(file: &RobotFile<K, N>, cells: u32) -> Self {
        let (lower, upper) = bounds_m(file);
        let pitch_m = (upper - lower).max() / f64::from(cells);
        Self::between(file.home_m(), lower, upper, pitch_m, cells)
    }

    /// Creates the same grid with this distance of neighbours, of at most 1000 steps to a side.
    #[must_use]
    pub fn with_pitch<K: MachineKind<N>, const N: usize>(
        file: &RobotFile<K, N>,
        pitch_m: f64,
    ) -> Self {
        let (lower, upper) = bounds_m(file);
        Self::between(file.home_m(), lower, upper, pitch_m, 1_000)
    }

    fn between(
        home_m: Vector3<f64>,
        lower: Vector3<f64>,
        upper: Vector3<f64>,
        pitch_m: f64,
        most: u32,
    ) -> Self {
        // The conversion rounds down and takes NaN as 0.
        let [below, above] = [home_m - lower, upper - home_m]
            .map(|ways_m| ways_m.map(|way_m| ((way_m / pitch_m) as u32).min(most)));
        Self {
            home_m,
            pitch_m,
            below: below.into(),
            above: above.into(),
        }
    }

    /// Returns the number of places.
    #[must_use]
    pub fn count(&self) -> u64 {
        let sides = self.below.iter().zip(&self.above);
        sides
            .map(|(below, above)| u64::from(below + above + 1))
            .product()
    }

    /// Returns the offsets from home in steps along one axis of the world, upwards.
    pub(super) fn steps(&self, axis: usize) -> impl Iterator<Item = i32> + use<> {
        let [below, above] = [self.below, self.above].map(|ends| {
            let steps = ends.get(axis).copied().unwrap_or(0);
            i32::try_from(steps).unwrap_or(i32::MAX)
        });
        -below..=above
    }

    /// Returns the place so many steps from home.
    pub(crate) fn at(&self, steps: [i32; 3]) -> Vector3<f64> {
        self.home_m + Vector3::from(steps.map(f64::from)) * self.pitch_m
    }

    /// Returns all places, x slowest, z fastest.
    pub(crate) fn places(&self) -> impl Iterator<Item = [i32; 3]> + use<> {
        let this = *self;
        this.steps(0).flat_map(move |x| {
            this.steps(1)
                .flat_map(move |y| this.steps(2).map(move |z| [x, y, z]))
        })
    }
}

/// Returns lower and upper corner of the box of all places to which all links reach with their
/// carts inside the nominal travel (plates at 0), world axes, m.
fn bounds_m<K: MachineKind<N>, const N: usize>(
    file: &RobotFile<K, N>,
) -> (Vector3<f64>, Vector3<f64>) {
    let geometry = file.model.geometry();
    let home_m = file.home_m();
    let (mut lower, mut upper) = (home_m.map(|_| f64::MIN), home_m.map(|_| f64::MAX));
    let links = ARM_OF_LINK
        .into_iter()
        .zip(geometry.lengths_m)
        .zip(geometry.platform_joints_m);
    for (link, ((arm, length), on_platform)) in links.enumerate() {
        let travel = geometry.travel.and_then(|all| all.get(arm).copied());
        let (from, to) = travel.unwrap_or((0.0, 0.0));
        let ends = [from, to].map(|position| {
            let mut q = [0.0; N];
            if let Some(cart) = q.get_mut(arm) {
                *cart = position;
            }
            joint(&geometry, link, &q).place_m - on_platform
        });
        let [one, other] = ends;
        lower = lower.sup(&one.inf(&other).add_scalar(-length));
        upper = upper.inf(&one.sup(&other).add_scalar(length));
    }
    (lower, upper)
}

/// Evaluates the machine of a file at one place after another.
pub struct Surveyor<'a, K, const N: usize> {
    file: &'a RobotFile<K, N>,
    /// Length that a radian counts as, m: root mean square of the distances of the platform's
    /// joints from the tool centre point.
    radian_m: f64,
}

impl<'a, K: MachineKind<N>, const N: usize> Surveyor<'a, K, N> {
    /// Creates a surveyor of a robot file's machine.
    #[must_use]
    pub fn new(file: &'a RobotFile<K, N>) -> Self {
        let joints = file.model.geometry().platform_joints_m;
        let mean = joints.iter().map(Vector3::norm_squared).sum::<f64>() / 6.0;
        Self {
            file,
            radian_m: mean.sqrt(),
        }
    }

    pub(super) fn radian_m(&self) -> f64 {
        self.radian_m
    }

    /// Evaluates the machine with its tool at a place, world axes, m.
    #[must_use]
    pub fn survey(&self, tool_m: Vector3<f64>) -> GridPlace<N> {
        GridPlace {
            tool_m,
            reached: self.reach(&tool_m),
        }
    }

    fn reach(&self, tool_m: &Vector3<f64>) -> Result<Reached<N>, KinematicsError> {
        let q = self.file.model.axes_at(tool_m)?;
        let lines = self.file.model.lines(tool_m, &q)?;
        let condition = condition(&lines, &self.file.metres_per_q, self.radian_m)?;
        let compliance_m_per_n = match &self.file.compliances {
            Some(springs) => {
                let translation = lines.compliance(springs)?.translation();
                Some(translation.symmetric_eigenvalues().max())
            }
            None => None,
        };
        Ok(Reached {
            q,
            condition,
            compliance_m_per_n,
        })
    }
}

/// Returns the condition number of the Jacobian: largest over smallest singular value, at least 1,
/// infinite at a singularity. Axes count in metres; a radian of the platform counts as `radian_m`
/// metres. Without the weights it would depend on units.
///
/// # Errors
/// As [`LineMatrix::jacobian`].
pub fn condition<const N: usize>(
    lines: &LineMatrix<N>,
    metres_per_q: &[f64; N],
    radian_m: f64,
) -> Result<f64, KinematicsError> {
    let jacobian = lines.jacobian()?;
    // Columns without an axis are zero, and so are their singular values, the smallest ones.
    let weighted = Matrix6::from_fn(|row, axis| {
        let twist = if row < 3 { 1.0 } else { radian_m };
        match (metres_per_q.get(axis), jacobian.get((row, axis))) {
            (Some(scale), Some(slope)) => slope * twist / scale,
            _ => 0.0,
        }
    });
    let mut values: [f64; 6] = weighted.singular_values().into();
    values.sort_by(|one, other| other.total_cmp(one));
    let [largest, ..] = values;
    let smallest = values.get(N.saturating_sub(1)).copied();
    Ok(largest / smallest.unwrap_or(f64::NAN))
}
