//! Predicted remainder over the workspace, for a file that carries its covariance.

use gantry_tau_core::model::kinematics::Pose as CorePose;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_machine::elastic::loaded::Loaded;
use gantry_tau_machine::elastic::{Equilibrium, Pose};
use gantry_tau_machine::model::{CorrectedPose, MachineKind};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_machine::workspace::{Grid, Surveyor, survey};
use nalgebra::{UnitQuaternion, Vector3, Vector6};
use serde::Serialize;

use super::VerifyError;
use super::model::{FileModel, three};
use crate::fit::statistics::NORMAL_95;

/// Largest compliance of a place that is judged, over that at home. Near a singularity
/// displacements have no bound.
const MAX_COMPLIANT: f64 = 10.0;

/// Loads of a prediction, and the workpiece of its feedback margin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PredictOptions {
    /// Steps along the longest side of the grid.
    pub cells: u32,
    /// Force at the tool centre point, N, along each of [`directions`].
    pub force_n: f64,
    /// Stiffness of the workpiece, N/m.
    pub workpiece_n_per_m: f64,
}

/// Predicted displacement of the tool under one load.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Remainder {
    /// Displacement without compensation, m.
    pub before_m: f64,
    /// Turn without compensation, rad.
    pub before_rad: f64,
    /// Displacement with compensation where the springs are those of the file, m.
    pub after_m: f64,
    /// Turn with compensation, rad.
    pub after_rad: f64,
    /// Standard deviation of the displacement by the uncertainty of the springs, all three
    /// directions together, m.
    pub sd_m: f64,
    /// Upper end of its 95 % interval along the direction in which it is largest, m.
    pub high95_m: f64,
    /// True where cluster 3 may change sides: its play is not compensated.
    pub changes_sides: bool,
    /// True where a limit of the offsets cuts the correction.
    pub saturated: bool,
}

impl Remainder {
    /// Expected displacement with compensation, root mean square, m.
    #[must_use]
    pub fn expected_m(&self) -> f64 {
        self.after_m.hypot(self.sd_m)
    }

    /// True if neither play nor limits take part.
    #[must_use]
    pub const fn is_judged(&self) -> bool {
        !self.changes_sides && !self.saturated
    }
}

/// Prediction at one place.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlacePrediction {
    /// Tool centre point, world axes, m.
    pub tool_m: [f64; 3],
    /// Load by load, in the order of [`directions`]; those without an equilibrium are left out.
    pub loads: Vec<Remainder>,
    /// Largest stable gain against the workpiece, over all directions.
    pub largest_gain: f64,
}

impl PlacePrediction {
    /// Returns the largest value over the loads that are judged.
    pub(super) fn worst(&self, value: impl Fn(&Remainder) -> f64) -> Option<f64> {
        self.loads
            .iter()
            .filter(|load| load.is_judged())
            .map(value)
            .max_by(f64::total_cmp)
    }
}

/// Prediction over a workspace.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// The grid.
    pub grid: Grid,
    /// Force of the loads, N.
    pub force_n: f64,
    /// Stiffness of the workpiece, N/m.
    pub workpiece_n_per_m: f64,
    /// Places that are reached, and at most ten times as compliant as home.
    pub places: Vec<PlacePrediction>,
    /// Number of places that are reached, and more compliant.
    pub too_compliant: usize,
}

/// Returns the directions of the loads: both ways along the axes of the world and along the
/// diagonals between them.
#[must_use]
pub fn directions() -> Vec<Vector3<f64>> {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()]
        .into_iter()
        .flat_map(|axis| [axis, -axis]);
    let signs = [-1.0, 1.0];
    let diagonals = signs.into_iter().flat_map(|x| signs.map(move |y| (x, y)));
    let diagonals =
        diagonals.flat_map(|(x, y)| signs.map(move |z| Vector3::new(x, y, z).normalize()));
    axes.chain(diagonals).collect()
}

/// Predicts the remainder of the compensation of a file over its workspace.
///
/// # Errors
/// [`VerifyError::NotIdentified`] for a file without `[identified]`.
pub fn predict<K: MachineKind<N>, const N: usize>(
    file: &RobotFile<K, N>,
    options: &PredictOptions,
) -> Result<Prediction, VerifyError> {
    if file.identified.is_none() {
        return Err(VerifyError::NotIdentified {
            file: file.name.clone(),
        });
    }
    let model = FileModel::new(file)?;
    let PredictOptions {
        cells,
        force_n,
        workpiece_n_per_m,
    } = *options;
    let grid = Grid::of(file, cells);
    let reached: Vec<_> = (survey(file, grid, |_| ()).places.into_iter())
        .filter_map(|place| Some((place.tool_m, place.reached.ok()?)))
        .collect();
    let home = Surveyor::new(file)
        .survey(file.home_m())
        .reached
        .ok()
        .and_then(|home| home.compliance_m_per_n);
    let most = MAX_COMPLIANT * home.unwrap_or(f64::INFINITY);
    let stiff = reached
        .iter()
        .filter(|(_, reached)| reached.compliance_m_per_n.is_some_and(|own| own <= most));
    let places = stiff
        .filter_map(|(tool_m, reached)| model.place(file, tool_m, &reached.q, options))
        .collect::<Vec<_>>();
    let too_compliant = reached.len() - places.len();
    Ok(Prediction {
        grid,
        force_n,
        workpiece_n_per_m,
        places,
        too_compliant,
    })
}

impl<const N: usize> FileModel<N> {
    /// Predicts all loads at one place, platform unturned; `None` where the machine has no
    /// equilibrium.
    fn place<K: MachineKind<N>>(
        &self,
        file: &RobotFile<K, N>,
        tool_m: &Vector3<f64>,
        q: &[f64; N],
        options: &PredictOptions,
    ) -> Option<PlacePrediction> {
        let seed = Pose {
            translation_m: *tool_m,
            rotation: UnitQuaternion::identity(),
        };
        let began = self
            .machine
            .equilibrium(q, &Vector6::zeros(), &Equilibrium::unloaded(seed))
            .ok()?;
        let case = InitialState {
            pose: CorePose::at(*tool_m),
            q,
            metres_per_q: &file.metres_per_q,
            began,
        };
        let loads = directions()
            .into_iter()
            .filter_map(|way| self.load(&case, &(way * options.force_n)));
        let gains = directions().into_iter();
        let gains = gains
            .filter_map(|way| self.largest_gain(q, &case.began, &way, options.workpiece_n_per_m));
        Some(PlacePrediction {
            tool_m: (*tool_m).into(),
            loads: loads.collect(),
            largest_gain: gains.fold(f64::INFINITY, f64::min),
        })
    }

    fn load(&self, case: &InitialState<'_, N>, force_n: &Vector3<f64>) -> Option<Remainder> {
        let load = Vector6::new(force_n.x, force_n.y, force_n.z, 0.0, 0.0, 0.0);
        let wrench = Wrench::from_array(load.into());
        let held = CorrectedPose::new(
            &*self.compensator,
            case.metres_per_q,
            &case.pose,
            case.q,
            &wrench,
        )
        .ok()?;
        let before = self
            .machine
            .equilibrium(&held.nominal, &load, &case.began)
            .ok()?;
        let after = self
            .machine
            .equilibrium(&held.corrected, &load, &case.began)
            .ok()?;
        let [uncompensated, compensated] =
            [&before, &after].map(|now| self.loaded(&case.began, now, &load));
        let [given_way, left] = [&uncompensated, &compensated].map(Loaded::displacement);
        let through = self.machine.transmission(&held.corrected, &after)?;
        let covariance = three(&self.covariance(&compensated.displacement_by_springs(&through)));
        let after_m = left.translation_m.norm();
        Some(Remainder {
            before_m: given_way.translation_m.norm(),
            before_rad: given_way.rotation_rad.norm(),
            after_m,
            after_rad: left.rotation_rad.norm(),
            sd_m: covariance.trace().sqrt(),
            high95_m: after_m
                + NORMAL_95 * covariance.symmetric_eigenvalues().max().max(0.0).sqrt(),
            changes_sides: self.changes_sides(&before) || self.changes_sides(&after),
            saturated: held.is_saturated,
        })
    }
}

/// The machine in an unloaded pose.
struct InitialState<'a, const N: usize> {
    pose: CorePose,
    q: &'a [f64; N],
    metres_per_q: &'a [f64; N],
    began: Equilibrium<N>,
}
