//! Parameters of the F1 `[T 3.1.2]`, validated once at construction: plate 2 turns by `q4`, plate 3
//! turns by `q5` and tilts by `q6`.
//!
//! `A_ij = C_i + q_i V_i + Q_i P_ij` is the joint on the plate of cart `i`, world axes, with the
//! plates' rotations `Q_1 = I`, `Q_2 = Rot(a, sigma_4 q_4)`,
//! `Q_3 = Rot(a, sigma_5 q_5) Rot(a_6, q_6)`. The thesis gives no axis directions, zero pose or
//! screw law: they are parameters here.

use core::slice;
use nalgebra::Vector3;

use super::AXES;
use crate::model::l2;
use crate::model::linalg::unit;
use crate::model::robot::{
    ARMS, Branch, LINKS, MAX_LENGTH_M, Parameter, RobotError, SCALE_RANGE, check_magnitudes,
    check_travel, check_vectors,
};

/// Geometry of an F1, not yet checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// `C_i`: origins of the carts' plates at `q = 0`, world axes, metres.
    pub carts_m: [Vector3<f64>; ARMS],
    /// `V_i`: guideway directions, world axes, metres per unit of `q_i`.
    pub guideways: [Vector3<f64>; ARMS],
    /// `P_ij`: plate joints in plate axes, from the plate's origin, metres, link order.
    pub plate_joints_m: [Vector3<f64>; LINKS],
    /// `b_ij`: platform joints in platform axes, from the tool centre point, metres, link order.
    pub platform_joints_m: [Vector3<f64>; LINKS],
    /// `L_ij`: length of each link, metres, link order.
    pub lengths_m: [f64; LINKS],
    /// `c_i`: solution of the inverse kinematics that each arm is built in, `sign(s_ij . V_i)` for
    /// every link of its cluster.
    pub configuration: [Branch; ARMS],
    /// `a`: axis that plates 2 and 3 turn about, world axes; of any length.
    pub turn_axis: Vector3<f64>,
    /// `a_6`: axis that plate 3 tilts about, in the axes of the turned plate; of any length.
    pub tilt_axis: Vector3<f64>,
    /// `sigma_4`, `sigma_5`: signs of the turns of plates 2 and 3 for positive `q_4`, `q_5`.
    pub turn_signs: [Branch; 2],
    /// Range of each axis in q-units (radians for the last three), `(lower, upper)`; `None` leaves
    /// the carts unchecked and plates within half a turn.
    pub travel: Option<[(f64, f64); AXES]>,
}

/// The L2 with its six links, each by itself: carts without plates, `P_ij = A0_ij`, and
/// `q_4 = q_5 = q_6 = 0`. Its forward kinematics needs no Tau property; the platform turns as the
/// links let it. Its side of the carts' plane (`c_f`) is that of the seed.
impl From<&l2::Geometry> for Geometry {
    fn from(geometry: &l2::Geometry) -> Self {
        let [l1, l2, l3] = geometry.lengths_m;
        let fixed = (0.0, 0.0);
        Self {
            carts_m: [Vector3::zeros(); ARMS],
            guideways: geometry.guideways,
            plate_joints_m: geometry.cart_joints_m,
            platform_joints_m: geometry.platform_joints_m,
            lengths_m: [l1, l2, l2, l3, l3, l3],
            configuration: geometry.configuration.inverse,
            turn_axis: Vector3::z(),
            tilt_axis: Vector3::y(),
            turn_signs: [Branch::Positive; 2],
            travel: (geometry.travel)
                .map(|[one, two, three]| [one, two, three, fixed, fixed, fixed]),
        }
    }
}

/// Validated F1: six axes, six links. Its fields can be read, not changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Robot {
    geometry: Geometry,
}

impl Robot {
    /// Checks every parameter, and gives both axes unit length.
    ///
    /// # Errors
    /// The first parameter, in the order of [`Geometry`]'s fields, that is not finite, out of range
    /// or reversed.
    pub fn new(mut geometry: Geometry) -> Result<Self, RobotError> {
        let (from, to) = SCALE_RANGE;
        check_vectors(Parameter::Cart, &geometry.carts_m, 0.0, MAX_LENGTH_M)?;
        check_vectors(Parameter::Guideway, &geometry.guideways, from, to)?;
        check_vectors(
            Parameter::PlateJoint,
            &geometry.plate_joints_m,
            0.0,
            MAX_LENGTH_M,
        )?;
        check_vectors(
            Parameter::PlatformJoint,
            &geometry.platform_joints_m,
            0.0,
            MAX_LENGTH_M,
        )?;
        check_magnitudes(Parameter::Length, &geometry.lengths_m, 1e-6, MAX_LENGTH_M)?;
        let axes = [
            (Parameter::TurnAxis, &mut geometry.turn_axis),
            (Parameter::TiltAxis, &mut geometry.tilt_axis),
        ];
        for (parameter, axis) in axes {
            check_vectors(parameter, slice::from_ref(axis), from, to)?;
            *axis = unit(axis).ok_or(RobotError::NotFinite {
                parameter,
                index: 0,
            })?;
        }
        check_travel(geometry.travel.iter().flatten())?;
        Ok(Self { geometry })
    }

    /// The validated geometry; its axes have unit length.
    #[inline]
    #[must_use]
    pub const fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Returns the numbers that decide the kinematics: `C`, `V`, `P`, `b`, `L`, `c`, `ax`, `ax6`,
    /// `sigma4`, `sigma5`, in that order.
    pub(super) fn numbers(&self) -> impl Iterator<Item = f64> {
        let geometry = &self.geometry;
        let vectors = (geometry.carts_m.iter())
            .chain(&geometry.guideways)
            .chain(&geometry.plate_joints_m)
            .chain(&geometry.platform_joints_m);
        let axes = [&geometry.turn_axis, &geometry.tilt_axis];
        (vectors.flat_map(|vector| vector.iter().copied()))
            .chain(geometry.lengths_m)
            .chain(geometry.configuration.iter().map(|branch| branch.sign()))
            .chain(axes.into_iter().flat_map(|axis| axis.iter().copied()))
            .chain(geometry.turn_signs.iter().map(|branch| branch.sign()))
    }
}

/// Any numbers: more machines than [`Robot::new`] accepts.
#[cfg(kani)]
impl kani::Arbitrary for Robot {
    fn any() -> Self {
        use crate::model::linalg::{any_six, any_three, any_vector};
        let geometry = Geometry {
            carts_m: any_three(),
            guideways: any_three(),
            plate_joints_m: any_six(),
            platform_joints_m: any_six(),
            lengths_m: kani::any(),
            configuration: [Branch::Positive; ARMS],
            turn_axis: any_vector(),
            tilt_axis: any_vector(),
            turn_signs: [Branch::Positive; 2],
            travel: kani::any(),
        };
        Self { geometry }
    }
}
