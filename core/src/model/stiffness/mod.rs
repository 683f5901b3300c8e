//! From compliances to displacement `[T 3.3.1]`.
//!
//! Every link and every cart is a spring. The thesis sums `k s s^T` at the cart joints about the origin `[T 3.14, 3.15]` and
//! forbids the platform to turn; here moments are taken about the tool centre point and the platform is free to turn.
//! Displacements are small: first order in the load.

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
    /// `C_tt`: translation of the tool centre point per force at it, m/N. Not the inverse of the stiffness' block, which is that
    /// of a platform kept from turning.
    #[must_use]
    pub fn translation(&self) -> Matrix3<f64> {
        self.0.fixed_view::<3, 3>(0, 0).into_owned()
    }
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
