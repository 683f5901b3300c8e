//! From compliances to displacement `[T 3.3.1]`.
//!
//! Every link and every cart is a spring. The thesis sums `k s s^T` at the cart joints about the
//! origin `[T 3.14, 3.15]` and forbids the platform to turn; here moments are taken about the tool
//! centre point and the platform is free to turn. Displacements are small: first order in the load.

mod contact;

pub use contact::contact_loop_gain;

use nalgebra::{Matrix3, Matrix6, Vector3};

use crate::model::kinematics::KinematicsError;
use crate::model::robot::{Compliances, LINKS};
use crate::model::statics::{LineMatrix, Wrench, finite};

/// Displacement of the platform: its tool centre point, and its small rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Displacement {
    /// `dT`, world axes, m.
    pub translation_m: Vector3<f64>,
    /// `dtheta`, rotation vector, world axes, rad.
    pub rotation_rad: Vector3<f64>,
}

impl Displacement {
    fn from_array([x, y, z, a, b, c]: [f64; 6]) -> Self {
        Self {
            translation_m: Vector3::new(x, y, z),
            rotation_rad: Vector3::new(a, b, c),
        }
    }

    /// Translation (m) then rotation (rad).
    #[must_use]
    pub fn to_array(&self) -> [f64; 6] {
        let (t, r) = (&self.translation_m, &self.rotation_rad);
        [t.x, t.y, t.z, r.x, r.y, r.z]
    }
}

/// Displacement (m, rad) per load (N, N m), world axes, about the tool centre point: `dx = C w`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compliance(pub Matrix6<f64>);

impl Compliance {
    /// `C_tt`: translation of the tool centre point per force at it, m/N. Not the inverse of the
    /// stiffness' block, which is that of a platform kept from turning.
    #[must_use]
    pub fn translation(&self) -> Matrix3<f64> {
        self.0.fixed_view::<3, 3>(0, 0).into_owned()
    }
}

/// Deflection of the machine under a load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deflection<const N: usize> {
    /// `r = c tau`: displacement of each axis, q-units, axis order `[T 3.29]`.
    pub carts: [f64; N],
    /// `dx_links`: displacement of the platform by the links alone.
    pub links: Displacement,
    /// `dx_total = C w`: links and carts together.
    pub total: Displacement,
}

/// Springs under a load.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Yielding<const N: usize> {
    /// `r`: displacement of each axis, q-units.
    pub(crate) carts: [f64; N],
    /// `e`: elongation of each link, metres.
    pub(crate) elongations_m: [f64; LINKS],
}

impl<const N: usize> LineMatrix<N> {
    /// Returns the deflection by `load`: `e = c f`, `r = c tau`, `W^T dx_links = -e`,
    /// `W^T dx_total = D r - e`.
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`].
    ///
    /// # Examples
    /// ```
    /// use gantry_tau_core::model::nalgebra::{Matrix3, Vector3};
    /// use gantry_tau_core::model::statics::Wrench;
    /// use gantry_tau_core::model::{l2, presets};
    ///
    /// let robot = l2::Robot::new(presets::l2())?;
    /// let kinematics = l2::Kinematics::new(&robot, &Matrix3::identity())?;
    /// let pose = kinematics.pose(Vector3::new(0.0, 0.5, 0.65));
    /// let q = kinematics.inverse(&pose.position_m)?;
    /// let lines = kinematics.line_matrix(&pose, &q)?;
    /// let load = Wrench::from_array([300.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    /// let deflection = lines.deflection(&presets::l2_compliances(), &load)?;
    /// // The platform yields in the direction of the load, by tenths of a millimetre.
    /// assert!(deflection.total.translation_m.x > 1e-4);
    /// # Ok::<(), Box<dyn core::error::Error>>(())
    /// ```
    pub fn deflection(
        &self,
        compliances: &Compliances<N>,
        load: &Wrench,
    ) -> Result<Deflection<N>, KinematicsError> {
        let Yielding {
            carts,
            elongations_m,
        } = self.yielding(compliances, load)?;
        Ok(Deflection {
            carts,
            links: self.displacement_by_links(&elongations_m)?,
            total: Displacement::from_array(self.displacement(&carts, &elongations_m)?),
        })
    }

    /// Returns `e = c f` and `r = c tau` under `load`.
    #[inline]
    pub(crate) fn yielding(
        &self,
        compliances: &Compliances<N>,
        load: &Wrench,
    ) -> Result<Yielding<N>, KinematicsError> {
        let forces = self.link_forces_n(load)?;
        let mut elongations_m = forces;
        for (value, compliance) in elongations_m.iter_mut().zip(compliances.link_m_per_n()) {
            *value *= compliance;
        }
        let mut carts = self.cart_loads(&forces);
        for (value, compliance) in carts.iter_mut().zip(compliances.cart_m_per_n()) {
            *value *= compliance;
        }
        Ok(Yielding {
            carts: finite(carts)?,
            elongations_m,
        })
    }

    /// Returns `dx_links` of `W^T dx_links = -e`.
    #[inline]
    pub(crate) fn displacement_by_links(
        &self,
        elongations_m: &[f64; LINKS],
    ) -> Result<Displacement, KinematicsError> {
        Ok(Displacement::from_array(
            self.solve(&elongations_m.map(|elongation| -elongation))?,
        ))
    }

    /// Returns the compliance of links and carts, `W^-T (C_link + D C_cart D^T) W^-1`.
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`].
    pub fn compliance(&self, compliances: &Compliances<N>) -> Result<Compliance, KinematicsError> {
        let mut columns: [[f64; 6]; 6] = Matrix6::identity().into();
        for column in &mut columns {
            let load = Wrench::from_array(*column);
            *column = self.deflection(compliances, &load)?.total.to_array();
        }
        Ok(Compliance(Matrix6::from(columns)))
    }
}

const _: () = assert!(LINKS == 6, "displacements and link forces share a size");

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::model::kinematics::Pose;
    use crate::model::linalg::rotation_from_vector;
    use nalgebra::Vector6;

    /// Returns the elastic machine's pose under a command, by Newton with differences over the
    /// pose: every axis where its own load leaves it, every link as long as its own force makes it.
    /// Nothing of the maps that are tested.
    ///
    /// `lines` are those of a pose and positions, `too_long` is each link's distance of joints less
    /// its length.
    pub(crate) fn stands<const N: usize>(
        lines: impl Fn(&Pose, &[f64; N]) -> LineMatrix<N>,
        too_long: impl Fn(&Pose, &[f64; N]) -> [f64; LINKS],
        springs: &Compliances<N>,
        command: &[f64; N],
        load: &Wrench,
        near: &Pose,
    ) -> Pose {
        let mut pose = *near;
        for _ in 0..8 {
            let now = errors(&lines, &too_long, springs, command, load, &pose);
            let derivative = Matrix6::from_fn(|row, column| {
                let mut dx = Vector6::zeros();
                dx[column] = 1e-7;
                let there = moved(&pose, &dx);
                let there = errors(&lines, &too_long, springs, command, load, &there);
                (there[row] - now[row]) / 1e-7
            });
            pose = moved(&pose, &-(derivative.try_inverse().unwrap() * now));
        }
        pose
    }

    /// Link length errors at a pose, metres: zero in the elastic machine's pose.
    fn errors<const N: usize>(
        lines: &impl Fn(&Pose, &[f64; N]) -> LineMatrix<N>,
        too_long: &impl Fn(&Pose, &[f64; N]) -> [f64; LINKS],
        springs: &Compliances<N>,
        command: &[f64; N],
        load: &Wrench,
        pose: &Pose,
    ) -> Vector6<f64> {
        // The axes yield by r, which depends on where they are: a few rounds are enough.
        let mut q = *command;
        for _ in 0..20 {
            let lines = lines(pose, &q);
            let loads = lines.cart_loads(&lines.link_forces_n(load).unwrap());
            for axis in 0..N {
                q[axis] = command[axis] + springs.cart_m_per_n()[axis] * loads[axis];
            }
        }
        let forces = lines(pose, &q).link_forces_n(load).unwrap();
        let too_long = too_long(pose, &q);
        Vector6::from_fn(|i, _| too_long[i] - springs.link_m_per_n()[i] * forces[i])
    }

    /// The pose after a displacement `dx`: metres, radians, world axes.
    fn moved(pose: &Pose, dx: &Vector6<f64>) -> Pose {
        let rotation_rad = dx.fixed_rows::<3>(3).into_owned();
        Pose {
            position_m: pose.position_m + dx.fixed_rows::<3>(0),
            rotation: rotation_from_vector(&rotation_rad).unwrap() * pose.rotation,
        }
    }
}
