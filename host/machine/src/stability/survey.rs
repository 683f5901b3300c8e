//! Stability of a compensation over the reach of a machine.

use std::num::NonZero;
use std::panic::resume_unwind;
use std::thread::{self, ScopedJoinHandle};

use gantry_tau_core::model::kinematics::Pose as RigidPose;
use gantry_tau_core::model::robot::ARMS;
use nalgebra::{Rotation3, Vector3};

use super::{
    Contact, DriveKind, Filter, FilterKind, Growth, LinearMachine, Loop, LoopGain, Margin,
    NotchFinder, TickMap,
};
use crate::dynamics::MassiveMachine;
use crate::elastic::Pose;
use crate::model::MachineKind;
use crate::robot_file::RobotFile;
use crate::workspace::Grid;

/// Distance of the places, m.
const PITCH_M: f64 = 0.1;
/// Places that are so many times as compliant as home are left out.
const MAX_COMPLIANT: f64 = 10.0;
/// Turn of the platform, rad.
const TURN_RAD: f64 = 0.1;
/// What the modes are taken for in the worst case, as a factor of what they are.
pub const WRONG_MODES: [f64; 2] = [0.8, 1.2];
/// Smallest margin against any phase that is required.
pub const MIN_MARGIN: f64 = 2.0;
/// Smallest margin with a phase of its own on each axis.
pub const MIN_MARGIN_PER_AXIS: f64 = 1.0;

/// A compensation and the drives that it acts through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensation<const N: usize> {
    /// Filter of the load.
    pub filter: FilterKind,
    /// Drives.
    pub drives: DriveKind<N>,
    /// Cycles from a reading to the reference that answers it.
    pub latency_cycles: usize,
    /// Share of the correction that is asked for.
    pub gain: f64,
}

/// A machine with a compensation in one place.
#[derive(Clone, Debug)]
pub struct Place<const N: usize> {
    /// The platform.
    pub pose: Pose,
    /// The axes, q-units.
    pub axes: [f64; N],
    /// Natural frequencies, Hz, lowest first.
    pub modes_hz: Vec<f64>,
    /// Margins with the filter of the compensation.
    pub margins: Margins,
    machine: LinearMachine<N>,
    map: TickMap,
    gain: LoopGain<N>,
    filter: Filter,
}

/// Margins of a filter in one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// With the modes as they are.
    pub exact: Margin,
    /// The smallest with the modes taken for [`WRONG_MODES`] times what they are.
    pub wrong_modes: Margin,
}

impl Margins {
    /// Returns the smaller of each margin.
    #[must_use]
    pub fn least(&self, other: &Self) -> Self {
        Self {
            exact: self.exact.least(&other.exact),
            wrong_modes: self.wrong_modes.least(&other.wrong_modes),
        }
    }

    /// True for the margins that are required.
    #[must_use]
    pub fn suffice(&self) -> bool {
        self.exact.any_phase >= MIN_MARGIN
            && self.wrong_modes.any_phase >= MIN_MARGIN
            && self.wrong_modes.phase_per_axis >= MIN_MARGIN_PER_AXIS
    }
}

/// Places of a machine, and those that are not judged.
#[derive(Clone, Debug)]
pub struct StabilitySurvey<const N: usize> {
    /// Grid of the places; those at which the platform is turned are home.
    pub grid: Grid,
    /// At home.
    pub home: Place<N>,
    /// All places that are judged, home among them.
    pub places: Vec<Place<N>>,
    /// Number of places that are reached and too compliant.
    pub too_compliant: usize,
}

impl<const N: usize> Place<N> {
    /// Judges a compensation in one place. `None` where the machine has no modes.
    #[must_use]
    pub fn of(
        machine: &MassiveMachine<N>,
        pose: &Pose,
        axes: &[f64; N],
        compensation: &Compensation<N>,
    ) -> Option<Self> {
        let mut machine = LinearMachine::at(machine, pose, axes)?;
        machine.correction *= compensation.gain;
        let map = TickMap::of(&machine, &compensation.drives);
        let gain = LoopGain::of(&machine, &map)?;
        let (filter, margins) = judge(&machine, &gain, &compensation.filter)?;
        Some(Self {
            pose: *pose,
            axes: *axes,
            modes_hz: machine.modes.hz(),
            margins,
            machine,
            map,
            gain,
            filter,
        })
    }

    /// Judges the compensation of a robot file's client at home, with this share of the correction.
    /// `None` without masses or modes.
    #[must_use]
    pub fn at_home<K: MachineKind<N>>(robot: &RobotFile<K, N>, gain: f64) -> Option<Self> {
        let finder = NotchFinder::of(robot)?;
        let compensation = Compensation {
            filter: finder.filter,
            drives: finder.drives,
            latency_cycles: 1,
            gain,
        };
        let home = RigidPose::at(robot.home_m());
        let axes = robot.home_q().ok()?;
        Self::of(&finder.machine, &(&home).into(), &axes, &compensation)
    }

    /// Returns another filter here, and its margins. `None` if eigenvalues are not found.
    #[must_use]
    pub fn with_filter(&self, kind: &FilterKind) -> Option<(Filter, Margins)> {
        judge(&self.machine, &self.gain, kind)
    }

    /// Returns the filter here.
    #[must_use]
    pub const fn filter(&self) -> &Filter {
        &self.filter
    }

    /// Returns frequency (Hz) and damping ratio of every vibration with the drives, without
    /// compensation, lowest first. `None` if the eigenvalues are not found.
    #[must_use]
    pub fn vibrations(&self) -> Option<Vec<(f64, f64)>> {
        self.map.vibrations()
    }

    /// Returns the growth of the closed loop in free air. `None` if the eigenvalues are not found.
    #[must_use]
    pub fn growth(&self, latency_cycles: usize) -> Option<Growth> {
        Loop::new(
            &self.machine,
            self.map.clone(),
            self.filter.clone(),
            latency_cycles,
        )
        .growth()
    }

    /// Returns the growths of the closed loop with the tool on each of these workpieces, in their
    /// order. `None` if the eigenvalues of one are not found.
    #[must_use]
    pub fn growths_in_contact(
        &self,
        contacts: &[Contact],
        compensation: &Compensation<N>,
    ) -> Option<Vec<Growth>> {
        let growths = in_parallel(contacts, |contact| {
            let machine = self.machine.in_contact(contact)?;
            let map = TickMap::of(&machine, &compensation.drives);
            let filter = self.filter.clone();
            Loop::new(&machine, map, filter, compensation.latency_cycles).growth()
        });
        growths.into_iter().collect()
    }
}

/// Returns a kind of filter for a machine, and its margins. `None` if eigenvalues are not found.
fn judge<const N: usize>(
    machine: &LinearMachine<N>,
    gain: &LoopGain<N>,
    kind: &FilterKind,
) -> Option<(Filter, Margins)> {
    let notches = kind.notches(machine, gain.response())?;
    let filter = kind.with(&notches, 1.0);
    let [low, high] = WRONG_MODES.map(|factor| gain.margin(&kind.with(&notches, factor)));
    let margins = Margins {
        exact: gain.margin(&filter)?,
        wrong_modes: low?.least(&high?),
    };
    Some((filter, margins))
}

impl<const N: usize> StabilitySurvey<N> {
    /// Judges a compensation over the travel of a machine, every 0.1 m; along guideways that are
    /// all parallel nothing changes. A machine of six axes is turned at home as well. `each` is
    /// called after each of [`candidates`](Self::candidates), on the thread of its processor. `None`
    /// where home has no modes.
    #[must_use]
    pub fn of<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        machine: &MassiveMachine<N>,
        compensation: &Compensation<N>,
        each: impl Fn() + Sync,
    ) -> Option<Self> {
        let home_pose = RigidPose::at(robot.home_m());
        let home_axes = robot.model.axes_for(&home_pose).ok()?;
        let at_home = Pose::from(&home_pose);
        let home = Place::of(machine, &at_home, &home_axes, compensation)?;
        let softest = softness(machine, &at_home, &home_axes)?.map(|home| MAX_COMPLIANT * home);
        let mut reached = Vec::new();
        let mut too_compliant = 0;
        for pose in poses(robot) {
            if let Ok(axes) = robot.model.axes_for(&pose) {
                let pose = Pose::from(&pose);
                match softness(machine, &pose, &axes) {
                    Some(soft) if soft[0] <= softest[0] && soft[1] <= softest[1] => {
                        reached.push((pose, axes));
                        continue;
                    }
                    _ => too_compliant += 1,
                }
            }
            each();
        }
        let places = in_parallel(&reached, |(pose, axes)| {
            let place = Place::of(machine, pose, axes, compensation);
            each();
            place
        });
        Some(Self {
            grid: grid(robot),
            home,
            places: places.into_iter().flatten().collect(),
            too_compliant,
        })
    }

    /// Number of poses that are asked for, reached or not.
    #[must_use]
    pub fn candidates<K: MachineKind<N>>(robot: &RobotFile<K, N>) -> u64 {
        poses(robot).len() as u64
    }

    /// Returns the place with the smallest margin, by the modes as they are or as they are taken
    /// for.
    #[must_use]
    pub fn worst(&self, margin: impl Fn(&Place<N>) -> f64) -> &Place<N> {
        let all = self.places.iter();
        all.min_by(|one, other| margin(one).total_cmp(&margin(other)))
            .unwrap_or(&self.home)
    }

    /// Returns lowest and highest of each of the first five modes over all places, Hz.
    #[must_use]
    pub fn modes_range_hz(&self) -> Vec<[f64; 2]> {
        (0..5)
            .map(|mode| {
                let all = self.places.iter().chain([&self.home]);
                let frequencies = all.filter_map(|place| place.modes_hz.get(mode));
                frequencies.fold([f64::INFINITY, 0.0], |[low, high], hz| {
                    [hz.min(low), hz.max(high)]
                })
            })
            .collect()
    }
}

/// Returns a function's values in their order; the processors of this machine share the work.
pub(super) fn in_parallel<T: Sync, V: Send>(all: &[T], value: impl Fn(&T) -> V + Sync) -> Vec<V> {
    let workers = thread::available_parallelism().map_or(1, NonZero::get);
    let value = &value;
    let mut shares: Vec<_> = thread::scope(|scope| {
        let begun: Vec<_> = (0..workers)
            .map(|first| {
                let share = all.iter().skip(first).step_by(workers);
                scope.spawn(move || share.map(value).collect::<Vec<_>>().into_iter())
            })
            .collect();
        let ended = begun.into_iter().map(ScopedJoinHandle::join);
        ended
            .map(|share| share.unwrap_or_else(|panic| resume_unwind(panic)))
            .collect()
    });
    let workers = (0..workers).cycle().take(all.len());
    workers
        .filter_map(|worker| shares.get_mut(worker)?.next())
        .collect()
}

/// Places that are asked for: along guideways that are all parallel there is one.
fn grid<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) -> Grid {
    let mut grid = Grid::with_pitch(robot, PITCH_M);
    for direction in 0..3 {
        let along = Vector3::ith(direction, 1.0);
        let guideways = robot.model.geometry().guideways;
        if (guideways.iter()).all(|guideway| guideway.cross(&along).norm() < 1e-9) {
            (grid.below[direction], grid.above[direction]) = (0, 0);
        }
    }
    grid
}

/// Poses that are asked for: those of the grid; of a machine that turns, home turned about each
/// axis of the world either way as well.
fn poses<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) -> Vec<RigidPose> {
    let grid = grid(robot);
    let mut poses: Vec<_> = (grid.places())
        .map(|steps| RigidPose::at(grid.at(steps)))
        .collect();
    if N > ARMS {
        poses.extend((0..6).map(|turn| {
            let angle = if turn < 3 { TURN_RAD } else { -TURN_RAD };
            RigidPose {
                position_m: robot.home_m(),
                rotation: Rotation3::new(Vector3::ith(turn % 3, angle)).into_inner(),
            }
        }));
    }
    poses
}

/// Returns the largest displacement of the tool per force, m/N, and the largest turn of the
/// platform per moment, rad/(N m), over all directions.
fn softness<const N: usize>(
    machine: &MassiveMachine<N>,
    pose: &Pose,
    axes: &[f64; N],
) -> Option<[f64; 2]> {
    let compliance = machine.compliance(pose, axes)?;
    Some([0, 3].map(|row| {
        let part = compliance.fixed_view::<3, 3>(row, row).into_owned();
        part.symmetric_eigenvalues().max()
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_margin_is_required() {
        let margins = |exact, wrong, per_axis| {
            let margin = |any_phase, phase_per_axis| Margin {
                any_phase,
                hz: 10.0,
                phase_per_axis,
            };
            Margins {
                exact: margin(exact, 0.1),
                wrong_modes: margin(wrong, per_axis),
            }
        };
        assert!(margins(2.0, 2.0, 1.0).suffice());
        for missing in [
            margins(1.9, 2.0, 1.0),
            margins(2.0, 1.9, 1.0),
            margins(2.0, 2.0, 0.9),
        ] {
            assert!(!missing.suffice(), "{missing:?}");
        }
    }
}
