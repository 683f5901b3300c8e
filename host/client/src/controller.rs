//! The compensating client between a State and its answer: no sockets, no clock, no switches.

use std::fmt::Display;
use std::io;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::client::Answer;
use gantry_tau_core::control::message::{Mode, State, Welcome};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::OffsetNm;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;

use super::ClientError;
use super::compensate::{Compensation, Samples, SetupError};
use super::oscillation::{Oscillation, Oscillations};
use super::stability::HomeMargin;
use crate::force_sensor::{Sample, SensorConnection};

/// States that the last usable force sample may serve.
const SAMPLE_STATES: u64 = 100;

/// Counts of a session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Cycles whose correction could not be computed; the last one stood.
    pub held: u64,
    /// Cycles whose correction was cut at the limit of an axis.
    pub saturated: u64,
    /// Departures from Obtain because the targets oscillated.
    pub oscillations: u64,
    /// Oscillation of the last of them.
    pub last_oscillation: Option<Oscillation>,
}

/// A compensating client: per State it takes the samples of the instruments, and has the mode and the
/// targets of the answer. A copy goes on from the same state.
#[derive(Clone)]
pub struct Controller<const N: usize> {
    compensation: Compensation<N>,
    sample: Option<Sample>,
    targets: [OffsetNm; N],
    /// Axes whose last correction was cut at its limit.
    cut: [bool; N],
    counts: Counts,
    /// States in a row without a usable sample.
    states_without_sample: u64,
    obtaining: bool,
    margin: HomeMargin,
    accept_unstable: bool,
    /// Share of the correction that is asked for.
    gain: f64,
    /// Absent if the robot file turns them off.
    oscillations: Option<Oscillations<N>>,
}

impl<const N: usize> Controller<N> {
    /// Creates the client of a robot file's machine in a session on these terms. With
    /// `accept_unstable` it obtains with a margin of stability below the required one, too.
    ///
    /// # Errors
    /// [`SetupError`].
    pub fn new<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        welcome: &Welcome<N>,
        margin: HomeMargin,
        accept_unstable: bool,
    ) -> Result<Self, SetupError> {
        Ok(Self {
            compensation: Compensation::new(robot, welcome)?,
            sample: None,
            targets: [OffsetNm(0); N],
            cut: [false; N],
            counts: Counts::default(),
            states_without_sample: 0,
            obtaining: false,
            margin,
            accept_unstable,
            gain: robot.client.gain,
            oscillations: Oscillations::new(robot, welcome),
        })
    }

    /// Finds the notches of the filter in a thread; as [`Compensation::in_background`].
    ///
    /// # Errors
    /// The system has no thread.
    pub fn in_background(self) -> io::Result<Self> {
        let compensation = self.compensation.in_background()?;
        Ok(Self {
            compensation,
            ..self
        })
    }

    /// Computes new targets from a new sample; without one the last targets stand, for a while.
    /// `acceleration` has the sample of the accelerometer that belongs to a tick.
    ///
    /// # Errors
    /// [`ClientError::SensorSilent`]: for too long. That of `acceleration`.
    pub fn compensate(
        &mut self,
        state: &State<N>,
        sensor: &mut SensorConnection,
        acceleration: impl FnOnce(u64) -> Result<Option<[f64; 6]>, ClientError>,
    ) -> Result<(), ClientError> {
        let latest = sensor
            .latest(state)
            .map_err(|error| ClientError::SensorSilent(error.to_string()))?;
        let is_new = |latest: &Sample| {
            self.sample != Some(*latest) && state.tick.0.abs_diff(latest.tick) <= SAMPLE_STATES
        };
        let Some(sample) = latest.filter(is_new) else {
            return self.wait_for_sample(sensor, |sensor| sensor.silence());
        };
        if sample.is_cut {
            return self.hold(sensor, &"the force is beyond the range of a State");
        }
        self.sample = Some(sample);
        let nominal = state.axes.map(|axis| axis.nominal);
        let samples = Samples {
            wrench: Wrench::from_array(sample.wrench),
            acceleration: acceleration(sample.tick)?,
        };
        match self.compensation.cycle(state.tick, &samples, &nominal) {
            Ok(correction) => {
                self.targets = correction.offsets;
                self.states_without_sample = 0;
                self.note_saturation(&correction.saturated);
                Ok(())
            }
            Err(error) => self.hold(sensor, &error),
        }
    }

    /// Counts a correction that was cut; logs the first.
    fn note_saturation(&mut self, saturated: &[bool; N]) {
        self.cut = *saturated;
        let Some(axis) = saturated.iter().position(|cut| *cut) else {
            return;
        };
        if self.counts.saturated == 0 {
            tracing::warn!(
                "axis {}: the correction is cut at the limit of the offset; the load is beyond what the offsets can compensate",
                axis + 1
            );
        }
        self.counts.saturated += 1;
    }

    /// Keeps the last targets: logs the first such cycle, counts each, and fails after too many in
    /// a row.
    fn hold(&mut self, sensor: &SensorConnection, error: &dyn Display) -> Result<(), ClientError> {
        if self.counts.held == 0 {
            tracing::warn!("a correction cannot be computed, the last one is held: {error}");
        }
        self.counts.held += 1;
        self.wait_for_sample(sensor, |_| {
            format!("none of {SAMPLE_STATES} could be used: {error}")
        })
    }

    /// Counts a State without a usable sample, missing or held. Fails after too many in a row.
    fn wait_for_sample(
        &mut self,
        sensor: &SensorConnection,
        reason: impl FnOnce(&SensorConnection) -> String,
    ) -> Result<(), ClientError> {
        self.states_without_sample += 1;
        let patience = match self.sample {
            None => sensor.patience(),
            Some(_) => SAMPLE_STATES,
        };
        if self.states_without_sample > patience {
            return Err(ClientError::SensorSilent(reason(sensor)));
        }
        Ok(())
    }

    /// Returns the sample of the last State; `None` if it had no usable one.
    #[must_use]
    pub fn new_sample(&self) -> Option<&Sample> {
        (self.sample.as_ref()).filter(|_| self.states_without_sample == 0)
    }

    /// True if the tare is done.
    #[must_use]
    pub const fn is_tared(&self) -> bool {
        self.compensation.is_tared()
    }

    /// Returns the load that the last targets are for, world axes; zero while taring.
    #[must_use]
    pub fn load(&self) -> Wrench {
        self.compensation.load()
    }

    /// Returns the targets of the answer.
    #[must_use]
    pub fn targets(&self) -> [Offsets; N] {
        let mut targets = self.targets.map(Offsets::position);
        for (target, torque) in targets.iter_mut().zip(self.compensation.torques()) {
            target.torque = torque;
        }
        targets
    }

    /// Returns the mode of the answer: Submit until the sensor is tared.
    ///
    /// # Errors
    /// The reason against Obtain, with the compensation as it is: Submit must be asked for.
    pub fn mode(&self, wants_obtain: bool) -> Result<Mode, String> {
        if !(self.is_tared() && wants_obtain) {
            return Ok(Mode::Submit);
        }
        match self.reason_against(self.gain).filter(|_| !self.obtaining) {
            Some(reason) => Err(reason),
            None => Ok(Mode::Obtain),
        }
    }

    /// Takes note of the answer that was sent. Returns true if the mode has changed; before the first answer
    /// it is Submit.
    pub fn note_answer(&mut self, answer: &Answer<N>) -> bool {
        let obtaining = answer.command.mode == Mode::Obtain;
        for (cut, axis) in self.cut.iter_mut().zip(answer.saturated) {
            *cut |= axis.position;
        }
        std::mem::replace(&mut self.obtaining, obtaining) != obtaining
    }

    /// True if the last answer asked for Obtain.
    #[must_use]
    pub const fn is_obtaining(&self) -> bool {
        self.obtaining
    }

    /// True for a machine of which no masses are known, and so no margin of stability.
    #[must_use]
    pub const fn has_unknown_margin(&self) -> bool {
        self.margin.is_unknown()
    }

    /// Returns the axes whose last correction was cut, by the limits of the robot file or by those of
    /// the server.
    #[must_use]
    pub const fn cut(&self) -> &[bool; N] {
        &self.cut
    }

    /// Returns the counts since the session began.
    #[must_use]
    pub const fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Looks for an oscillation of the targets of an answered State. After one, ask for Submit.
    pub fn oscillation(&mut self, state: &State<N>) -> Option<Oscillation> {
        let oscillations = self.oscillations.as_mut()?;
        if !self.obtaining {
            oscillations.restart();
            return None;
        }
        let nominal = state.axes.map(|axis| axis.nominal);
        let found = oscillations.update(state.tick.0, &self.targets, &nominal)?;
        self.counts.oscillations += 1;
        self.counts.last_oscillation = Some(found);
        Some(found)
    }

    /// Asks for another share of the correction, 0 to 1; `wants_obtain`: it may act.
    ///
    /// # Errors
    /// The reason against it; the share before stays.
    pub fn set_gain(&mut self, gain: f64, wants_obtain: bool) -> Result<(), String> {
        if let Some(reason) = self.reason_against(gain).filter(|_| wants_obtain) {
            return Err(reason);
        }
        self.compensation
            .set_gain(gain)
            .map_err(|error| error.to_string())?;
        self.gain = gain;
        Ok(())
    }

    /// Returns the reason against this share of the correction, unless it is accepted.
    fn reason_against(&self, gain: f64) -> Option<String> {
        self.margin.against(gain).filter(|_| !self.accept_unstable)
    }
}
