//! From a wrench at the tool to bounded cart offsets `[T 5.2.3]`.
//!
//! A load moves the tool by `dT_links` through the links, and each cart by `r = c tau`. Both are taken off the reference:
//! `q_cmd = IK(T - dT_links) - r`. The thesis says "adding": with the load counted as applied *by the environment to the
//! platform*, the displacement has the load's direction, and what cancels it is its negative. The wrong sign doubles the error.
//!
//! Measured load fed back through an estimated compliance is positive feedback against a stiff workpiece: stable while the
//! estimate stays below the machine's compliance plus the workpiece's. Hence a gain of at most 1, and limits.
//!
//! Two maps, both bounded by the same last step ([`CompensatorConfig::bounded`]): to first order, which is cheap ([`Compensator`],
//! [`SixLinkCompensator::correction`]), and exact ([`ExactCompensator`], [`SixLinkCompensator::exact_correction`]).
//!
//! Instructions per cycle are counted in `tests/benches/instructions/counts.toml`.

mod held;
mod six_link;

pub use held::{ExactCompensator, held};
pub use six_link::{SixLinkCompensator, SixLinkElastic};

use core::fmt;
use nalgebra::Vector3;

use crate::model::kinematics::{KinematicsError, Nominal};
use crate::model::robot::{ARMS, Compliances, SCALE_RANGE};
use crate::model::statics::Wrench;
use crate::model::stiffness::{TauDeflection, TauModel};
use crate::units::{Metres, OffsetNm};
use crate::zip::zip;

/// How much is corrected, and how far; not yet checked. It says the same to every compensator, whichever map it has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompensatorConfig<const N: usize = ARMS> {
    /// Share of the computed displacement that is corrected, 0 to 1.
    pub gain: f64,
    /// Largest magnitude of each axis' offset; zero means zero.
    pub limits: [OffsetNm; N],
    /// Length of one unit of each `q`, m.
    pub metres_per_q: [f64; N],
}

impl<const N: usize> CompensatorConfig<N> {
    fn check(&self) -> Result<(), CompensatorError> {
        if !(0.0..=1.0).contains(&self.gain) {
            return Err(CompensatorError::Gain);
        }
        let (lower, upper) = SCALE_RANGE;
        for (axis, (limit, scale)) in zip(&self.limits, &self.metres_per_q).enumerate() {
            if limit.0 < 0 {
                return Err(CompensatorError::Limit { axis });
            }
            if !(lower..=upper).contains(scale) {
                return Err(CompensatorError::MetresPerQ { axis });
            }
        }
        Ok(())
    }

    /// Offsets from `q` to `command` (q-units), within the limits: the last step of every correction.
    ///
    /// It trusts nothing: any numbers, and any configuration, lead to offsets within the limits or to an error.
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`] when an offset is NaN. Infinities are cut.
    #[inline]
    pub fn bounded(
        &self,
        q: &[f64; N],
        command: &[f64; N],
    ) -> Result<Correction<N>, KinematicsError> {
        let mut offsets = [OffsetNm(0); N];
        let mut saturated = [false; N];
        for index in 0..N {
            // Every array has N elements.
            let (Some(q), Some(command), Some(scale), Some(limit), Some(offset), Some(cut)) = (
                q.get(index),
                command.get(index),
                self.metres_per_q.get(index),
                self.limits.get(index),
                offsets.get_mut(index),
                saturated.get_mut(index),
            ) else {
                continue;
            };
            (*offset, *cut) = within((command - q) * scale, *limit)?;
        }
        Ok(Correction { offsets, saturated })
    }

    /// As [`bounded`](Self::bounded), for a map that corrects all of it: the share `gain` of the way from `q` to `held`.
    ///
    /// # Errors
    /// As [`bounded`](Self::bounded).
    fn bounded_share(
        &self,
        q: &[f64; N],
        held: &[f64; N],
    ) -> Result<Correction<N>, KinematicsError> {
        let mut command = *q;
        for (command, held) in command.iter_mut().zip(held) {
            *command += self.gain * (held - *command);
        }
        self.bounded(q, &command)
    }
}

/// [`OffsetNm::from_metres_within`], which refuses nothing but NaN.
#[inline]
fn within(offset_m: f64, limit: OffsetNm) -> Result<(OffsetNm, bool), KinematicsError> {
    OffsetNm::from_metres_within(Metres(offset_m), limit).map_err(|_| KinematicsError::NotFinite)
}

/// Why a compensator was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CompensatorError {
    /// `gain` is not from 0 to 1.
    Gain,
    /// A limit is negative.
    Limit {
        /// Which axis.
        axis: usize,
    },
    /// `metres_per_q` is not finite or outside [`SCALE_RANGE`].
    MetresPerQ {
        /// Which axis.
        axis: usize,
    },
}

impl fmt::Display for CompensatorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gain => f.write_str("gain must be from 0 to 1"),
            Self::Limit { axis } => write!(f, "limits[{axis}] must not be negative"),
            Self::MetresPerQ { axis } => {
                let (lower, upper) = SCALE_RANGE;
                write!(
                    f,
                    "metres_per_q[{axis}] must be from {lower:e} to {upper:e}"
                )
            }
        }
    }
}

impl core::error::Error for CompensatorError {}

/// What one cycle asks of the axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Correction<const N: usize = ARMS> {
    /// Offset of each axis, within its limit.
    pub offsets: [OffsetNm; N],
    /// Whether the limit cut it short.
    pub saturated: [bool; N],
}

/// The pure map: positions that hold `tcp_m` under `load`, `q_cmd = IK(T - gain dT_links) - gain r` (q-units).
///
/// `q` are the positions that hold it without load. Nothing is limited or filtered; travel is not checked either, as a
/// correction may reach from the nominal travel into the machine's.
///
/// # Errors
/// As [`TauModel::deflection`] at `tcp_m`, and as [`Nominal::inverse`] for the corrected pose.
#[inline]
pub fn compensated(
    model: &TauModel,
    tcp_m: &Vector3<f64>,
    q: &[f64; ARMS],
    load: &Wrench,
    gain: f64,
) -> Result<[f64; ARMS], KinematicsError> {
    let deflection = model.deflection(tcp_m, q, load)?;
    command(model, tcp_m, &deflection, gain)
}

/// `IK(T - gain dT_links) - gain r`.
#[inline]
fn command(
    model: &TauModel,
    tcp_m: &Vector3<f64>,
    deflection: &TauDeflection,
    gain: f64,
) -> Result<[f64; ARMS], KinematicsError> {
    let corrected_m = tcp_m - deflection.translation_m * gain;
    let [q1, q2, q3] = model.corrections().inverse(&corrected_m)?;
    let [r1, r2, r3] = deflection.carts;
    Ok([q1 - gain * r1, q2 - gain * r2, q3 - gain * r3])
}

/// The pure map with gain, limits and units: from a wrench to offsets for the server.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensator {
    model: TauModel,
    config: CompensatorConfig,
}

impl Compensator {
    /// Checks the configuration.
    ///
    /// # Errors
    /// [`CompensatorError`], naming the parameter and its axis.
    pub fn new(
        nominal: &Nominal,
        compliances: &Compliances,
        config: CompensatorConfig,
    ) -> Result<Self, CompensatorError> {
        config.check()?;
        Ok(Self {
            model: TauModel::new(nominal, compliances),
            config,
        })
    }

    /// The elastic model inside.
    #[must_use]
    pub const fn model(&self) -> &TauModel {
        &self.model
    }

    /// The configuration.
    #[must_use]
    pub const fn config(&self) -> &CompensatorConfig {
        &self.config
    }

    /// One cycle: offsets that hold the tool where the nominal positions `q` (q-units) put it, under `load`.
    ///
    /// Whatever the load, what comes out is within the limits or an error.
    ///
    /// # Errors
    /// As [`Nominal::forward`] and [`compensated`].
    #[inline]
    pub fn correction(
        &self,
        q: &[f64; ARMS],
        load: &Wrench,
    ) -> Result<Correction, KinematicsError> {
        let (tcp_m, frame) = self.model.nominal().forward_frame(q)?;
        let deflection = self.model.deflection_in(&frame, load)?;
        let command = command(&self.model, &tcp_m, &deflection, self.config.gain)?;
        self.config.bounded(q, &command)
    }

    /// One cycle, as [`correction`](Self::correction), where the tool centre point (world axes, metres) that belongs to `q` is known.
    ///
    /// # Errors
    /// As [`compensated`]; [`KinematicsError::Inconsistent`] when the two do not belong together.
    #[inline]
    pub fn correction_at(
        &self,
        tcp_m: &Vector3<f64>,
        q: &[f64; ARMS],
        load: &Wrench,
    ) -> Result<Correction, KinematicsError> {
        let command = compensated(&self.model, tcp_m, q, load, self.config.gain)?;
        self.config.bounded(q, &command)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::kinematics::tests::{Case, compliances, geometry, l2, machine, skewed};
    use crate::model::kinematics::{KinematicsError, Pose};
    use crate::model::linalg::norm;
    use crate::model::robot::Robot;
    use crate::model::statics::LineMatrix;
    use nalgebra::Matrix3;
    use proptest::prelude::*;

    const LIMIT: OffsetNm = OffsetNm(2_000_000);

    fn compensator(gain: f64, limit: OffsetNm) -> Compensator {
        let config = CompensatorConfig {
            gain,
            limits: [limit; ARMS],
            metres_per_q: [1.0; ARMS],
        };
        Compensator::new(&l2(), &compliances(), config).unwrap()
    }

    #[test]
    fn agrees_with_the_oracle() {
        let model = TauModel::new(&l2(), &compliances());
        for case in Case::all() {
            let load = Wrench::from_array(case.numbers("w").try_into().unwrap());
            let q = case.three("q");
            case.agrees(
                "q_comp",
                compensated(&model, &case.tcp(), &q, &load, 1.0).unwrap(),
            );
            let correction = compensator(1.0, LIMIT).correction(&q, &load).unwrap();
            let expected = case.three("q_comp");
            for ((offset, q), expected) in correction.offsets.iter().zip(q).zip(expected) {
                assert!((offset.to_metres().0 - (expected - q)).abs() < 1e-9);
            }
            assert_eq!(correction.saturated, [false; ARMS]);
        }
    }

    #[test]
    fn a_corrected_machine_stands_where_the_nominal_one_does() {
        // The elastic machine itself: carts yield by r, then the links by W^T dx = -e. No sign can hide from this.
        let (skewed, turn) = skewed();
        for (geometry, rotation) in [(geometry(), Matrix3::identity()), (skewed, turn)] {
            let nominal = machine(geometry, &rotation);
            let model = TauModel::new(&nominal, &compliances());
            let robot = Robot::new(geometry).unwrap();
            let tcp = rotation * Vector3::new(0.0, 0.5, 0.65);
            let q = nominal.inverse(&tcp).unwrap();
            let load = Wrench::from_array([300.0, -50.0, 100.0, 1.0, 2.0, -1.0]);
            let moved = |command: &[f64; 3]| {
                let there = nominal.forward(command).unwrap();
                let pose = Pose {
                    position_m: there,
                    rotation,
                };
                let lines = LineMatrix::new(&robot, &pose, command).unwrap();
                let deflection = lines.deflection(&compliances(), &load).unwrap();
                norm(&(there + deflection.total.translation_m - tcp))
            };
            let before = moved(&q);
            let after = moved(&compensated(&model, &tcp, &q, &load, 1.0).unwrap());
            assert!(before > 1e-4, "{before}");
            assert!(after < 2e-3 * before, "{before} {after}");
            let half = moved(&compensated(&model, &tcp, &q, &load, 0.5).unwrap());
            assert!((half / before - 0.5).abs() < 1e-2, "{half}");
        }
    }

    #[test]
    fn home_offsets_are_those_of_the_robot_file() {
        let q = l2().inverse(&Vector3::new(0.0, 0.5, 0.65)).unwrap();
        let load = Wrench::from_array([300.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let offsets = compensator(1.0, LIMIT)
            .correction(&q, &load)
            .unwrap()
            .offsets;
        let micrometres = offsets.map(|offset| offset.0 / 1000);
        assert_eq!(micrometres, [-188, -237, -149]);
        let none = compensator(0.0, LIMIT).correction(&q, &load).unwrap();
        assert_eq!(none.offsets, [OffsetNm(0); ARMS]);
        let cut = compensator(1.0, OffsetNm(190_000))
            .correction(&q, &load)
            .unwrap();
        assert_eq!(cut.saturated, [false, true, false]);
        assert_eq!(cut.offsets[1], OffsetNm(-190_000));
        let zero = compensator(1.0, OffsetNm(0)).correction(&q, &load).unwrap();
        assert_eq!(zero.offsets, [OffsetNm(0); ARMS]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        #[test]
        fn the_output_is_bounded_for_any_load(
            load in prop::array::uniform6(prop_oneof![any::<f64>(), -1e7..1e7_f64, Just(f64::NAN)]),
            q in prop::array::uniform3(prop_oneof![any::<f64>(), -2.0..2.0_f64]),
            standing: bool, gain in 0.0..=1.0_f64, limit in 0..=i32::MAX,
        ) {
            let q = if standing { l2().inverse(&Vector3::new(0.0, 0.5, 0.65)).unwrap() } else { q };
            if let Ok(correction) = compensator(gain, OffsetNm(limit)).correction(&q, &Wrench::from_array(load)) {
                prop_assert!(correction.offsets.iter().all(|offset| offset.0.abs() <= limit));
            }
        }
    }

    #[test]
    fn wild_loads_and_configurations_are_refused() {
        let q = l2().inverse(&Vector3::new(0.0, 0.5, 0.65)).unwrap();
        let ours = compensator(1.0, LIMIT);
        for wild in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for index in 0..6 {
                let mut load = [0.0; 6];
                load[index] = wild;
                let error = ours.correction(&q, &Wrench::from_array(load)).unwrap_err();
                assert_eq!(error, KinematicsError::NotFinite);
            }
        }
        let heavy = Wrench::from_array([1e7, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(ours.correction(&q, &heavy).is_err());
        let refused = |config| Compensator::new(&l2(), &compliances(), config).unwrap_err();
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
}
