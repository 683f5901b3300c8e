//! Expected error of the places of the workspace.

use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_machine::workspace::{Grid, survey};
use nalgebra::Vector3;

/// Steps along the longest side of the grid that the expected error is a mean over.
const GRID_CELLS: u32 = 16;

/// Axes at a place, and the place, m.
pub(crate) type Stand<const N: usize> = ([f64; N], Vector3<f64>);

/// Grid of the workspace, and what `robot` reaches of it.
pub(crate) fn stands<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> (Grid, Vec<Stand<N>>) {
    let grid = Grid::of(robot, GRID_CELLS);
    let places = survey(robot, grid, |_| ()).places.into_iter();
    (
        grid,
        places
            .filter_map(|place| Some((place.reached.ok()?.q, place.tool_m)))
            .collect(),
    )
}

/// Expected error over a grid of the workspace.
pub(super) struct Expected {
    pub(super) grid: Grid,
    /// Place and error, um; places whose error is not finite are left out.
    pub(super) places_um: Vec<(Vector3<f64>, f64)>,
    /// Root mean square over all places, m; not finite if one is not.
    pub(super) rms_m: f64,
}

impl Expected {
    /// Expected error of the places that `robot` reaches; `rms_of_m` returns the root mean square
    /// over some of them, m.
    pub(super) fn over<K: MachineKind<N>, const N: usize>(
        robot: &RobotFile<K, N>,
        rms_of_m: impl Fn(&[Stand<N>]) -> f64,
    ) -> Self {
        let (grid, stands) = stands(robot);
        let places_um = stands
            .iter()
            .filter_map(|stand| {
                let error_m = rms_of_m(&[*stand]);
                error_m.is_finite().then_some((stand.1, error_m * 1e6))
            })
            .collect();
        Self {
            grid,
            places_um,
            rms_m: rms_of_m(&stands),
        }
    }
}
