//! Variables that server and compensator have alike.

use gantry_tau_core::model::statics::Wrench;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;

use super::conversions::{MAX_FORCE_N, MAX_MOMENT_NM, MAX_POSITION_M};
use crate::variable::Causality::{Input, Output};
use crate::variable::{Declarations, Domain, Group, Unit, Values};

/// Raw sample of the force sensor.
#[derive(Clone, Copy)]
pub(super) struct ForceInputs {
    force: Group<3>,
    moment: Group<3>,
}

impl ForceInputs {
    pub(super) fn declare(declared: &mut Declarations) -> Self {
        Self {
            force: declared.add(
                "force",
                Input,
                Domain::Real(Unit::Newton),
                "Force that the sensor shows, with its zero error and the weight of the tool, sensor axes",
                [([-MAX_FORCE_N, MAX_FORCE_N], 0.0); 3],
            ),
            moment: declared.add(
                "moment",
                Input,
                Domain::Real(Unit::NewtonMetre),
                "Moment that the sensor shows about its origin, sensor axes",
                [([-MAX_MOMENT_NM, MAX_MOMENT_NM], 0.0); 3],
            ),
        }
    }

    /// Returns force, then moment.
    pub(super) fn read(&self, values: &Values) -> [f64; 6] {
        let ([fx, fy, fz], [mx, my, mz]) = (values.get(self.force), values.get(self.moment));
        [fx, fy, fz, mx, my, mz]
    }
}

/// Load that a compensation found.
#[derive(Clone, Copy)]
pub(super) struct LoadOutputs {
    force: Group<3>,
    moment: Group<3>,
}

impl LoadOutputs {
    pub(super) fn declare(declared: &mut Declarations) -> Self {
        Self {
            force: declared.add(
                "load_force",
                Output,
                Domain::Real(Unit::Newton),
                "Force on the tool that is compensated, filtered, world axes; 0 while taring",
                [([-MAX_FORCE_N, MAX_FORCE_N], 0.0); 3],
            ),
            moment: declared.add(
                "load_moment",
                Output,
                Domain::Real(Unit::NewtonMetre),
                "Moment on the tool about the tool centre point that is compensated, world axes",
                [([-MAX_FORCE_N, MAX_FORCE_N], 0.0); 3],
            ),
        }
    }

    pub(super) fn show(&self, load: &Wrench, values: &mut Values) {
        let [fx, fy, fz, mx, my, mz] = load.to_array();
        values.put(self.force, [fx, fy, fz]);
        values.put(self.moment, [mx, my, mz]);
    }
}

/// Declares the nominal positions.
pub(super) fn nominal_inputs<const N: usize>(
    declared: &mut Declarations,
    home_m: [f64; N],
) -> Group<N> {
    declared.add(
        "nominal",
        Input,
        Domain::Real(Unit::Metre),
        "Nominal position of the path",
        home_m.map(|home_m| ([-MAX_POSITION_M, MAX_POSITION_M], home_m)),
    )
}

/// Returns the largest position offsets of a robot file, m.
pub(super) fn largest_offsets_m<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> [f64; N] {
    robot
        .limits
        .map(|axis| f64::from(axis.limits.position.max()) * 1e-9)
}
