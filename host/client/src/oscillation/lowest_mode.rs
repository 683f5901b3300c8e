//! Lowest natural frequency of a machine in its present place.

use gantry_tau_core::units::PositionNm;
use gantry_tau_machine::dynamics::{MassiveMachine, Modes};
use gantry_tau_machine::elastic::Equilibrium;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use nalgebra::Vector6;

/// Way of an axis after which the frequency is computed again, nm.
const MOVED_NM: u64 = 5_000_000;

/// Lowest natural frequency of a machine with its drives held, unloaded, computed again where an
/// axis has moved by 5 mm.
#[derive(Clone, Debug)]
pub(super) struct LowestMode<const N: usize> {
    machine: MassiveMachine<N>,
    metres_per_q: [f64; N],
    /// Nominal positions of the last computation.
    place: Option<[PositionNm; N]>,
    /// Pose of the last solution, where the next search starts.
    unloaded: Equilibrium<N>,
    hz: Option<f64>,
}

impl<const N: usize> LowestMode<N> {
    /// Lowest mode of the machine of a robot file. `None` without masses or compliances.
    pub(super) fn of<K: MachineKind<N>>(robot: &RobotFile<K, N>) -> Option<Self> {
        Some(Self {
            machine: MassiveMachine::of(robot)?,
            metres_per_q: robot.metres_per_q,
            place: None,
            unloaded: Equilibrium::at_home(robot.home_m().into()),
            hz: None,
        })
    }

    /// Returns the frequency at nominal positions, Hz. Where it cannot be computed, that of the
    /// last place; `None` before the first.
    pub(super) fn at(&mut self, nominal: &[PositionNm; N]) -> Option<f64> {
        if self.has_moved(nominal) {
            self.place = Some(*nominal);
            self.hz = self.computed_hz(nominal).or(self.hz);
        }
        self.hz
    }

    fn has_moved(&self, nominal: &[PositionNm; N]) -> bool {
        let Some(place) = &self.place else {
            return true;
        };
        let mut ways = nominal.iter().zip(place);
        ways.any(|(now, then)| now.0.abs_diff(then.0) >= MOVED_NM)
    }

    fn computed_hz(&mut self, nominal: &[PositionNm; N]) -> Option<f64> {
        let mut q = nominal.map(|position| position.to_metres().0);
        for (q, metres) in q.iter_mut().zip(&self.metres_per_q) {
            *q /= metres;
        }
        let elastic = &self.machine.elastic;
        self.unloaded = (elastic.equilibrium(&q, &Vector6::zeros(), &self.unloaded)).ok()?;
        let modes = Modes::of(&self.machine, &self.unloaded.pose, &q)?;
        modes.hz().first().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gantry_tau_machine::model::on_path;

    /// Lowest mode at home, 20.711 Hz (L2) and 6.8236 Hz (F1), of `docs/dynamics.md`.
    fn mode_at_home<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) -> f64 {
        let nominal = on_path(&robot.home_q().unwrap(), &robot.metres_per_q).unwrap();
        LowestMode::of(robot).unwrap().at(&nominal).unwrap()
    }

    #[test]
    fn home_has_the_lowest_modes_of_the_page() {
        let l2 = mode_at_home(&RobotFile::builtin_l2().unwrap());
        assert!((l2 - 20.711).abs() < 1e-3, "{l2}");
        let f1 = mode_at_home(&RobotFile::builtin_f1().unwrap());
        assert!((f1 - 6.8236).abs() < 1e-4, "{f1}");
    }

    /// Away from home, with axes that are not all in metres.
    #[test]
    fn a_turned_platform_has_the_mode_of_its_place() {
        let robot = RobotFile::builtin_f1().unwrap();
        let mut q = robot.home_q().unwrap();
        for (place, moved) in q.iter_mut().zip([0.1, 0.05, -0.1, 0.2, -0.15, 0.1]) {
            *place += moved;
        }
        let machine = MassiveMachine::of(&robot).unwrap();
        let start = Equilibrium::at_home(robot.home_m().into());
        let unloaded = (machine.elastic.equilibrium(&q, &Vector6::zeros(), &start)).unwrap();
        let expected = Modes::of(&machine, &unloaded.pose, &q).unwrap().hz()[0];
        let nominal = on_path(&q, &robot.metres_per_q).unwrap();
        let found = LowestMode::of(&robot).unwrap().at(&nominal).unwrap();
        assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
    }

    #[test]
    fn five_millimetres_are_another_place() {
        let robot = RobotFile::builtin_l2().unwrap();
        let mut mode = LowestMode::of(&robot).unwrap();
        let home = on_path(&robot.home_q().unwrap(), &robot.metres_per_q).unwrap();
        let at_home = mode.at(&home);
        let mut near = home;
        near[2].0 -= 4_999_999;
        assert_eq!(mode.at(&near), at_home);
        near[2].0 -= 1;
        assert_ne!(mode.at(&near), at_home);
    }

    /// Out of reach the last frequency stays, and the way back is found.
    #[test]
    fn out_of_reach_the_last_frequency_stays() {
        let robot = RobotFile::builtin_l2().unwrap();
        let mut mode = LowestMode::of(&robot).unwrap();
        let home = on_path(&robot.home_q().unwrap(), &robot.metres_per_q).unwrap();
        let beyond = home.map(|axis| PositionNm(axis.0 * 100));
        assert_eq!(mode.at(&beyond), None);
        let at_home = mode.at(&home);
        assert!(at_home.is_some());
        assert_eq!(mode.at(&beyond), at_home);
        assert_eq!(mode.at(&home), at_home);
    }

    #[test]
    fn a_file_without_masses_has_no_modes() {
        let mut robot = RobotFile::builtin_l2().unwrap();
        robot.masses = None;
        assert!(LowestMode::of(&robot).is_none());
    }
}
