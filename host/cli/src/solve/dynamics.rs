//! Operations on a machine with masses: motion, modes, and the loop of its compensation.

use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::robot::LINKS;
use gantry_tau_machine::drive_cascade::{MOTOR_MASS_KG, POSITION_GAIN};
use gantry_tau_machine::dynamics::{Coordinates, MachineState, MassiveMachine, Modes};
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::{ElasticMachine, Pose};
use gantry_tau_machine::masses::{Masses, RigidBody};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{DAMPING_RATIO, InertiaKeys, RobotFile};
use gantry_tau_machine::stability::{DriveKind, Filter, LinearMachine, Loop, TickMap};
use nalgebra::{Rotation3, SVector, UnitQuaternion, Vector6};
use serde::Deserialize;
use serde_json::{Value, json};

use super::SolveError;
use super::ops::{Operations, SolveTask, finite, rows};
use super::request::{self, field, optional_field};

/// Cycles from a reading to its reference by default: one, and one of latency in each direction of
/// the drives.
const LATENCY_CYCLES: u32 = 3;
/// Largest number of them.
const MAX_LATENCY_CYCLES: u32 = 50;
/// Largest number of notches.
const MAX_NOTCHES: usize = 6;
/// Frequencies of filters, Hz.
const FILTER_HZ: (f64, f64) = (0.01, 450.0);

/// Masses of a machine, and its drives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bodies<const N: usize> {
    masses: Option<Masses<N>>,
    metres_per_q: [f64; N],
    /// Motors of each axis.
    motors: [f64; N],
}

impl<const N: usize> Bodies<N> {
    /// Of a robot file.
    pub(super) fn of<K>(robot: &RobotFile<K, N>) -> Self {
        Self {
            masses: robot.masses,
            metres_per_q: robot.metres_per_q,
            motors: robot.motors.per_axis(),
        }
    }

    /// Of a robot without masses.
    pub(super) fn massless(metres_per_q: [f64; N], motors: &[u8; N]) -> Self {
        Self {
            masses: None,
            metres_per_q,
            motors: motors.map(f64::from),
        }
    }
}

/// `masses` of a request. Unknown keys are ignored.
#[derive(Deserialize)]
struct MassesRequest {
    platform_kg: f64,
    platform_centre: [f64; 3],
    #[serde(rename = "platform_I")]
    platform_inertia: InertiaKeys,
    link_kg: [f64; LINKS],
    cart_kg: [f64; 3],
    #[serde(rename = "plate_I", default)]
    plate_inertia: Vec<f64>,
    tool_kg: f64,
    tool_centre: [f64; 3],
    #[serde(rename = "tool_I")]
    tool_inertia: InertiaKeys,
    /// Of each axis.
    motor_kg: Option<Vec<f64>>,
    #[serde(rename = "zeta")]
    damping_ratio: Option<f64>,
}

impl MassesRequest {
    fn masses<const N: usize>(self, motors: &[f64; N]) -> Result<Masses<N>, SolveError> {
        let plates_kgm2 = match self.plate_inertia.as_slice() {
            [] => [0.0; 3],
            &[q4, q5, q6] => [q4, q5, q6],
            plates => {
                let reason = format!("masses: plate_I has {} numbers, not 3", plates.len());
                return Err(SolveError::request(reason));
            }
        };
        let motors_kg = match self.motor_kg {
            Some(each) => per_axis("masses: motor_kg", &each)?,
            None => motors.map(|motors| motors * MOTOR_MASS_KG),
        };
        Ok(Masses {
            platform: RigidBody {
                mass_kg: self.platform_kg,
                centre_m: self.platform_centre.into(),
                inertia_kgm2: self.platform_inertia.into(),
            },
            tool: RigidBody {
                mass_kg: self.tool_kg,
                centre_m: self.tool_centre.into(),
                inertia_kgm2: self.tool_inertia.into(),
            },
            links_kg: self.link_kg,
            carts_kg: self.cart_kg,
            plates_kgm2,
            motors_kg,
            damping_ratio: self.damping_ratio.unwrap_or(DAMPING_RATIO),
            has_weight: true,
        })
    }
}

/// A machine in one place.
struct PlacedMachine<const N: usize> {
    machine: MassiveMachine<N>,
    pose: Pose,
    axes: [f64; N],
}

impl<K: MachineKind<N>, const N: usize> SolveTask<'_, K, N>
where
    Self: Operations<N>,
{
    pub(super) fn dynamics(&self) -> Result<Value, SolveError> {
        let PlacedMachine {
            machine,
            pose,
            axes,
        } = self.placed()?;
        let drives = self.numbers("drives")?.unwrap_or(axes);
        let rates = optional_field::<Vec<f64>>(self.request, "nu")?;
        let rates = rates.map_or_else(|| Ok(Coordinates::zeros()), |rates| coordinates(&rates))?;
        let load = optional_field::<[f64; 6]>(self.request, "wrench")?.unwrap_or_default();
        let state = MachineState { pose, axes, rates };
        let motion = machine
            .acceleration(&state, &drives, &Vector6::from(load))
            .ok_or(KinematicsError::NotFinite)?;
        let accelerations = motion.rates.to_vector();
        let numbers = accelerations.iter().chain(motion.tensions_n.iter());
        finite(numbers.chain(motion.sensor_load.iter()).copied())?;
        Ok(json!({
            "mass_matrix": rows(&machine.mass_matrix(&pose, &axes).to_matrix()),
            "accelerations": accelerations.as_slice(),
            "link_tensions": motion.tensions_n.as_slice(),
            "sensor_load": motion.sensor_load.as_slice(),
        }))
    }

    pub(super) fn modes(&self) -> Result<Value, SolveError> {
        let placed = self.placed()?;
        let modes = Modes::of(&placed.machine, &placed.pose, &placed.axes).ok_or_else(no_modes)?;
        let first: Vec<f64> = modes.hz().into_iter().take(5).collect();
        finite(first.iter().copied())?;
        Ok(json!({ "first_five_modes_hz": first }))
    }

    pub(super) fn closed_loop(&self) -> Result<Value, SolveError> {
        let PlacedMachine {
            machine,
            pose,
            axes,
        } = self.placed()?;
        let linear = LinearMachine::at(&machine, &pose, &axes).ok_or_else(no_modes)?;
        let name: String = field(self.request, "filter")?;
        let filter = filter(&name, &linear.modes.hz())?;
        let latency: u32 =
            optional_field(self.request, "latency_cycles")?.unwrap_or(LATENCY_CYCLES);
        within(
            "latency_cycles",
            latency.into(),
            (1.0, MAX_LATENCY_CYCLES.into()),
        )?;
        let map = TickMap::of(&linear, &self.drives(&machine)?);
        let closed = Loop::new(&linear, map, filter, latency as usize);
        let (Some(growth), Some(margin)) = (closed.growth(), closed.margin()) else {
            return Err(KinematicsError::NotFinite.into());
        };
        finite([growth.per_s, growth.hz, margin.any_phase, margin.hz])?;
        Ok(json!({
            "closed_loop_growth_per_s": growth.per_s,
            "at_hz": growth.hz,
            "any_phase_margin": margin.any_phase,
            "margin_at_hz": margin.hz,
        }))
    }

    /// Returns the machine with the masses of the request, or else of its file, where the request
    /// puts it: by `axes`, or else by its inverse kinematics.
    fn placed(&self) -> Result<PlacedMachine<N>, SolveError> {
        let pose = request::pose(self.request, "tcp_m", "rotation")?;
        let axes = match self.numbers("axes")? {
            Some(axes) => axes,
            None => self.kinematics.axes_for(&pose)?,
        };
        let turned = Rotation3::from_matrix_unchecked(pose.rotation);
        let geometry = self.kinematics.geometry();
        Ok(PlacedMachine {
            machine: MassiveMachine {
                elastic: ElasticMachine::new(geometry, *self.springs()?, Backlash::NONE),
                masses: self.masses()?,
                // A loop is that of the force sensor alone.
                accelerometer: None,
            },
            pose: Pose {
                translation_m: pose.position_m,
                rotation: UnitQuaternion::from_rotation_matrix(&turned),
            },
            axes,
        })
    }

    fn masses(&self) -> Result<Masses<N>, SolveError> {
        let given: Option<MassesRequest> = optional_field(self.request, "masses")?;
        let mut masses = match (given, self.bodies.masses) {
            (Some(given), _) => given.masses(&self.bodies.motors)?,
            (None, Some(masses)) => masses,
            (None, None) => {
                let reason = "masses is missing, and the robot has no section [masses]";
                return Err(SolveError::request(reason));
            }
        };
        for (key, number) in [
            ("tool_kg", &mut masses.tool.mass_kg),
            ("damping_ratio", &mut masses.damping_ratio),
        ] {
            if let Some(given) = optional_field(self.request, key)? {
                *number = given;
            }
        }
        if let Some(gravity) = optional_field(self.request, "gravity")? {
            masses.has_weight = gravity;
        }
        match masses.errors().first() {
            Some(error) => Err(SolveError::request(format!("{} {error}", error.key()))),
            None => Ok(masses),
        }
    }

    fn drives(&self, machine: &MassiveMachine<N>) -> Result<DriveKind<N>, SolveError> {
        let kind: Option<String> = optional_field(self.request, "drives")?;
        match kind.as_deref() {
            Some("ideal") => Ok(DriveKind::Ideal),
            None | Some("cascade") => {
                let gain: Option<f64> = optional_field(self.request, "position_gain")?;
                let position_gain_per_s = gain.unwrap_or(POSITION_GAIN);
                within("position_gain", position_gain_per_s, (1.0, 499.0))?;
                Ok(DriveKind::Cascade {
                    position_gain_per_s,
                    motors: self.bodies.motors,
                    motors_kg: machine.masses.motors_kg,
                    metres_per_q: self.bodies.metres_per_q,
                })
            }
            Some(other) => Err(SolveError::request(format!(
                "drives is {other:?}; expected \"ideal\" or \"cascade\""
            ))),
        }
    }

    /// Reads one number per axis.
    fn numbers(&self, name: &str) -> Result<Option<[f64; N]>, SolveError> {
        let numbers: Option<Vec<f64>> = optional_field(self.request, name)?;
        numbers.map(|numbers| per_axis(name, &numbers)).transpose()
    }
}

fn per_axis<const N: usize>(name: &str, numbers: &[f64]) -> Result<[f64; N], SolveError> {
    <[f64; N]>::try_from(numbers).map_err(|_| {
        let count = numbers.len();
        SolveError::request(format!(
            "{name} has {count} numbers; the machine has {N} axes"
        ))
    })
}

/// Reads `nu`: six of the platform, then one per axis.
fn coordinates<const N: usize>(rates: &[f64]) -> Result<Coordinates<N>, SolveError> {
    match rates.split_first_chunk::<6>() {
        Some((platform, axes)) if axes.len() == N => Ok(Coordinates {
            platform: Vector6::from(*platform),
            axes: SVector::from_column_slice(axes),
        }),
        _ => Err(SolveError::request(format!(
            "nu has {} numbers; it must have 6 of the platform and {N} of the axes",
            rates.len()
        ))),
    }
}

/// Reads the name of a filter: `first_order_HZ`, `butterworth2_HZ`, or the latter with notches at
/// modes counted from 1, `butterworth2_HZ_notch_I_J_qQ`.
fn filter(name: &str, modes_hz: &[f64]) -> Result<Filter, SolveError> {
    if let Some(cutoff) = name.strip_prefix("first_order_") {
        return Ok(Filter::first_order(frequency(name, cutoff)?));
    }
    let rest = name.strip_prefix("butterworth2_");
    let rest = rest.ok_or_else(|| no_filter(name))?;
    let Some((cutoff, notches)) = rest.split_once("_notch_") else {
        return Ok(Filter::butterworth(frequency(name, rest)?));
    };
    let (modes, q) = (notches.split_once("_q")).ok_or_else(|| no_filter(name))?;
    let q: f64 = q.parse().map_err(|_| no_filter(name))?;
    within("q of the notches", q, (0.05, 100.0))?;
    if modes.split('_').count() > MAX_NOTCHES {
        let reason = format!("filter has more than {MAX_NOTCHES} notches");
        return Err(SolveError::request(reason));
    }
    let low_pass = Filter::butterworth(frequency(name, cutoff)?);
    modes.split('_').try_fold(low_pass, |filter, number| {
        let number: Option<usize> = number.parse().ok();
        let mode = number
            .and_then(|number| number.checked_sub(1))
            .and_then(|index| modes_hz.get(index));
        let hz = *mode.ok_or_else(|| no_filter(name))?;
        within("frequency of a notch", hz, FILTER_HZ)?;
        Ok(filter.with_notch(hz, q))
    })
}

/// Reads the cut-off in the name of a filter, Hz.
fn frequency(name: &str, text: &str) -> Result<f64, SolveError> {
    let hz = text.parse().map_err(|_| no_filter(name))?;
    within("frequency of the filter", hz, FILTER_HZ).map(|()| hz)
}

fn no_filter(name: &str) -> SolveError {
    SolveError::request(format!(
        "filter is {name:?}; expected first_order_HZ, butterworth2_HZ, or butterworth2_HZ_notch_I_J_qQ with the numbers of modes"
    ))
}

fn within(name: &str, value: f64, (lower, upper): (f64, f64)) -> Result<(), SolveError> {
    if (lower..=upper).contains(&value) {
        Ok(())
    } else {
        Err(SolveError::request(format!(
            "{name} is {value}; expected from {lower} to {upper}"
        )))
    }
}

fn no_modes() -> SolveError {
    SolveError {
        kind: "singular",
        message: "the links do not hold the platform here, so that it has no modes".to_owned(),
    }
}
