//! The tool in each period: its path, and how far the load displaces it, with the offsets and
//! without them.

use gantry_tau_core::control::message::Phase;
use gantry_tau_core::units::PositionNm;
use gantry_tau_machine::elastic::{ElasticError, Equilibrium};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError};
use gantry_tau_machine::sensor::Mounting;
use gantry_tau_report::plots::over_time::Timed;
use gantry_tau_sim::springs::TrueSprings;
use nalgebra::{Vector3, Vector6};

use crate::record::Period;

/// A period with its tool.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment<const N: usize> {
    pub(crate) period: Period<N>,
    /// Tool centre point that LinuxCNC commands, world axes, mm.
    pub(crate) path_mm: [f64; 3],
    /// Force on the tool, world axes, N.
    pub(crate) force_n: [f64; 3],
    /// Displacement of the tool by the load, µm: of the machine as it is, and of the same machine
    /// without offsets.
    pub(crate) displacement_um: Pair,
    /// Turning of the platform, µrad.
    pub(crate) turn_urad: Pair,
}

/// A vector with the offsets and without them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub(crate) with: [f64; 3],
    pub(crate) without: [f64; 3],
}

impl Pair {
    /// Lengths.
    pub(crate) fn norms(&self) -> [f64; 2] {
        [self.with, self.without].map(norm)
    }
}

/// Length of a vector.
pub(crate) fn norm(vector: [f64; 3]) -> f64 {
    Vector3::from(vector).norm()
}

impl<const N: usize> Timed for Moment<N> {
    fn seconds(&self) -> f64 {
        self.period.number as f64 / 1e3
    }

    fn phase(&self) -> Phase {
        self.period.phase
    }
}

/// Reasons why the tool cannot be computed.
#[derive(Clone, Debug, thiserror::Error)]
pub(crate) enum ToolError {
    /// The robot file has no springs, or they cannot be simulated.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// The springs find no equilibrium in a period.
    #[error("period {number}: {error}")]
    Springs {
        /// Number of the period.
        number: u64,
        /// The error.
        error: ElasticError,
    },
}

/// Computes the tool of every period, one after the other: each search begins where the last one
/// ended.
///
/// The springs are those of the file's simulation: each differs from what the client knows by its
/// seeded share.
pub(crate) fn moments<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    periods: &[Period<N>],
) -> Result<Vec<Moment<N>>, ToolError> {
    let springs = TrueSprings::from_robot(robot)?;
    let home = Equilibrium::at_home(robot.home_m().into());
    let mut tool = ToolPair {
        with: springs.clone(),
        without: springs,
        mounting: Mounting::from(&robot.sensor),
        metres_per_q: robot.metres_per_q,
        rigid: home,
        now: [home; 2],
    };
    let moments = periods.iter().map(|period| {
        tool.moment(period).map_err(|error| ToolError::Springs {
            number: period.number,
            error,
        })
    });
    moments.collect()
}

/// The machine, twice: with the offsets and without them. Its joint may stand on different sides of
/// its play.
struct ToolPair<const N: usize> {
    with: TrueSprings<N>,
    without: TrueSprings<N>,
    mounting: Mounting,
    metres_per_q: [f64; N],
    rigid: Equilibrium<N>,
    now: [Equilibrium<N>; 2],
}

impl<const N: usize> ToolPair<N> {
    fn moment(&mut self, period: &Period<N>) -> Result<Moment<N>, ElasticError> {
        let nominal = self.axes(&period.nominal_nm);
        let references = self.axes(&period.reference_nm);
        self.rigid = self
            .with
            .machine()
            .equilibrium(&nominal, &Vector6::zeros(), &self.rigid)?;
        let began = self.rigid.pose;
        // The demonstration's sensor shows the load in the axes of the unloaded platform.
        let load = self
            .mounting
            .load(&Vector6::from(period.wrench), &began.rotation);
        let [with, without] = self.now;
        self.now = [
            self.with.settle(&references, &load, &with)?,
            self.without.settle(&nominal, &load, &without)?,
        ];
        let [with, without] = self.now;
        let with = self.with.loaded(began, with, load, &[]).displacement();
        let without = self
            .without
            .loaded(began, without, load, &[])
            .displacement();
        Ok(Moment {
            period: *period,
            path_mm: (began.translation_m * 1e3).into(),
            force_n: load.fixed_rows::<3>(0).into_owned().into(),
            displacement_um: Pair {
                with: millionths(&with.translation_m),
                without: millionths(&without.translation_m),
            },
            turn_urad: Pair {
                with: millionths(&with.rotation_rad),
                without: millionths(&without.rotation_rad),
            },
        })
    }

    /// Positions in q-units.
    fn axes(&self, nm: &[i64; N]) -> [f64; N] {
        let mut axes = [0.0; N];
        for ((q, nm), metres) in axes.iter_mut().zip(nm).zip(self.metres_per_q) {
            *q = PositionNm(*nm).to_metres().0 / metres;
        }
        axes
    }
}

fn millionths(vector: &Vector3<f64>) -> [f64; 3] {
    (vector * 1e6).into()
}
