//! Lines between a server and a machine in another process: millimetres, micrometres, mm/s and per
//! mille, which hold every nanometre and µm/s of the server exactly.

use gantry_tau_core::control::axis::{Actual, InForce, Offsets, Reference};
use gantry_tau_core::units::{OffsetNm, PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_server::plant::{DriveState, Reading, ToolReading};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Longest answer, bytes.
pub(super) const MAX_ANSWER: usize = 65_536;

/// Call to a machine.
#[derive(Debug, Serialize)]
#[serde(tag = "call", rename_all = "snake_case")]
pub(super) enum Call {
    Start(MachineDescription),
    InForce,
    Read {
        elapsed: u64,
    },
    Write {
        motors: MotorReferences,
        axes: AxisValues,
    },
    Reset,
}

impl Call {
    pub(super) fn write(references: &[Reference], parts: &[InForce]) -> Self {
        Self::Write {
            motors: MotorReferences::of(references),
            axes: AxisValues::of(parts),
        }
    }

    /// Operation that fails with it.
    pub(super) const fn operation(&self) -> &'static str {
        match self {
            Self::Start(_) => "start",
            Self::InForce => "tell the values in force",
            Self::Read { .. } => "be read",
            Self::Write { .. } => "take its references",
            Self::Reset => "be reset",
        }
    }
}

/// Description of the machine for its simulator, with the axes at home.
#[derive(Clone, Debug, Serialize)]
pub(super) struct MachineDescription {
    pub(super) model: &'static str,
    pub(super) axes: usize,
    pub(super) motors: usize,
    pub(super) axis_of_motor: Vec<usize>,
    pub(super) cycle_us: u32,
    pub(super) home_mm: Vec<f64>,
}

/// References of the motors, motor order.
#[derive(Debug, Serialize)]
pub(super) struct MotorReferences {
    position_mm: Vec<f64>,
    velocity_mm_s: Vec<f64>,
    torque_permille: Vec<i16>,
}

impl MotorReferences {
    fn of(references: &[Reference]) -> Self {
        let all = references.iter();
        Self {
            position_mm: all.clone().map(|one| mm(one.position)).collect(),
            velocity_mm_s: all.clone().map(|one| mm_s(one.velocity_offset)).collect(),
            torque_permille: all.map(|one| one.torque_offset.0).collect(),
        }
    }
}

/// Nominal references and offsets of the axes, axis order.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AxisValues {
    nominal_mm: Vec<f64>,
    offset_um: Vec<f64>,
    velocity_mm_s: Vec<f64>,
    torque_permille: Vec<f64>,
}

impl AxisValues {
    fn of(parts: &[InForce]) -> Self {
        let all = parts.iter();
        let offsets = parts.iter().map(|one| &one.offsets);
        Self {
            nominal_mm: all.map(|one| mm(one.nominal)).collect(),
            offset_um: (offsets.clone())
                .map(|one| f64::from(one.position.0) / 1e3)
                .collect(),
            velocity_mm_s: offsets.clone().map(|one| mm_s(one.velocity)).collect(),
            torque_permille: offsets.map(|one| f64::from(one.torque.0)).collect(),
        }
    }
}

/// Answer to [`Call::InForce`].
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct InForceAnswer {
    axes: AxisValues,
}

/// Answer to [`Call::Read`].
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ReadAnswer {
    nominal_mm: Vec<f64>,
    actual_mm: Vec<f64>,
    velocity_mm_s: Option<Vec<f64>>,
    torque_permille: Option<Vec<f64>>,
    tool: Option<ToolAnswer>,
    drives: Option<Vec<String>>,
}

/// Measurements at the tool: force and moment in the sensor's axes.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ToolAnswer {
    force_n: [f64; 3],
    moment_nm: [f64; 3],
    /// Ticks since the sensor took them.
    #[serde(default)]
    age: u8,
    /// Load that acts, world axes.
    #[serde(default)]
    load_force_n: [f64; 3],
    #[serde(default)]
    load_moment_nm: [f64; 3],
    /// Displacement of the tool from its nominal place, world axes.
    #[serde(default)]
    displacement_um: [f64; 3],
    /// Rotation from its nominal orientation, world axes.
    #[serde(default)]
    turn_urad: [f64; 3],
    acceleration_m_s2: Option<[f64; 3]>,
    #[serde(default)]
    angular_acceleration_rad_s2: [f64; 3],
}

/// Fields of an answer, but those of every answer.
pub(super) type Fields = Map<String, Value>;

/// Answer to a call.
#[derive(Debug)]
pub(super) enum Answer {
    /// The call was carried out.
    Done(Fields),
    /// The machine could not, for this reason.
    Failed(String),
}

/// Writes a call.
pub(super) fn question(number: u64, call: &Call) -> Result<Vec<u8>, String> {
    #[derive(Serialize)]
    struct Question<'a> {
        n: u64,
        #[serde(flatten)]
        call: &'a Call,
    }
    serde_json::to_vec(&Question { n: number, call }).map_err(|error| error.to_string())
}

/// Reads the answer to the call of this number.
///
/// # Errors
/// It is none; the text says why.
pub(super) fn answer(line: &[u8], number: u64) -> Result<Answer, String> {
    let mut fields: Fields =
        serde_json::from_slice(line).map_err(|error| not_an_object(line, &error))?;
    match fields.remove("n").and_then(|n| n.as_u64()) {
        Some(n) if n == number => {}
        Some(n) => return Err(format!("it answered call {n} in place of {number}")),
        None => return Err("its answer has no number n".to_owned()),
    }
    match fields.remove("error") {
        None | Some(Value::Null) => Ok(Answer::Done(fields)),
        Some(Value::String(error)) => Ok(Answer::Failed(error)),
        Some(error) => Ok(Answer::Failed(error.to_string())),
    }
}

/// Names the numbers that many languages write and JSON does not have.
fn not_an_object(line: &[u8], error: &serde_json::Error) -> String {
    let line = String::from_utf8_lossy(line);
    match ["NaN", "Infinity"]
        .iter()
        .find(|name| line.contains(**name))
    {
        Some(name) => format!("its answer has {name}, and JSON has finite numbers only"),
        None => format!("its answer is no object of JSON: {error}"),
    }
}

/// Reads an answer that says nothing but that the call was carried out.
pub(super) fn nothing(fields: Fields) -> Result<(), String> {
    match fields.keys().next() {
        None => Ok(()),
        Some(key) => Err(format!("unknown field {key}")),
    }
}

/// Reads the values in force.
pub(super) fn in_force<const N: usize>(fields: Fields) -> Result<[InForce; N], String> {
    expect_object(&fields, "axes")?;
    let InForceAnswer { axes } = parse(fields)?;
    let nominal: [_; N] = positions("axes.nominal_mm", &axes.nominal_mm)?;
    let position: [_; N] = numbers("axes.offset_um", &axes.offset_um, 1e3)?;
    let velocity: [_; N] = velocities("axes.velocity_mm_s", &axes.velocity_mm_s)?;
    let torque: [_; N] = torques("axes.torque_permille", &axes.torque_permille)?;
    Ok(std::array::from_fn(|axis| InForce {
        nominal: nominal[axis],
        offsets: Offsets {
            position: OffsetNm(position[axis]),
            velocity: velocity[axis],
            torque: torque[axis],
        },
    }))
}

/// Reads measurements, and the states of the drives.
pub(super) fn reading<const N: usize>(
    fields: Fields,
) -> Result<(Reading<N>, Option<[DriveState; N]>), String> {
    expect_object(&fields, "tool")?;
    let read: ReadAnswer = parse(fields)?;
    let still = || vec![0.0; N];
    let position: [_; N] = positions("actual_mm", &read.actual_mm)?;
    let velocity: [_; N] = velocities("velocity_mm_s", &read.velocity_mm_s.unwrap_or_else(still))?;
    let torque: [_; N] = torques(
        "torque_permille",
        &read.torque_permille.unwrap_or_else(still),
    )?;
    let reading = Reading {
        nominal: positions("nominal_mm", &read.nominal_mm)?,
        actual: std::array::from_fn(|axis| Actual {
            position: position[axis],
            velocity: velocity[axis],
            torque: torque[axis],
        }),
        tool: read.tool.map(tool),
    };
    let drives = read.drives.map(|drives| states(&drives)).transpose()?;
    Ok((reading, drives))
}

fn tool(tool: ToolAnswer) -> ToolReading {
    let [fx, fy, fz] = tool.force_n;
    let [mx, my, mz] = tool.moment_nm;
    let [lx, ly, lz] = tool.load_force_n;
    let [kx, ky, kz] = tool.load_moment_nm;
    let [a, b, c] = tool.angular_acceleration_rad_s2;
    let displacement_m = tool.displacement_um.map(|um| um * 1e-6);
    ToolReading {
        step: 0,
        load: [lx, ly, lz, kx, ky, kz],
        sensor: [fx, fy, fz, mx, my, mz],
        sensor_age: tool.age,
        acceleration: tool.acceleration_m_s2.map(|[x, y, z]| [x, y, z, a, b, c]),
        displacement_m,
        turn_rad: tool.turn_urad.map(|urad| urad * 1e-6),
        gauges_m: displacement_m,
    }
}

fn states<const N: usize>(names: &[String]) -> Result<[DriveState; N], String> {
    let read = |name: &String| {
        (0..=u8::MAX)
            .map_while(DriveState::from_code)
            .find(|state| state.name() == name)
            .ok_or_else(|| format!("drives: {name:?} is no state"))
    };
    let states: Vec<DriveState> = names.iter().map(read).collect::<Result<_, _>>()?;
    states
        .try_into()
        .map_err(|states: Vec<_>| format!("drives: {} states for {N} axes", states.len()))
}

/// Refuses a list in the place of an object, which serde would read field by field.
fn expect_object(fields: &Fields, name: &str) -> Result<(), String> {
    match fields.get(name) {
        None | Some(Value::Null | Value::Object(_)) => Ok(()),
        Some(other) => {
            let text: String = other.to_string().chars().take(40).collect();
            Err(format!("{name}: expected an object, not {text}"))
        }
    }
}

fn parse<T: DeserializeOwned>(fields: Fields) -> Result<T, String> {
    serde_json::from_value(Value::Object(fields)).map_err(|error| error.to_string())
}

fn positions<const N: usize>(name: &str, mm: &[f64]) -> Result<[PositionNm; N], String> {
    Ok(numbers(name, mm, 1e6)?.map(PositionNm))
}

fn velocities<const N: usize>(name: &str, mm_s: &[f64]) -> Result<[VelocityUmS; N], String> {
    Ok(numbers(name, mm_s, 1e3)?.map(VelocityUmS))
}

fn torques<const N: usize>(name: &str, permille: &[f64]) -> Result<[TorquePermille; N], String> {
    Ok(numbers(name, permille, 1.0)?.map(TorquePermille))
}

/// Numbers of the axes, each multiplied and rounded to an integer of the server.
fn numbers<T: TryFrom<i64>, const N: usize>(
    name: &str,
    numbers: &[f64],
    factor: f64,
) -> Result<[T; N], String> {
    let read = |number: &f64| {
        integer((number * factor).round())
            .ok_or_else(|| format!("{name}: {number:?} is out of range"))
    };
    let all: Vec<T> = numbers.iter().map(read).collect::<Result<_, _>>()?;
    all.try_into()
        .map_err(|all: Vec<T>| format!("{name}: {} numbers for {N} axes", all.len()))
}

/// A whole number as an integer that holds it; beyond 2^53 not every number is one.
fn integer<T: TryFrom<i64>>(whole: f64) -> Option<T> {
    let is_exact = (-9.0e15..=9.0e15).contains(&whole);
    is_exact.then_some(whole as i64)?.try_into().ok()
}

fn mm(position: PositionNm) -> f64 {
    position.0 as f64 / 1e6
}

fn mm_s(velocity: VelocityUmS) -> f64 {
    f64::from(velocity.0) / 1e3
}
