//! A machine and its wrist under a load, against where they were without it.

use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::model::stiffness::Displacement;
use nalgebra::{DMatrix, UnitQuaternion, Vector3, Vector6};

use super::gauge::{Body, Gauge};
use crate::elastic::{ElasticMachine, Equilibrium, Pose, Transmission};
use crate::model::Wrist;

/// A machine and its wrist under a load.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded<const N: usize> {
    /// Links and axes.
    pub machine: ElasticMachine<N>,
    /// Joints between platform and tool, at the angles of the series.
    pub wrist: Wrist,
    /// Pose of the platform without a load, when the series began.
    pub began: Pose,
    /// Equilibrium under the load.
    pub now: Equilibrium<N>,
    /// Load, about the tool centre point, world axes; N, N m.
    pub load: Vector6<f64>,
}

impl<const N: usize> Loaded<N> {
    /// Pose of a body under the load. Without one the platform's is the tool's.
    #[must_use]
    pub fn pose(&self, body: Body) -> Pose {
        let platform = self.now.pose;
        if body == Body::Platform || self.wrist.is_rigid() {
            return platform;
        }
        let Displacement {
            translation_m,
            rotation_rad,
        } = self.given();
        Pose {
            translation_m: platform.translation_m + translation_m,
            rotation: UnitQuaternion::from_scaled_axis(rotation_rad) * platform.rotation,
        }
    }

    /// Displacement of the tool against the platform.
    fn given(&self) -> Displacement {
        let rotation = self.now.pose.rotation.to_rotation_matrix().into_inner();
        self.wrist
            .displacement(&rotation, &Wrench::from_array(self.load.into()))
    }

    /// Axes of the wrist's joints as lines, as of [`Wrist::lines`].
    #[must_use]
    pub fn wrist_lines(&self) -> Vec<Vector6<f64>> {
        self.wrist
            .lines(&self.now.pose.rotation.to_rotation_matrix().into_inner())
            .collect()
    }

    /// Displacement of the tool since the series began, world axes.
    #[must_use]
    pub fn displacement(&self) -> Displacement {
        let Pose {
            translation_m,
            rotation,
        } = self.pose(Body::Tool);
        Displacement {
            translation_m: translation_m - self.began.translation_m,
            rotation_rad: (rotation * self.began.rotation.inverse()).scaled_axis(),
        }
    }

    /// Derivatives of the translation of the tool by the compliances: 3 rows, one column per
    /// spring; `through` is how loads go through the machine in the equilibrium.
    #[must_use]
    pub fn displacement_by_springs(&self, through: &Transmission<N>) -> DMatrix<f64> {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let rows = axes.map(|axis| {
            let gauge = Gauge::Face {
                body: Body::Tool,
                point_m: Vector3::zeros(),
                axis,
            };
            gauge
                .read(self)
                .derivatives(self, through)
                .springs
                .transpose()
        });
        DMatrix::from_rows(&rows)
    }
}
