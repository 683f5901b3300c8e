//! Joints between the axes and the links: their positions and slopes. By rotations of nalgebra,
//! apart from core's plates.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::robot::{ARM_OF_LINK, ARMS, LINKS};
use nalgebra::{Rotation3, SVector, Unit, Vector3};

/// Indices of `q_4` to `q_6` among the axes.
const Q4: usize = 3;
const Q5: usize = 4;
const Q6: usize = 5;

/// The joint of one link on its cart or plate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint<const N: usize> {
    /// Position, world axes, m.
    pub place_m: Vector3<f64>,
    /// Derivative of the position by each axis, m per unit of `q`.
    pub slopes: [Vector3<f64>; N],
}

/// Returns the joint of `link` (from 0, link order) with the axes at `q`: cart `C_i + q_i V_i`,
/// plate 2 turned by `Rot(ax, sigma4 q_4)`, plate 3 by `Rot(ax, sigma5 q_5) Rot(ax6, q_6)`
/// `[T 3.1.2]`. A machine of three axes keeps its plates at 0.
#[must_use]
pub fn joint<const N: usize>(geometry: &f1::Geometry, link: usize, q: &[f64; N]) -> Joint<N> {
    Plate::of(&TurnAxes::of(geometry), ARM_OF_LINK[link], q)
        .corner(geometry, link, q)
        .joint()
}

/// Returns the joints of all links, link order, as [`joint`] does.
#[must_use]
pub fn joints<const N: usize>(geometry: &f1::Geometry, q: &[f64; N]) -> [Joint<N>; LINKS] {
    let plates = plates(&TurnAxes::of(geometry), q);
    std::array::from_fn(|link| plates[ARM_OF_LINK[link]].corner(geometry, link, q).joint())
}

/// Returns the plates of all arms.
pub(super) fn plates<const N: usize>(turn_axes: &TurnAxes, q: &[f64; N]) -> [Plate; ARMS] {
    std::array::from_fn(|arm| Plate::of(turn_axes, arm, q))
}

/// Returns the accelerations of the joints of all links, link order, with the axes at `q` and moving
/// at these rates, none of which changes: those of plates' joints on their way round, m/s^2.
#[must_use]
pub fn centripetal_m_per_s2<const N: usize>(
    geometry: &f1::Geometry,
    q: &[f64; N],
    rates: &SVector<f64, N>,
) -> [Vector3<f64>; LINKS] {
    let motions = plates(&TurnAxes::of(geometry), q).map(|plate| (plate.spin(rates), plate));
    std::array::from_fn(|link| {
        let ((spin, carried), plate) = &motions[ARM_OF_LINK[link]];
        let lever_m = plate.rotation * geometry.plate_joints_m[link];
        spin.cross(&spin.cross(&lever_m)) + carried.cross(&lever_m)
    })
}

/// Directions that `q_4` to `q_6` turn plates about, with the signs of their turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TurnAxes([(Unit<Vector3<f64>>, f64); 3]);

impl TurnAxes {
    pub(super) fn of(geometry: &f1::Geometry) -> Self {
        let [turn, tilt] = [geometry.turn_axis, geometry.tilt_axis].map(Unit::new_normalize);
        let [q4, q5] = geometry.turn_signs.map(|sign| sign.sign());
        Self([(turn, q4), (turn, q5), (tilt, 1.0)])
    }
}

/// Largest number of axes that turn one plate.
const MAX_TURNS: usize = 2;

/// The plate of an arm.
pub(super) struct Plate {
    rotation: Rotation3<f64>,
    /// Turn by each of its axes, in their order, world axes, rad per unit of `q`; zero where there
    /// are fewer.
    turns: [Vector3<f64>; MAX_TURNS],
    arm: usize,
}

/// The joint of a link on its plate.
pub(super) struct Corner<'a> {
    plate: &'a Plate,
    guideway: Vector3<f64>,
    /// From the plate's origin, world axes, m.
    lever_m: Vector3<f64>,
    /// Position, world axes, m.
    pub(super) place_m: Vector3<f64>,
}

impl Corner<'_> {
    /// Returns the derivative of the position by an axis, m per unit of `q`; `None` if the axis does
    /// not move it.
    #[inline]
    pub(super) fn slope(&self, axis: usize) -> Option<Vector3<f64>> {
        if axis == self.plate.arm {
            return Some(self.guideway);
        }
        turn_of_plate(self.plate.arm, axis).map(|turn| self.plate.turns[turn].cross(&self.lever_m))
    }

    fn joint<const N: usize>(&self) -> Joint<N> {
        Joint {
            place_m: self.place_m,
            slopes: std::array::from_fn(|axis| self.slope(axis).unwrap_or_default()),
        }
    }
}

impl Plate {
    /// Returns the joint of one of its links.
    #[inline]
    pub(super) fn corner<const N: usize>(
        &self,
        geometry: &f1::Geometry,
        link: usize,
        q: &[f64; N],
    ) -> Corner<'_> {
        let guideway = geometry.guideways[self.arm];
        let lever_m = self.rotation * geometry.plate_joints_m[link];
        Corner {
            plate: self,
            guideway,
            lever_m,
            place_m: geometry.carts_m[self.arm] + guideway * q[self.arm] + lever_m,
        }
    }

    fn of<const N: usize>(turn_axes: &TurnAxes, arm: usize, q: &[f64; N]) -> Self {
        let mut plate = Self {
            rotation: Rotation3::identity(),
            turns: [Vector3::zeros(); MAX_TURNS],
            arm,
        };
        let turning = (Q4..).zip(q.iter().skip(Q4)).zip(&turn_axes.0);
        for ((axis, angle), (about, sign)) in turning {
            let Some(turn) = turn_of_plate(arm, axis) else {
                continue;
            };
            let rotation = Rotation3::from_axis_angle(about, sign * angle);
            let about = about.into_inner() * *sign;
            // A later axis is carried by those before it; the first of a plate by none.
            (plate.turns[turn], plate.rotation) = if turn == 0 {
                (about, rotation)
            } else {
                (plate.rotation * about, plate.rotation * rotation)
            };
        }
        plate
    }

    /// Returns its angular velocity at these rates of the axes (rad/s), and the derivative of
    /// that while none of the rates changes: a later axis is carried by those before it. World axes.
    fn spin<const N: usize>(&self, rates: &SVector<f64, N>) -> (Vector3<f64>, Vector3<f64>) {
        let (mut spin, mut carried) = (Vector3::zeros(), Vector3::zeros());
        for (axis, rate) in rates.iter().enumerate() {
            if let Some(turn) = turn_of_plate(self.arm, axis) {
                let own = self.turns[turn] * *rate;
                carried += spin.cross(&own);
                spin += own;
            }
        }
        (spin, carried)
    }
}

/// Returns the place of an axis among those that turn the plate of an arm; `None` if it does not.
const fn turn_of_plate(arm: usize, axis: usize) -> Option<usize> {
    match (arm, axis) {
        (1, Q4) | (2, Q5) => Some(0),
        (2, Q6) => Some(1),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gantry_tau_test_support::vectors::Vectors;

    /// The slopes against differences: those of a rotation by 1e-5 rad leave 1e-10 of the lever.
    #[test]
    fn slopes_are_the_differences_of_places() {
        let geometry = Vectors::f1().geometry;
        let q = [1.5, 1.7, 1.6, 0.11, -0.07, 0.05];
        for link in 0..LINKS {
            let here = joint(&geometry, link, &q);
            for axis in 0..q.len() {
                let [behind, ahead] = [-1e-5, 1e-5].map(|step| {
                    let mut moved = q;
                    moved[axis] += step;
                    joint(&geometry, link, &moved).place_m
                });
                let difference = (ahead - behind) / 2e-5;
                let off = (difference - here.slopes[axis]).amax();
                assert!(off < 1e-9, "link {link}, axis {axis}: {off:e}");
            }
        }
    }

    /// Against the second difference along a way at constant rates, of 1e-4 s: the fourth
    /// derivative leaves 1e-8, rounding 1e-16 m / 1e-8 s^2.
    #[test]
    fn at_constant_rates_a_joint_accelerates_towards_its_axis() {
        let geometry = Vectors::f1().geometry;
        let q = [1.5, 1.7, 1.6, 0.11, -0.07, 0.05];
        let rates = SVector::from([0.3, -0.2, 0.4, 1.3, -0.8, 1.1]);
        let found = centripetal_m_per_s2(&geometry, &q, &rates);
        for (link, found) in found.iter().enumerate() {
            let [behind, here, ahead] = [-1e-4, 0.0, 1e-4].map(|s| {
                let at: [f64; 6] = std::array::from_fn(|axis| q[axis] + s * rates[axis]);
                joint(&geometry, link, &at).place_m
            });
            let difference = (ahead - here * 2.0 + behind) / 1e-8;
            let off = (difference - found).amax();
            assert!(off < 1e-6, "link {link}: {off:e}");
        }
    }
}
