//! Equations of motion: mass matrix, velocity terms, springs, weight.

use gantry_tau_core::model::robot::{ARMS, LINKS};
use nalgebra::{Matrix6, SMatrix, SVector, UnitQuaternion, Vector3, Vector6};

use super::coordinates::{CoordinateMatrix, Coordinates, PointJacobian};
use crate::accelerometer::Accelerometer;
use crate::elastic::backlash::Backlash;
use crate::elastic::joints::{Joint, centripetal_m_per_s2, joints};
use crate::elastic::{ElasticMachine, Pose};
use crate::masses::{GRAVITY_M_PER_S2, Masses, RigidBody};
use crate::model::MachineKind;
use crate::robot_file::RobotFile;

/// Place and rates of a machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<const N: usize> {
    /// The platform.
    pub pose: Pose,
    /// The axes behind their springs, q-units.
    pub axes: [f64; N],
    /// Rates of both.
    pub rates: Coordinates<N>,
}

/// A machine with springs and masses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassiveMachine<const N: usize> {
    /// Geometry and springs.
    pub elastic: ElasticMachine<N>,
    /// Masses.
    pub masses: Masses<N>,
    /// Accelerometer by which a client takes the tool's inertia out of the measured load, if there
    /// is one.
    pub accelerometer: Option<Accelerometer>,
}

/// Motion of a machine under its springs and a load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acceleration<const N: usize> {
    /// Derivatives of the rates.
    pub rates: Coordinates<N>,
    /// Tensions of the links, N, link order.
    pub tensions_n: Vector6<f64>,
    /// Load that a force sensor with a known weight finds, about the tool centre point, world axes:
    /// the load on the tool less what the tool's motion takes.
    pub sensor_load: Vector6<f64>,
}

/// A link in one place: its ends.
struct LinkEnds<const N: usize> {
    joint: Joint<N>,
    /// The platform's joint from the tool centre point, world axes, m.
    lever_m: Vector3<f64>,
}

impl<const N: usize> LinkEnds<N> {
    /// Jacobians of the joint on cart or plate, and of that on the platform.
    fn jacobians(&self) -> [PointJacobian<N>; 2] {
        [
            PointJacobian::on_axes(&self.joint.slopes),
            PointJacobian::on_platform(&self.lever_m),
        ]
    }
}

impl<const N: usize> MassiveMachine<N> {
    /// Machine of a robot file, its joints without play. `None` without compliances or masses.
    #[must_use]
    pub fn of<K: MachineKind<N>>(robot: &RobotFile<K, N>) -> Option<Self> {
        Some(Self {
            elastic: ElasticMachine::new(
                robot.model.geometry(),
                robot.compliances?,
                Backlash::NONE,
            ),
            masses: robot.masses?,
            accelerometer: robot.sensor.accelerometer.map(Accelerometer::from),
        })
    }

    /// Returns the mass matrix of the tool about the tool centre point, world axes, as far as no
    /// accelerometer takes it out of the measured load.
    #[must_use]
    pub fn felt_tool(&self, rotation: &UnitQuaternion<f64>) -> Matrix6<f64> {
        let tool = &self.masses.tool;
        let whole = tool.mass_matrix(rotation);
        match &self.accelerometer {
            Some(accelerometer) => whole - accelerometer.found_mass(tool, rotation),
            None => whole,
        }
    }

    fn links(&self, pose: &Pose, axes: &[f64; N]) -> [LinkEnds<N>; LINKS] {
        let geometry = self.elastic.geometry();
        let rotation = pose.rotation.to_rotation_matrix();
        let mut link = 0;
        joints(geometry, axes).map(|joint| {
            let lever_m = rotation * geometry.platform_joints_m[link];
            link += 1;
            LinkEnds { joint, lever_m }
        })
    }

    fn bodies(&self) -> [&RigidBody; 2] {
        [&self.masses.platform, &self.masses.tool]
    }

    /// Returns the mass matrix with the machine in this place.
    ///
    /// A uniform rod has `m/3 (J_A^T J_A + J_B^T J_B) + m/6 (J_A^T J_B + J_B^T J_A)` of the
    /// Jacobians of its ends, which is exact.
    #[must_use]
    pub fn mass_matrix(&self, pose: &Pose, axes: &[f64; N]) -> CoordinateMatrix<N> {
        let mut matrix = CoordinateMatrix::zeros();
        for body in self.bodies() {
            matrix.platform += body.mass_matrix(&pose.rotation);
        }
        for (link, mass_kg) in self.links(pose, axes).iter().zip(&self.masses.links_kg) {
            let [on_axes, on_platform] = link.jacobians();
            matrix.add_product(mass_kg / 3.0, &on_axes, &on_axes);
            matrix.add_product(mass_kg / 3.0, &on_platform, &on_platform);
            matrix.add_product(mass_kg / 3.0, &on_axes, &on_platform);
        }
        for (axis, inertia) in self.axis_inertia().iter().enumerate() {
            matrix.axes[(axis, axis)] += inertia;
        }
        matrix
    }

    /// Inertia of carts (along their guideways) and plates alone, in q-units of the axes.
    fn axis_inertia(&self) -> SVector<f64, N> {
        SVector::from_fn(|axis, _| {
            if axis < ARMS {
                let guideway = self.elastic.geometry().guideways[axis];
                self.masses.carts_kg[axis] * guideway.norm_squared()
            } else {
                self.masses.plates_kgm2[axis - ARMS]
            }
        })
    }

    /// Returns `h`: the forces that the motion takes at constant rates.
    #[must_use]
    pub fn velocity_forces(&self, state: &State<N>) -> Coordinates<N> {
        let omega = state.rates.platform.fixed_rows::<3>(3).into_owned();
        let mut forces = Coordinates::zeros();
        for body in self.bodies() {
            forces.platform += body.inertial_load(&state.pose.rotation, &Vector6::zeros(), &omega);
        }
        let links = self.links(&state.pose, &state.axes);
        for (link, (ends, mass_kg)) in links.iter().zip(&self.masses.links_kg).enumerate() {
            let of_platform = omega.cross(&omega.cross(&ends.lever_m));
            let of_axes = centripetal_m_per_s2(
                self.elastic.geometry(),
                link,
                &state.axes,
                &state.rates.axes,
            );
            let [on_axes, on_platform] = ends.jacobians();
            let (third, sixth) = (mass_kg / 3.0, mass_kg / 6.0);
            forces += on_axes.forces(&(of_axes * third + of_platform * sixth));
            forces += on_platform.forces(&(of_axes * sixth + of_platform * third));
        }
        forces
    }

    /// Returns the weight of all parts; zero of a machine without it.
    #[must_use]
    pub fn weight(&self, pose: &Pose, axes: &[f64; N]) -> Coordinates<N> {
        let mut forces = Coordinates::zeros();
        if !self.masses.has_weight {
            return forces;
        }
        let field = Vector3::new(0.0, 0.0, -GRAVITY_M_PER_S2);
        for body in self.bodies() {
            forces.platform += body.weight(&pose.rotation, &field);
        }
        for (link, mass_kg) in self.links(pose, axes).iter().zip(&self.masses.links_kg) {
            for end in link.jacobians() {
                forces += end.forces(&(field * (mass_kg / 2.0)));
            }
        }
        for arm in 0..ARMS {
            let guideway = self.elastic.geometry().guideways[arm];
            forces.axes[arm] += self.masses.carts_kg[arm] * guideway.dot(&field);
        }
        forces
    }

    /// Returns the tensions of the links, N, and the forces of springs along the coordinates, with
    /// the drives at `drives` (q-units): `W f` and `-D^T f - (q - theta) / c`. Joints have no play.
    #[must_use]
    pub fn spring_forces(
        &self,
        pose: &Pose,
        axes: &[f64; N],
        drives: &[f64; N],
    ) -> (Vector6<f64>, Coordinates<N>) {
        let lines = self.elastic.lines(&SVector::from(*axes), pose);
        let compliances = self.elastic.compliances();
        let tensions_n = Vector6::from_fn(|link, _| {
            let stretched_m = lines.lengths_m[link] - self.elastic.geometry().lengths_m[link];
            stretched_m / compliances.links_m_per_n[link]
        });
        let of_axes = SVector::<f64, N>::from_fn(|axis, _| {
            (axes[axis] - drives[axis]) / compliances.axes[axis]
        });
        let forces = Coordinates {
            platform: lines.matrix * tensions_n,
            axes: -(lines.drives.transpose() * tensions_n) - of_axes,
        };
        (tensions_n, forces)
    }

    /// Returns the motion with the drives at `drives` (q-units) under a load on the platform (N,
    /// N m about the tool centre point, world axes), without damping. `None` for masses that no
    /// body has.
    #[must_use]
    pub fn acceleration(
        &self,
        state: &State<N>,
        drives: &[f64; N],
        load: &Vector6<f64>,
    ) -> Option<Acceleration<N>> {
        let State { pose, axes, rates } = state;
        let (tensions_n, springs) = self.spring_forces(pose, axes, drives);
        let mut forces = springs + self.weight(pose, axes) - self.velocity_forces(state);
        forces.platform += load;
        let changes = self.mass_matrix(pose, axes).solve(&forces)?;
        let omega = rates.platform.fixed_rows::<3>(3).into_owned();
        let taken = self
            .masses
            .tool
            .inertial_load(&pose.rotation, &changes.platform, &omega);
        Some(Acceleration {
            rates: changes,
            tensions_n,
            sensor_load: load - taken,
        })
    }

    /// Returns the elongations of the links by the rates of the coordinates: `[-W^T, D]`, 6 x 6 and
    /// 6 x N.
    pub(super) fn elongations(
        &self,
        pose: &Pose,
        axes: &[f64; N],
    ) -> (SMatrix<f64, LINKS, 6>, SMatrix<f64, LINKS, N>) {
        let lines = self.elastic.lines(&SVector::from(*axes), pose);
        (-lines.matrix.transpose(), lines.drives)
    }
}
