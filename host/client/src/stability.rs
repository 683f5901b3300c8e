//! Stability of the compensation, judged before it acts.

use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_machine::stability::Place;
use gantry_tau_machine::stability::survey::MIN_MARGIN;

/// Smallest margin of a loop at home.
#[derive(Clone, Debug, PartialEq)]
pub struct HomeMargin {
    /// Against any phase, with all of the correction; `None` without masses.
    whole: Option<f64>,
    robot: String,
}

impl HomeMargin {
    /// Margin of a robot file's machine with its filter.
    #[must_use]
    pub fn of<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) -> Self {
        Self {
            whole: margin(robot),
            robot: robot.name.clone(),
        }
    }

    /// True if nothing is known: the robot file has no masses.
    #[must_use]
    pub const fn is_unknown(&self) -> bool {
        self.whole.is_none()
    }

    /// Returns the reason against this share of the correction, 0 to 1.
    #[must_use]
    pub fn against(&self, gain: f64) -> Option<String> {
        let margin = self.whole? / gain;
        (margin < MIN_MARGIN).then(|| {
            format!(
                "{}: the compensation may swing: its margin at home is {margin:.2}, and {MIN_MARGIN} is required; see `gantry-tau stability` (`gantry-tau client --accept-unstable` obtains all the same)",
                self.robot
            )
        })
    }
}

fn margin<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) -> Option<f64> {
    robot.masses?;
    // A machine without natural frequencies at home has no margin there.
    let place = Place::at_home(robot, 1.0);
    Some(place.map_or(0.0, |place| place.margins.exact.any_phase))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_has_a_margin_and_the_first_order_does_not() {
        let mut robot = RobotFile::builtin_l2().unwrap();
        let margin = HomeMargin::of(&robot);
        assert_eq!(margin.against(1.0), None);
        robot.sensor.filter = Some(gantry_tau_machine::robot_file::FilterKey::FirstOrder);
        robot.sensor.cutoff_hz = 20.0;
        let margin = HomeMargin::of(&robot);
        let reason = margin.against(1.0).unwrap();
        assert!(reason.contains("`gantry-tau stability`"), "{reason}");
        assert_eq!(margin.against(0.01), None);
        robot.masses = None;
        let margin = HomeMargin::of(&robot);
        assert!(margin.is_unknown() && margin.against(1.0).is_none());
    }
}
