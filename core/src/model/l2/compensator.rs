//! Compensation of three axes: from a wrench to bounded cart offsets.

use super::{AXES, Elastic, Kinematics, exact_command};
use crate::model::compensation::{CompensatorConfig, CompensatorError, Correction};
use crate::model::kinematics::{KinematicsError, Pose};
use crate::model::robot::Compliances;
use crate::model::statics::Wrench;
use crate::units::PositionNm;

/// Compensator of an L2, with gain, limits and units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensator {
    machine: Elastic,
    config: CompensatorConfig<AXES>,
}

impl Compensator {
    /// Checks the configuration.
    ///
    /// # Errors
    /// [`CompensatorError`], naming the parameter and its axis.
    pub fn new(
        kinematics: &Kinematics,
        compliances: &Compliances<AXES>,
        config: CompensatorConfig<AXES>,
    ) -> Result<Self, CompensatorError> {
        config.check()?;
        Ok(Self {
            machine: Elastic::new(kinematics, compliances),
            config,
        })
    }

    /// The machine and its springs.
    #[must_use]
    pub const fn machine(&self) -> &Elastic {
        &self.machine
    }

    /// The configuration.
    #[must_use]
    pub const fn config(&self) -> &CompensatorConfig<AXES> {
        &self.config
    }

    /// Returns the offsets of one cycle, which hold the tool where the nominal positions put it,
    /// under `load`; to first order, at constant cost. For any load the offsets are within the
    /// limits.
    ///
    /// # Errors
    /// As [`Kinematics::forward`] and [`Elastic::command`].
    ///
    /// # Examples
    /// ```
    /// use gantry_tau_core::model::compensation::CompensatorConfig;
    /// use gantry_tau_core::model::statics::Wrench;
    /// use gantry_tau_core::model::{l2, nalgebra::Matrix3, presets};
    /// use gantry_tau_core::units::{OffsetNm, PositionNm};
    ///
    /// let robot = l2::Robot::new(presets::l2())?;
    /// let kinematics = l2::Kinematics::new(&robot, &Matrix3::identity())?;
    /// let compensator = l2::Compensator::new(
    ///     &kinematics,
    ///     &presets::l2_compliances(),
    ///     CompensatorConfig { gain: 1.0, limits: [OffsetNm(2_000_000); 3], metres_per_q: [1.0; 3] },
    /// )?;
    /// let nominal = [PositionNm(500_000_000), PositionNm(-500_000_000), PositionNm(500_000_000)];
    /// let load = Wrench::from_array([300.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    /// let correction = compensator.correct(&nominal, &load)?;
    /// // The load pushes the carts along +x, so they are commanded to stand back.
    /// assert!(correction.offsets.iter().all(|offset| offset.0 < 0));
    /// assert_eq!(correction.saturated, [false; 3]);
    /// # Ok::<(), Box<dyn core::error::Error>>(())
    /// ```
    #[inline]
    pub fn correct(
        &self,
        nominal: &[PositionNm; AXES],
        load: &Wrench,
    ) -> Result<Correction<AXES>, KinematicsError> {
        self.correct_q(&self.config.q_of(nominal), load)
    }

    /// As [`correct`](Self::correct), for nominal positions in q-units.
    ///
    /// # Errors
    /// As [`correct`](Self::correct).
    #[inline]
    pub fn correct_q(
        &self,
        q: &[f64; AXES],
        load: &Wrench,
    ) -> Result<Correction<AXES>, KinematicsError> {
        let (tcp_m, frame) = self.machine.kinematics().forward_frame(q)?;
        let deflection = self.machine.deflection_in(&frame, load)?;
        let command = (self.machine).corrected(&tcp_m, &deflection, self.config.gain)?;
        self.config.bounded(q, &command)
    }

    /// As [`correct_q`](Self::correct_q) by the exact map, for a known pose; the share `gain` of
    /// its offsets.
    ///
    /// # Errors
    /// As [`exact_command`].
    pub fn correct_exact_at(
        &self,
        pose: &Pose,
        q: &[f64; AXES],
        load: &Wrench,
    ) -> Result<Correction<AXES>, KinematicsError> {
        let robot = self.machine.kinematics().robot();
        let springs = self.machine.compliances();
        let exact = exact_command(robot, springs, pose, q, load)?;
        self.config.bounded_share(q, &exact.value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::l2::tests::{compliances, geometry, l2, machine};
    use crate::units::OffsetNm;
    use nalgebra::{Matrix3, Vector3};

    const LIMIT: OffsetNm = OffsetNm(2_000_000);

    fn compensator(gain: f64, limit: OffsetNm) -> Compensator {
        let config = CompensatorConfig {
            gain,
            limits: [limit; AXES],
            metres_per_q: [1.0; AXES],
        };
        Compensator::new(&l2(), &compliances(), config).unwrap()
    }

    #[test]
    fn nanometres_and_q_units_are_the_same_cycle() {
        let mut config = *compensator(1.0, LIMIT).config();
        config.metres_per_q = [2.0, 0.5, 1.0];
        let mut geometry = geometry();
        for (guideway, scale) in geometry.guideways.iter_mut().zip(config.metres_per_q) {
            *guideway *= scale;
        }
        let scaled = machine(geometry, &Matrix3::identity());
        let scaled = Compensator::new(&scaled, &compliances(), config).unwrap();
        let plain = compensator(1.0, LIMIT);
        let nominal = [
            PositionNm(500_000_000),
            PositionNm(-480_000_000),
            PositionNm(510_000_000),
        ];
        let load = Wrench::from_array([300.0, -50.0, 100.0, 1.0, 2.0, -1.0]);
        let q = nominal.map(|position| position.to_metres().0);
        assert_eq!(plain.correct(&nominal, &load), plain.correct_q(&q, &load));
        let [q1, q2, q3] = q;
        let in_its_units = scaled.correct_q(&[q1 / 2.0, q2 / 0.5, q3], &load);
        assert_eq!(scaled.correct(&nominal, &load), in_its_units);
    }

    #[test]
    fn home_offsets_are_those_of_the_robot_file() {
        let q = l2().inverse(&Vector3::new(0.0, 0.5, 0.65)).unwrap();
        let load = Wrench::from_array([300.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let offsets = compensator(1.0, LIMIT)
            .correct_q(&q, &load)
            .unwrap()
            .offsets;
        let micrometres = offsets.map(|offset| offset.0 / 1000);
        assert_eq!(micrometres, [-188, -237, -149]);
        let none = compensator(0.0, LIMIT).correct_q(&q, &load).unwrap();
        assert_eq!(none.offsets, [OffsetNm(0); AXES]);
        let cut = compensator(1.0, OffsetNm(190_000))
            .correct_q(&q, &load)
            .unwrap();
        assert_eq!(cut.saturated, [false, true, false]);
        assert_eq!(cut.offsets[1], OffsetNm(-190_000));
        let zero = compensator(1.0, OffsetNm(0)).correct_q(&q, &load).unwrap();
        assert_eq!(zero.offsets, [OffsetNm(0); AXES]);
    }

    fn refused(config: CompensatorConfig<AXES>) -> CompensatorError {
        Compensator::new(&l2(), &compliances(), config).unwrap_err()
    }

    #[test]
    fn huge_loads_and_wild_configurations_are_refused() {
        let q = l2().inverse(&Vector3::new(0.0, 0.5, 0.65)).unwrap();
        let ours = compensator(1.0, LIMIT);
        let heavy = Wrench::from_array([1e7, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(ours.correct_q(&q, &heavy).is_err());
        let good = *ours.config();
        for gain in [f64::NAN, -0.1, 1.1] {
            assert_eq!(
                refused(CompensatorConfig { gain, ..good }),
                CompensatorError::Gain
            );
        }
        let mut bad = good;
        bad.limits[1] = OffsetNm(-1);
        assert_eq!(refused(bad), CompensatorError::Limit { axis: 1 });
        let mut bad = good;
        bad.metres_per_q[2] = f64::NAN;
        assert_eq!(refused(bad), CompensatorError::MetresPerQ { axis: 2 });
    }

    #[test]
    fn offsets_are_the_share_of_the_exact_map() {
        let pose = Pose::at(Vector3::new(0.0, 0.5, 0.65));
        let q = l2().inverse(&pose.position_m).unwrap();
        let load = Wrench::from_array([300.0, -50.0, 100.0, 1.0, 2.0, -1.0]);
        let exact = exact_command(l2().robot(), &compliances(), &pose, &q, &load).unwrap();
        for gain in [1.0, 0.5, 0.0] {
            let ours = compensator(gain, LIMIT)
                .correct_exact_at(&pose, &q, &load)
                .unwrap();
            assert_eq!(ours.saturated, [false; AXES]);
            for ((offset, q), held) in ours.offsets.iter().zip(q).zip(exact.value) {
                let expected_m = gain * (held - q);
                // A nanometre is the offset's unit.
                assert!((offset.to_metres().0 - expected_m).abs() < 1e-9);
            }
        }
        let cut = compensator(1.0, OffsetNm(100_000))
            .correct_exact_at(&pose, &q, &load)
            .unwrap();
        assert!(cut.saturated.contains(&true), "{cut:?}");
        assert!(cut.offsets.iter().all(|offset| offset.0.abs() <= 100_000));
        let ours = compensator(1.0, LIMIT);
        let exact = ours.correct_exact_at(&pose, &q, &load).unwrap();
        let first_order = ours.correct_q(&q, &load).unwrap();
        for (one, other) in exact.offsets.iter().zip(first_order.offsets) {
            assert!(
                (one.0 - other.0).abs() < other.0.abs() / 50,
                "{exact:?} {first_order:?}"
            );
        }
    }
}
