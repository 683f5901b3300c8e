//! Platform, links and axes with mass, behind the springs of their drives.
//!
//! Symplectic Euler with the steps of the drives: all forces from the places and rates before, then
//! the rates, then the places. Springs act at the deflected place in every step; masses, weight and
//! the forces of the motion are those at the beginning of a cycle. Damping is that of the modes
//! ([`gantry_tau_machine::dynamics::Modes::damping`]), and acts on what bends only, so that it does
//! not brake a path.
//!
//! The springs' lengths at rest are those with which the machine stands at home, with its tool and
//! without a load, where the rigid machine stands: a calibration does that. Away from home the
//! change of its sag is a displacement.

use gantry_tau_machine::dynamics::coordinates::{product, transposed_product};
use gantry_tau_machine::dynamics::{
    CoordinateMatrix, Coordinates, MachineState, MassiveMachine, Modes,
};
use gantry_tau_machine::elastic::{ElasticMachine, Equilibrium, Pose};
use gantry_tau_machine::masses::Masses;
use nalgebra::{SMatrix, SVector, UnitQuaternion, Vector3, Vector6};

use super::workpiece::Workpiece;
use gantry_tau_machine::drive_cascade::SUBSTEP_S;

/// Way of an axis after which modes and damping are computed again, q-units.
const MOVED: f64 = 1e-2;

/// Motors of the axes: q-units, and per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motors<const N: usize> {
    /// Places.
    pub places: [f64; N],
    /// Rates.
    pub rates: [f64; N],
}

/// A machine in motion.
#[derive(Clone, Debug)]
pub struct MovingPlatform<const N: usize> {
    machine: MassiveMachine<N>,
    state: MachineState<N>,
    /// Tensions of the links by the weight at home, N.
    links_at_home_n: Vector6<f64>,
    /// Loads of the axes by it, along `+q`.
    axes_at_home: SVector<f64, N>,
    damping: Damping<N>,
    /// Inverse of the mass matrix.
    mobility: CoordinateMatrix<N>,
    /// Weight less the forces of the motion.
    free: Coordinates<N>,
    /// Of the last step.
    load: Vector6<f64>,
    tensions_n: Vector6<f64>,
    axis_loads: SVector<f64, N>,
    accelerations: Vector6<f64>,
    /// At the beginning of the last step: orientation of the platform, and its angular velocity.
    turning: (UnitQuaternion<f64>, Vector3<f64>),
}

/// Damping of what bends about one place.
#[derive(Clone, Debug)]
struct Damping<const N: usize> {
    axes: [f64; N],
    matrix: CoordinateMatrix<N>,
    /// `G = W^-T D`: rates of the platform by those of the drives with stiff springs, 6 x N.
    motion: SMatrix<f64, 6, N>,
}

impl<const N: usize> Damping<N> {
    fn at(machine: &MassiveMachine<N>, pose: &Pose, axes: &[f64; N]) -> Option<Self> {
        Some(Self {
            axes: *axes,
            matrix: Modes::of(machine, pose, axes)?.damping(machine.masses.damping_ratio),
            motion: machine.rigid_motion(pose, axes)?,
        })
    }

    fn has_moved(&self, axes: &[f64; N]) -> bool {
        (self.axes.iter().zip(axes)).any(|(before, now)| (now - before).abs() >= MOVED)
    }

    /// Returns the forces on the machine, and on the drives along `+q`.
    fn forces(
        &self,
        rates: &Coordinates<N>,
        drive_rates: &SVector<f64, N>,
    ) -> (Coordinates<N>, SVector<f64, N>) {
        let rigid = Coordinates {
            platform: product(&self.motion, drive_rates),
            axes: *drive_rates,
        };
        let braking = self.matrix.times(&(*rates - rigid));
        let on_drives = transposed_product(&self.motion, &braking.platform) + braking.axes;
        (braking * -1.0, on_drives)
    }
}

impl<const N: usize> MovingPlatform<N> {
    /// Machine at rest where its springs, without masses, are in equilibrium. `None` where it has
    /// no modes.
    #[must_use]
    pub fn at_rest(
        elastic: ElasticMachine<N>,
        masses: Masses<N>,
        home: &Equilibrium<N>,
        home_q: &[f64; N],
    ) -> Option<Self> {
        let machine = MassiveMachine {
            elastic,
            masses,
            accelerometer: None,
        };
        let (pose, axes) = (home.pose, *home_q);
        let weight = machine.weight(&pose, &axes);
        let lines = elastic.lines(&axes.into(), &pose);
        let links_at_home_n = -lines.matrix.lu().solve(&weight.platform)?;
        let axes_at_home = weight.axes - lines.drives.transpose() * links_at_home_n;
        let mut platform = Self {
            state: MachineState {
                pose,
                axes,
                rates: Coordinates::zeros(),
            },
            links_at_home_n,
            axes_at_home,
            damping: Damping::at(&machine, &pose, &axes)?,
            mobility: CoordinateMatrix::zeros(),
            free: Coordinates::zeros(),
            load: Vector6::zeros(),
            tensions_n: Vector6::zeros(),
            axis_loads: SVector::zeros(),
            accelerations: Vector6::zeros(),
            turning: (pose.rotation, Vector3::zeros()),
            machine,
        };
        platform.begin_cycle(&elastic)?;
        Some(platform)
    }

    /// Returns the place as that of springs: tensions without what the weight causes at home.
    #[must_use]
    pub fn equilibrium(&self) -> Equilibrium<N> {
        Equilibrium {
            pose: self.state.pose,
            tensions_n: self.tensions_n,
            axis_loads: self.axis_loads,
            iterations: 0,
            residual_m: 0.0,
        }
    }

    /// Returns the axes behind their springs, q-units.
    #[must_use]
    pub const fn axes(&self) -> &[f64; N] {
        &self.state.axes
    }

    /// Returns the load on the tool, that of a workpiece included, about the tool centre point, world
    /// axes.
    #[must_use]
    pub const fn load(&self) -> &Vector6<f64> {
        &self.load
    }

    /// True if no place or rate is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let MachineState { pose, axes, rates } = &self.state;
        let places = pose.translation_m.iter().chain(pose.rotation.coords.iter());
        rates.is_finite() && places.chain(axes).all(|place| place.is_finite())
    }

    /// Returns the load that a force sensor with a known weight finds, about the tool centre point,
    /// world axes: the load on the tool less what the tool's motion takes.
    #[must_use]
    pub fn sensor_load(&self) -> Vector6<f64> {
        let (rotation, omega) = &self.turning;
        let tool = &self.machine.masses.tool;
        self.load - tool.inertial_load(rotation, &self.accelerations, omega)
    }

    /// Returns the acceleration of the tool centre point (m/s^2) and of the orientation (rad/s^2),
    /// world axes.
    #[must_use]
    pub const fn accelerations(&self) -> &Vector6<f64> {
        &self.accelerations
    }

    /// Returns the angular velocity of the platform, rad/s, world axes.
    #[must_use]
    pub fn angular_velocity(&self) -> Vector3<f64> {
        self.state.rates.platform.fixed_rows::<3>(3).into_owned()
    }

    /// Returns the load of each axis on its drive, along `+q`.
    #[must_use]
    pub fn drive_loads(&self, motors: &Motors<N>) -> SVector<f64, N> {
        let (_, by_damping) = self.damping.forces(&self.state.rates, &motors.rates.into());
        self.axis_springs(motors) + self.axes_at_home + by_damping
    }

    /// Forces of the springs of the axes on the drives, without those at home.
    fn axis_springs(&self, motors: &Motors<N>) -> SVector<f64, N> {
        let compliances = &self.machine.elastic.compliances().axes;
        SVector::from_fn(|axis, _| {
            (self.state.axes[axis] - motors.places[axis]) / compliances[axis]
        })
    }

    /// Begins a cycle, with the joint of arm 3 as it stands. `None` where the machine has no modes.
    pub fn begin_cycle(&mut self, elastic: &ElasticMachine<N>) -> Option<()> {
        self.machine.elastic = *elastic;
        let MachineState { pose, axes, .. } = &self.state;
        if self.damping.has_moved(axes) {
            self.damping = Damping::at(&self.machine, pose, axes)?;
        }
        let (masses, free) = self.machine.inertia_and_weight(&self.state);
        self.mobility = masses.inverse()?;
        self.free = free;
        Some(())
    }

    /// Runs a step with the motors as they were at its beginning, under a load on the tool (N, N m
    /// about the tool centre point, world axes) and, maybe, on a workpiece. Returns the load of each
    /// axis on its drive at the beginning, along `+q`.
    pub fn step(
        &mut self,
        motors: &Motors<N>,
        load: &Vector6<f64>,
        workpiece: Option<&Workpiece>,
    ) -> SVector<f64, N> {
        let MachineState { pose, axes, rates } = self.state;
        let mut load = *load;
        if let Some(workpiece) = workpiece {
            load[2] += workpiece.spring_n(pose.translation_m.z);
        }
        let lines = self.machine.elastic.lines(&axes.into(), &pose);
        self.load = load;
        self.tensions_n = self.machine.elastic.tensions_n(&lines.lengths_m);
        self.axis_loads = self.axis_springs(motors);
        let tensions_n = self.tensions_n + self.links_at_home_n;
        let (damped, damped_drives) = self.damping.forces(&rates, &motors.rates.into());
        let forces = Coordinates {
            platform: product(&lines.matrix, &tensions_n) + load,
            axes: -transposed_product(&lines.drives, &tensions_n)
                - self.axis_loads
                - self.axes_at_home,
        } + self.free
            + damped;
        let changes = self.mobility.times(&forces);
        self.turning = (pose.rotation, self.angular_velocity());
        self.accelerations = changes.platform;
        self.state = moved(&self.state, &changes);
        self.axis_loads + self.axes_at_home + damped_drives
    }
}

/// Returns a state a step later, under these changes of its rates per second.
fn moved<const N: usize>(state: &MachineState<N>, changes: &Coordinates<N>) -> MachineState<N> {
    let MachineState { pose, axes, rates } = state;
    let rates = *rates + *changes * SUBSTEP_S;
    let [moved_m, turned_rad] =
        [0, 3].map(|row| rates.platform.fixed_rows::<3>(row).into_owned() * SUBSTEP_S);
    MachineState {
        pose: Pose {
            translation_m: pose.translation_m + moved_m,
            rotation: UnitQuaternion::from_scaled_axis(turned_rad) * pose.rotation,
        },
        axes: std::array::from_fn(|axis| axes[axis] + rates.axes[axis] * SUBSTEP_S),
        rates,
    }
}

#[cfg(test)]
mod tests;
