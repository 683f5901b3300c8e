//! Six-axis force sensor on the platform: tare, weight of the tool, frame, low-pass `[T 4.2.5]`.
//!
//! The sensor turns with the platform, whose rotation is `R`, world axes from platform axes. Its
//! mounting is constant: `R_s`, platform axes from sensor axes, and `p`, from the tool centre point
//! to its origin, platform axes. It carries a tool of weight `G` (world axes), whose centre of
//! gravity is at `c` from the tool centre point (platform axes), and reads, about its origin and
//! with a zero error `b`,
//!
//! - `F_s = R_s^T R^T (F + G) + b_F`,
//! - `M_s = R_s^T (R^T M + c x R^T G - p x R^T (F + G)) + b_M`.
//!
//! Out comes the load `(F, M)` of the environment on the platform, world axes, about the tool
//! centre point, filtered by a low-pass of first order, or of second order with notches
//! ([`load_filter`](crate::model::load_filter)). The tare finds `b` alone, so that it holds in
//! every orientation; a weight that is not known becomes part of `b`, which is right as long as the
//! platform does not turn. (The thesis' three-axis machine never turns it; there the weight is
//! tared `[T 4.2.5]`.)
//!
//! Inertia is not taken out: a tool of mass `m` accelerated by `a` reads `-m a` too, 5 N for 5 kg
//! at 1 m/s². The filter decides whether a machine that bends by it swings.

use core::fmt;
use nalgebra::{Matrix3, Vector3};

use crate::model::linalg::{rotation_deviation, times};
use crate::model::load_filter::{
    GLIDE_CYCLES, LoadFilter, MAX_FREQUENCY, MAX_NOTCHES, Notch, SECTIONS, SectionState,
};
use crate::model::statics::Wrench;

/// Largest component of a reading, N and N m: beyond it a reading is a fault, and sums stay far
/// from overflow.
pub const MAX_READING: f64 = 1e6;
/// Largest number of samples of a tare.
pub const MAX_TARE_SAMPLES: u32 = 1_000_000;
/// Longest lever, and distance of a centre of gravity, per component, m.
pub const MAX_LEVER_M: f64 = 10.0;
/// Largest component of a tool's weight, N.
pub const MAX_WEIGHT_N: f64 = 1e5;
/// Largest deviation of a platform's rotation from an orthonormal one (largest component of
/// `R^T R - 1`).
pub const MAX_ROTATION_DEVIATION: f64 = 1e-6;

/// A weight's force and moment about the sensor's origin: sqrt(3) turned, on a lever of at most 2
/// sqrt(3) [`MAX_LEVER_M`].
const WIDEST_WEIGHT: f64 = 2.0 * MAX_WEIGHT_N * (1.0 + 4.0 * MAX_LEVER_M);
/// A mean of readings less a weight, and its rounding.
const WIDEST_TARE: f64 = (MAX_READING + WIDEST_WEIGHT) * (1.0 + 1e-9);
/// A reading less its tare, sqrt(3) turned; the lever adds its moment, and the weight comes off
/// again.
const WIDEST_LOAD: f64 =
    2.0 * (MAX_READING + WIDEST_TARE) * (1.0 + 4.0 * MAX_LEVER_M) + WIDEST_WEIGHT;

/// Integrators and output of filters of second order, which resonate: a fault long before it.
const WIDEST_SECTION: f64 = 1e3 * WIDEST_LOAD;
/// Lowest and highest Q of a notch.
pub const NOTCH_Q: (f64, f64) = (0.1, 10.0);

/// Weight of what the sensor carries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tool {
    /// `G`: its weight, a force, world axes, N. At most [`MAX_WEIGHT_N`] per component.
    pub weight_n: Vector3<f64>,
    /// `c`: from the tool centre point to its centre of gravity, platform axes, m. At most
    /// [`MAX_LEVER_M`] per component.
    pub centre_m: Vector3<f64>,
}

impl Tool {
    /// A tool whose weight is not known, and so is tared.
    #[must_use]
    pub fn weightless() -> Self {
        Self {
            weight_n: Vector3::zeros(),
            centre_m: Vector3::zeros(),
        }
    }
}

/// Low-pass of the load.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LowPass {
    /// First order: `y += a (x - y)` with `a = u / (1 + u)`, `u = 2 pi f T` (backward Euler):
    /// stable for every cut-off, within 2 % of its corner while `f T <= 0.01`.
    #[default]
    FirstOrder,
    /// Second order, Butterworth, with the notches of [`ForceSensor::set_notches`] behind it.
    SecondOrder,
}

/// Mounting and filter of the sensor, not yet checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorConfig {
    /// `R_s`: platform axes from sensor axes.
    pub rotation: Matrix3<f64>,
    /// `p`: from the tool centre point to the sensor's origin, platform axes, m. At most
    /// [`MAX_LEVER_M`] per component.
    pub lever_m: Vector3<f64>,
    /// Tool that the sensor carries.
    pub tool: Tool,
    /// Low-pass of the load.
    pub low_pass: LowPass,
    /// Its cut-off frequency, Hz. Of second order at most [`MAX_FREQUENCY`] of the samples'.
    pub cutoff_hz: f64,
    /// Time between two samples, s.
    pub cycle_s: f64,
    /// Number of samples that the tare averages.
    pub tare_samples: u32,
}

/// Error of a sensor's configuration or reading.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SensorError {
    /// `rotation` of the configuration is not a rotation matrix.
    NotRotation,
    /// The platform's rotation is not a rotation matrix, to [`MAX_ROTATION_DEVIATION`]; the reading
    /// was not used.
    PlatformNotRotation,
    /// A parameter is not finite or outside its range.
    OutOfRange {
        /// Parameter, by its name in [`SensorConfig`].
        parameter: &'static str,
        /// Smallest value accepted.
        lower: f64,
        /// Largest value accepted.
        upper: f64,
    },
    /// A component of the reading is NaN, infinite or beyond [`MAX_READING`]; the reading was not
    /// used.
    BadReading,
    /// A state given to [`ForceSensor::from_parts`] violates [`ForceSensor::is_valid`].
    InvalidState,
}

impl fmt::Display for SensorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotRotation => f.write_str("rotation is not a rotation matrix"),
            Self::PlatformNotRotation => {
                f.write_str("rotation of the platform is not a rotation matrix")
            }
            Self::OutOfRange {
                parameter,
                lower,
                upper,
            } => {
                write!(f, "{parameter} must be from {lower:e} to {upper:e}")
            }
            Self::BadReading => f.write_str("reading is not finite or out of range"),
            Self::InvalidState => f.write_str("sensor state is not valid"),
        }
    }
}

impl core::error::Error for SensorError {}

/// Result of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Reading {
    /// The tare still needs this many samples; the tool must be unloaded.
    Taring {
        /// Samples to go.
        remaining: u32,
    },
    /// The load on the platform, world axes, about the tool centre point, filtered.
    Load(Wrench),
}

/// State of the sensor; every component finite.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SensorState {
    /// Samples the tare still needs; 0 once it is done.
    pub tare_remaining: u32,
    /// `b`: mean of the samples the tare has taken, less the tool's weight; zero before the first.
    /// Sensor axes.
    pub tare: Wrench,
    /// Output of the filter, world axes, about the tool centre point.
    pub filtered: Wrench,
    /// Low-pass of second order, then notches; zero with one of first order.
    pub sections: [SectionState; SECTIONS],
}

impl SensorState {
    fn untared(config: &SensorConfig) -> Self {
        Self {
            tare_remaining: config.tare_samples,
            tare: Wrench::zero(),
            filtered: Wrench::zero(),
            sections: [SectionState::zero(); SECTIONS],
        }
    }
}

/// A sensor: its configuration, checked, and its state.
///
/// # Examples
/// ```
/// use gantry_tau_core::model::nalgebra::{Matrix3, Vector3};
/// use gantry_tau_core::model::sensor::{ForceSensor, LowPass, Reading, SensorConfig, Tool};
/// use gantry_tau_core::model::statics::Wrench;
///
/// let sensor_m = Vector3::new(0.0, 0.0, -0.08);
/// let mut sensor = ForceSensor::new(SensorConfig {
///     rotation: Matrix3::identity(),
///     lever_m: sensor_m,
///     // 18 N, centred in the sensor.
///     tool: Tool { weight_n: Vector3::new(0.0, 0.0, -18.0), centre_m: sensor_m },
///     low_pass: LowPass::FirstOrder,
///     cutoff_hz: 20.0,
///     cycle_s: 1e-3,
///     tare_samples: 2,
/// })?;
/// // The weight, and a zero error of 1 N, which the tare finds.
/// let (upright, unloaded) = (Matrix3::identity(), Wrench::from_array([1.0, 0.0, -18.0, 0.0, 0.0, 0.0]));
/// assert_eq!(sensor.update(&unloaded, &upright)?, Reading::Taring { remaining: 1 });
/// assert_eq!(sensor.update(&unloaded, &upright)?, Reading::Taring { remaining: 0 });
/// assert_eq!(sensor.update(&unloaded, &upright)?, Reading::Load(Wrench::zero()));
/// // Turned by a right angle about y, the weight points along x of the platform.
/// let turned = Matrix3::new(0.0, 0.0, 1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0);
/// let unloaded = Wrench::from_array([1.0 + 18.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
/// assert_eq!(sensor.update(&unloaded, &turned)?, Reading::Load(Wrench::zero()));
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceSensor {
    config: SensorConfig,
    filter: Filter,
    state: SensorState,
}

/// Coefficients of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Filter {
    /// Share of a new sample, in (0, 1).
    FirstOrder(f64),
    SecondOrder(LoadFilter),
}

impl Filter {
    /// Filter of a configuration that was checked.
    fn new(config: &SensorConfig) -> Self {
        let SensorConfig {
            cutoff_hz, cycle_s, ..
        } = *config;
        match config.low_pass {
            LowPass::FirstOrder => {
                let u = core::f64::consts::TAU * cutoff_hz * cycle_s;
                Self::FirstOrder(u / (1.0 + u))
            }
            LowPass::SecondOrder => Self::SecondOrder(LoadFilter::new(cutoff_hz, cycle_s)),
        }
    }
}

impl ForceSensor {
    /// Checks the configuration; the sensor starts with its tare.
    ///
    /// # Errors
    /// [`SensorError::NotRotation`] or [`SensorError::OutOfRange`], naming the parameter.
    pub fn new(config: SensorConfig) -> Result<Self, SensorError> {
        if rotation_deviation(&config.rotation) > 1e-9 {
            return Err(SensorError::NotRotation);
        }
        for value in config.lever_m.iter() {
            check("lever_m", *value, -MAX_LEVER_M, MAX_LEVER_M)?;
        }
        for value in config.tool.weight_n.iter() {
            check("tool.weight_n", *value, -MAX_WEIGHT_N, MAX_WEIGHT_N)?;
        }
        for value in config.tool.centre_m.iter() {
            check("tool.centre_m", *value, -MAX_LEVER_M, MAX_LEVER_M)?;
        }
        check("cycle_s", config.cycle_s, 1e-6, 10.0)?;
        let highest_hz = match config.low_pass {
            LowPass::FirstOrder => 1e5,
            LowPass::SecondOrder => MAX_FREQUENCY / config.cycle_s,
        };
        check("cutoff_hz", config.cutoff_hz, 1e-3, highest_hz)?;
        let samples = f64::from(config.tare_samples);
        check("tare_samples", samples, 1.0, f64::from(MAX_TARE_SAMPLES))?;
        Ok(Self {
            config,
            filter: Filter::new(&config),
            state: SensorState::untared(&config),
        })
    }

    /// A sensor in a given state.
    ///
    /// # Errors
    /// As [`new`](Self::new); [`SensorError::InvalidState`].
    pub fn from_parts(config: SensorConfig, state: SensorState) -> Result<Self, SensorError> {
        let sensor = Self {
            state,
            ..Self::new(config)?
        };
        if sensor.is_valid() {
            Ok(sensor)
        } else {
            Err(SensorError::InvalidState)
        }
    }

    /// The configuration.
    #[must_use]
    pub const fn config(&self) -> &SensorConfig {
        &self.config
    }

    /// The state, as [`from_parts`](Self::from_parts) takes it.
    #[must_use]
    pub const fn state(&self) -> &SensorState {
        &self.state
    }

    /// The invariant: no more samples to go than configured; a mean no further out than readings
    /// are, zero before the first; a filter no further out than readings can drive it.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let state = &self.state;
        let Some(taken) = (self.config.tare_samples).checked_sub(state.tare_remaining) else {
            return false;
        };
        let mean = if taken > 0 { WIDEST_TARE } else { 0.0 };
        let filtered = match self.config.low_pass {
            LowPass::FirstOrder => WIDEST_LOAD,
            LowPass::SecondOrder => WIDEST_SECTION,
        };
        within(&state.tare, mean)
            && within(&state.filtered, filtered)
            && state.sections.iter().all(is_section)
    }

    /// Moves the notches behind a low-pass of second order to other frequencies, within
    /// [`GLIDE_CYCLES`], or at once while it is tared. `None` is no notch. Each has its place: one
    /// that moves stays where it is among them.
    ///
    /// # Errors
    /// [`SensorError::OutOfRange`], naming the parameter, also for a notch behind a low-pass of
    /// first order; the notches are what they were.
    pub fn set_notches(
        &mut self,
        notches: &[Option<Notch>; MAX_NOTCHES],
    ) -> Result<(), SensorError> {
        let highest_hz = match self.config.low_pass {
            LowPass::FirstOrder => 0.0,
            LowPass::SecondOrder => MAX_FREQUENCY / self.config.cycle_s,
        };
        for notch in notches.iter().flatten() {
            check("notch.hz", notch.hz, 1e-3, highest_hz)?;
            check("notch.q", notch.q, NOTCH_Q.0, NOTCH_Q.1)?;
        }
        if let Filter::SecondOrder(filter) = &mut self.filter {
            let cycles = if self.state.tare_remaining > 0 {
                0
            } else {
                GLIDE_CYCLES
            };
            filter.set_notches(notches, self.config.cycle_s, cycles);
        }
        Ok(())
    }

    /// Restarts the tare; the filter is at zero.
    pub fn restart_tare(&mut self) {
        self.state = SensorState::untared(&self.config);
    }

    /// Takes one raw sample (sensor axes, N and N m), once per cycle, with the platform turned by
    /// `rotation` (world axes from platform axes): of the three-axis machine a constant, of the
    /// six-axis machine that of the tracked pose.
    ///
    /// The filter starts from zero, which the tare has just defined: no step when the first load is
    /// computed. The new state is checked before it is kept, so that the invariant does not depend
    /// on the arithmetic.
    ///
    /// # Errors
    /// [`SensorError::BadReading`] and [`SensorError::PlatformNotRotation`]; the state is what it
    /// was.
    pub fn update(
        &mut self,
        raw: &Wrench,
        rotation: &Matrix3<f64>,
    ) -> Result<Reading, SensorError> {
        if !within(raw, MAX_READING) {
            return Err(SensorError::BadReading);
        }
        if rotation_deviation(rotation) > MAX_ROTATION_DEVIATION {
            return Err(SensorError::PlatformNotRotation);
        }
        if let Some(remaining) = self.state.tare_remaining.checked_sub(1) {
            let tare = self.tare(raw, rotation, remaining);
            keep(&mut self.state.tare, tare, WIDEST_TARE)?;
            self.state.tare_remaining = remaining;
            return Ok(Reading::Taring { remaining });
        }
        let load = self.load(raw, rotation);
        self.take(&load)?;
        Ok(Reading::Load(self.state.filtered))
    }

    /// The mean with one more sample, and `remaining` to go.
    fn tare(&self, raw: &Wrench, rotation: &Matrix3<f64>, remaining: u32) -> Wrench {
        let taken = self.config.tare_samples.saturating_sub(remaining);
        let share = 1.0 / f64::from(taken);
        let weight = self.weight(rotation);
        let mut tare = self.state.tare;
        tare.force_n += (raw.force_n - weight.force_n - tare.force_n) * share;
        tare.moment_nm += (raw.moment_nm - weight.moment_nm - tare.moment_nm) * share;
        tare
    }

    /// The load of a sample, before the filter.
    fn load(&self, raw: &Wrench, rotation: &Matrix3<f64>) -> Wrench {
        let tare = self.state.tare;
        let weight = self.weight(rotation);
        let force_n = self.in_world(rotation, &(raw.force_n - tare.force_n - weight.force_n));
        let lever_m = times(rotation, &self.config.lever_m);
        let moment_nm = raw.moment_nm - tare.moment_nm - weight.moment_nm;
        let moment_nm = self.in_world(rotation, &moment_nm) + lever_m.cross(&force_n);
        Wrench { force_n, moment_nm }
    }

    /// Takes a load into the filter.
    fn take(&mut self, load: &Wrench) -> Result<(), SensorError> {
        match &mut self.filter {
            Filter::FirstOrder(share) => {
                let mut filtered = self.state.filtered;
                filtered.force_n += (load.force_n - filtered.force_n) * *share;
                filtered.moment_nm += (load.moment_nm - filtered.moment_nm) * *share;
                keep(&mut self.state.filtered, filtered, WIDEST_LOAD)
            }
            Filter::SecondOrder(filter) => {
                let (mut next, mut sections) = (*filter, self.state.sections);
                let filtered = next.next(&mut sections, load);
                if !sections.iter().all(is_section) {
                    return Err(SensorError::BadReading);
                }
                keep(&mut self.state.filtered, filtered, WIDEST_SECTION)?;
                self.state.sections = sections;
                *filter = next;
                Ok(())
            }
        }
    }

    /// The weight as the sensor reads it: `R_s^T R^T G`, `R_s^T ((c - p) x R^T G)`.
    fn weight(&self, rotation: &Matrix3<f64>) -> Wrench {
        let SensorConfig { lever_m, tool, .. } = &self.config;
        let platform_n = times(&rotation.transpose(), &tool.weight_n);
        Wrench {
            force_n: self.in_sensor(&platform_n),
            moment_nm: self.in_sensor(&(tool.centre_m - lever_m).cross(&platform_n)),
        }
    }

    /// Rotates a vector from sensor into world axes: `R R_s v`.
    fn in_world(&self, rotation: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
        times(rotation, &times(&self.config.rotation, v))
    }

    /// Rotates a vector from platform into sensor axes: `R_s^T v`.
    fn in_sensor(&self, v: &Vector3<f64>) -> Vector3<f64> {
        times(&self.config.rotation.transpose(), v)
    }
}

/// Keeps a new value whose components are at most `limit` in magnitude.
fn keep(kept: &mut Wrench, new: Wrench, limit: f64) -> Result<(), SensorError> {
    if !within(&new, limit) {
        return Err(SensorError::BadReading);
    }
    *kept = new;
    Ok(())
}

/// True of integrators that the invariant allows.
fn is_section(section: &SectionState) -> bool {
    within(&section.band, WIDEST_SECTION) && within(&section.low, WIDEST_SECTION)
}

/// True if every component is at most `limit` in magnitude; false for NaN.
fn within(wrench: &Wrench, limit: f64) -> bool {
    // Spelled out: an iterator is a loop to a prover.
    let [fx, fy, fz, mx, my, mz] = wrench.to_array();
    is_within(fx, limit)
        && is_within(fy, limit)
        && is_within(fz, limit)
        && is_within(mx, limit)
        && is_within(my, limit)
        && is_within(mz, limit)
}

/// True if the magnitude is at most `limit`; false for NaN.
fn is_within(value: f64, limit: f64) -> bool {
    value.abs() <= limit
}

/// Checks `lower <= value <= upper`; NaN is an error.
fn check(parameter: &'static str, value: f64, lower: f64, upper: f64) -> Result<(), SensorError> {
    if value >= lower && value <= upper {
        Ok(())
    } else {
        Err(SensorError::OutOfRange {
            parameter,
            lower,
            upper,
        })
    }
}

#[cfg(test)]
mod tests;
