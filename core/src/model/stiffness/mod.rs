//! From compliances to displacement `[T 3.3.1]`.
//!
//! Every link and every cart is a spring. The thesis sums `k s s^T` at the cart joints about the origin `[T 3.14, 3.15]` and
//! forbids the platform to turn; here moments are taken about the tool centre point and the platform is free to turn.
//! Displacements are small: first order in the load.

mod contact;
mod reference_point;

pub use contact::contact_loop_gain;

use nalgebra::{Matrix6, Vector3};

use crate::model::kinematics::KinematicsError;
use crate::model::linalg::Lu;
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

/// Load (N, N m) per displacement (m, rad), world axes, about the tool centre point: `w = K dx`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiffness(pub Matrix6<f64>);

impl Compliance {
    /// Returns `dx = C w`.
    #[must_use]
    pub fn displacement(&self, load: &Wrench) -> Displacement {
        let dx = self.0 * nalgebra::Vector6::from(load.to_array());
        let (t, r) = (dx.fixed_rows::<3>(0), dx.fixed_rows::<3>(3));
        Displacement {
            translation_m: t.into_owned(),
            rotation_rad: r.into_owned(),
        }
    }

    /// Returns `K = C^-1`. For the compliance of the translation use the block of `C`; the inverse of `K`'s block is that of
    /// a platform that is kept from turning.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`], `NotFinite`.
    pub fn to_stiffness(&self) -> Result<Stiffness, KinematicsError> {
        inverse(&self.0).map(Stiffness)
    }
}

impl Stiffness {
    /// Returns `C = K^-1`.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`], `NotFinite`.
    pub fn to_compliance(&self) -> Result<Compliance, KinematicsError> {
        inverse(&self.0).map(Compliance)
    }
}

fn inverse(matrix: &Matrix6<f64>) -> Result<Matrix6<f64>, KinematicsError> {
    // Columns of the transpose are rows.
    let rows: [[f64; 6]; 6] = matrix.transpose().into();
    let factors = Lu::factor(&rows)?;
    from_columns(|unit| finite(factors.solve(unit)))
}

/// The matrix whose columns are the images of the unit vectors.
fn from_columns(
    image: impl Fn(&[f64; 6]) -> Result<[f64; 6], KinematicsError>,
) -> Result<Matrix6<f64>, KinematicsError> {
    let mut columns: [[f64; 6]; 6] = Matrix6::identity().into();
    for column in &mut columns {
        *column = image(column)?;
    }
    Ok(Matrix6::from(columns))
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

impl<const N: usize> LineMatrix<N> {
    /// Returns the deflection by `load`: `e = c f`, `r = c tau`, `W^T dx_links = -e`, `W^T dx_total = D r - e`.
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
        let forces = self.link_forces_n(load)?;
        let mut elongations = forces;
        for (value, compliance) in elongations.iter_mut().zip(compliances.link_m_per_n()) {
            *value *= compliance;
        }
        let mut carts = self.cart_loads(&forces);
        for (value, compliance) in carts.iter_mut().zip(compliances.cart_m_per_n()) {
            *value *= compliance;
        }
        let links = self.displacement(&[0.0; N], &elongations)?;
        let total = self.displacement(&carts, &elongations)?;
        Ok(Deflection {
            carts: finite(carts)?,
            links: Displacement::from_array(links),
            total: Displacement::from_array(total),
        })
    }

    /// Returns the compliance of the links alone, `W^-T C_link W^-1`.
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`].
    pub fn link_compliance(
        &self,
        compliances: &Compliances<N>,
    ) -> Result<Compliance, KinematicsError> {
        from_columns(|unit| {
            let load = Wrench::from_array(*unit);
            Ok(self.deflection(compliances, &load)?.links.to_array())
        })
        .map(Compliance)
    }

    /// Returns the compliance of links and carts, `W^-T (C_link + D C_cart D^T) W^-1`.
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`].
    pub fn compliance(&self, compliances: &Compliances<N>) -> Result<Compliance, KinematicsError> {
        from_columns(|unit| {
            let load = Wrench::from_array(*unit);
            Ok(self.deflection(compliances, &load)?.total.to_array())
        })
        .map(Compliance)
    }
}

const _: () = assert!(LINKS == 6, "displacements and link forces share a size");

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::kinematics::Pose;
    use crate::model::l2::Robot;
    use crate::model::l2::tests::{close, compliances, geometry, l2};

    #[test]
    fn stiffness_and_compliance_are_inverses() {
        let robot = Robot::new(geometry()).unwrap();
        for position in [[0.0, 0.5, 0.65], [0.3, 0.4, 0.6], [-0.3, 0.55, 0.8]] {
            let tcp = position.into();
            let q = l2().inverse(&tcp).unwrap();
            let lines = robot.line_matrix(&Pose::at(tcp), &q).unwrap();
            let compliance = lines.compliance(&compliances()).unwrap();
            let stiffness = compliance.to_stiffness().unwrap();
            let back = stiffness.to_compliance().unwrap();
            close(back.0.as_slice(), compliance.0.as_slice(), 1e-9, "C");
            assert!(stiffness.0.cholesky().is_some(), "positive definite");
        }
        assert!(Compliance(Matrix6::zeros()).to_stiffness().is_err());
    }
}
