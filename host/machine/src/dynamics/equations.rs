//! Equations of motion: mass matrix, velocity terms, springs, weight.

use gantry_tau_core::model::robot::{ARMS, LINKS};
use nalgebra::{Matrix6, SMatrix, SVector, UnitQuaternion, Vector3, Vector6};

use super::coordinates::{CoordinateMatrix, Coordinates};
use crate::accelerometer::Accelerometer;
use crate::elastic::backlash::Backlash;
use crate::elastic::joints::{Joint, centripetal_m_per_s2, joints};
use crate::elastic::{ElasticMachine, Pose};
use crate::masses::{GRAVITY_M_PER_S2, Masses, RigidBody, point_mass_matrix};
use crate::model::MachineKind;
use crate::robot_file::RobotFile;

/// Place and rates of a machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MachineState<const N: usize> {
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
    /// Returns `J_A^T f_A + J_B^T f_B`: the forces along the coordinates of forces on the ends, on
    /// cart or plate and on the platform.
    fn forces(&self, on_axes_n: &Vector3<f64>, on_platform_n: &Vector3<f64>) -> Coordinates<N> {
        let mut forces = Coordinates::<N>::zeros();
        let moment = self.lever_m.cross(on_platform_n);
        forces
            .platform
            .fixed_rows_mut::<3>(0)
            .copy_from(on_platform_n);
        forces.platform.fixed_rows_mut::<3>(3).copy_from(&moment);
        for (force, slope) in forces.axes.iter_mut().zip(&self.joint.slopes) {
            *force = slope.dot(on_axes_n);
        }
        forces
    }

    /// Adds a uniform rod, `m/3 (J_A^T J_A + J_B^T J_B) + m/6 (J_A^T J_B + J_B^T J_A)` of the
    /// Jacobians of its ends, which is exact.
    fn add_rod(&self, mass_kg: f64, matrix: &mut CoordinateMatrix<N>) {
        let (third, sixth) = (mass_kg / 3.0, mass_kg / 6.0);
        matrix.platform += point_mass_matrix(third, &self.lever_m);
        for (axis, slope) in self.joint.slopes.iter().enumerate() {
            let (force, moment) = (slope * sixth, self.lever_m.cross(slope) * sixth);
            for row in 0..3 {
                matrix.cross[(row, axis)] += force[row];
                matrix.cross[(3 + row, axis)] += moment[row];
            }
            for (other, with) in self.joint.slopes.iter().enumerate() {
                matrix.axes[(other, axis)] += slope.dot(with) * third;
            }
        }
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
    #[must_use]
    pub fn mass_matrix(&self, pose: &Pose, axes: &[f64; N]) -> CoordinateMatrix<N> {
        self.mass_matrix_of(&self.links(pose, axes), pose)
    }

    fn mass_matrix_of(&self, links: &[LinkEnds<N>; LINKS], pose: &Pose) -> CoordinateMatrix<N> {
        let mut matrix = CoordinateMatrix::zeros();
        for body in self.bodies() {
            matrix.platform += body.mass_matrix(&pose.rotation);
        }
        for (link, mass_kg) in links.iter().zip(&self.masses.links_kg) {
            link.add_rod(*mass_kg, &mut matrix);
        }
        for (axis, inertia) in self.axis_inertia().iter().enumerate() {
            matrix.axes[(axis, axis)] += inertia;
        }
        matrix
    }

    /// Returns the mass matrix, and the weight less the forces that the motion takes.
    #[must_use]
    pub fn inertia_and_weight(
        &self,
        state: &MachineState<N>,
    ) -> (CoordinateMatrix<N>, Coordinates<N>) {
        let links = self.links(&state.pose, &state.axes);
        let weight = self.weight_of(&links, &state.pose);
        (
            self.mass_matrix_of(&links, &state.pose),
            weight - self.velocity_forces_of(&links, state),
        )
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
    pub fn velocity_forces(&self, state: &MachineState<N>) -> Coordinates<N> {
        self.velocity_forces_of(&self.links(&state.pose, &state.axes), state)
    }

    fn velocity_forces_of(
        &self,
        links: &[LinkEnds<N>; LINKS],
        state: &MachineState<N>,
    ) -> Coordinates<N> {
        let omega = state.rates.platform.fixed_rows::<3>(3).into_owned();
        let mut forces = Coordinates::zeros();
        for body in self.bodies() {
            forces.platform += body.inertial_load(&state.pose.rotation, &Vector6::zeros(), &omega);
        }
        let of_axes = centripetal_m_per_s2(self.elastic.geometry(), &state.axes, &state.rates.axes);
        let parts = links.iter().zip(&self.masses.links_kg).zip(&of_axes);
        for ((ends, mass_kg), of_axes) in parts {
            let of_platform = omega.cross(&omega.cross(&ends.lever_m));
            let (third, sixth) = (mass_kg / 3.0, mass_kg / 6.0);
            forces += ends.forces(
                &(of_axes * third + of_platform * sixth),
                &(of_axes * sixth + of_platform * third),
            );
        }
        forces
    }

    /// Returns the weight of all parts; zero of a machine without it.
    #[must_use]
    pub fn weight(&self, pose: &Pose, axes: &[f64; N]) -> Coordinates<N> {
        self.weight_of(&self.links(pose, axes), pose)
    }

    fn weight_of(&self, links: &[LinkEnds<N>; LINKS], pose: &Pose) -> Coordinates<N> {
        let mut forces = Coordinates::zeros();
        if !self.masses.has_weight {
            return forces;
        }
        let field = Vector3::new(0.0, 0.0, -GRAVITY_M_PER_S2);
        for body in self.bodies() {
            forces.platform += body.weight(&pose.rotation, &field);
        }
        for (link, mass_kg) in links.iter().zip(&self.masses.links_kg) {
            let half_n = field * (mass_kg / 2.0);
            forces += link.forces(&half_n, &half_n);
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
        state: &MachineState<N>,
        drives: &[f64; N],
        load: &Vector6<f64>,
    ) -> Option<Acceleration<N>> {
        let MachineState { pose, axes, rates } = state;
        let (tensions_n, springs) = self.spring_forces(pose, axes, drives);
        let (masses, free) = self.inertia_and_weight(state);
        let mut forces = springs + free;
        forces.platform += load;
        let changes = masses.solve(&forces)?;
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
