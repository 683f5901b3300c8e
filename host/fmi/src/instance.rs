//! One unit in use: which call may come when, values, steps, saved states.
//!
//! A call that is refused changes nothing, and the unit can go on. After a cycle that fails, only
//! [`reset`](Instance::reset), [`restore`](Instance::restore) and reading are left.

mod time;

use std::fmt;

use gantry_tau_machine::robot_file::AnyRobotFile;

use crate::kind::Kind;
use crate::log::Log;
use crate::units::{Model, Unit};
pub use crate::variable::{Access, Causality};
use crate::variable::{Values, Variable};
use time::SimulatedTime;

/// A call that is refused, in one sentence.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct CallRefused(String);

impl CallRefused {
    /// Refuses with this sentence.
    pub fn because(reason: impl Into<String>) -> Self {
        Self(reason.into())
    }
}

impl From<String> for CallRefused {
    fn from(reason: String) -> Self {
        Self(reason)
    }
}

/// Progress of a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Instantiated,
    Initializing,
    Running,
    Terminated,
    Failed,
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Instantiated => "before its initialization",
            Self::Initializing => "in its initialization",
            Self::Running => "between steps",
            Self::Terminated => "terminated",
            Self::Failed => "failed: reset it, or restore a state",
        })
    }
}

/// State of a unit that can be restored.
pub struct Saved {
    mode: Mode,
    clock: SimulatedTime,
    values: Values,
    unit: Box<dyn Unit>,
}

impl Clone for Saved {
    fn clone(&self) -> Self {
        Self {
            mode: self.mode,
            clock: self.clock,
            values: self.values.clone(),
            unit: self.unit.copy(),
        }
    }
}

/// A unit in use. Nothing is shared with another one.
pub struct Instance {
    variables: Vec<Variable>,
    guid: String,
    fresh: Saved,
    now: Saved,
    /// Warnings since they were taken last.
    log: Log,
}

impl Instance {
    /// Creates the unit of a kind for the machine of a robot file.
    ///
    /// # Errors
    /// [`CallRefused`]: the file lacks something, which is named.
    pub fn new(kind: Kind, robot: AnyRobotFile) -> Result<Self, CallRefused> {
        let Model {
            unit,
            variables,
            guid,
        } = Model::new(kind, robot)?;
        let fresh = Saved {
            mode: Mode::Instantiated,
            clock: SimulatedTime::default(),
            values: Values::starts(&variables),
            unit,
        };
        Ok(Self {
            now: fresh.clone(),
            fresh,
            variables,
            guid,
            log: Log::default(),
        })
    }

    /// Returns the variables; their value references are their places.
    #[must_use]
    pub fn variables(&self) -> &[Variable] {
        &self.variables
    }

    /// Returns the GUID, which tells whether a description belongs to this unit.
    #[must_use]
    pub fn guid(&self) -> &str {
        &self.guid
    }

    /// Returns the value reference of a name.
    #[must_use]
    pub fn reference_of(&self, name: &str) -> Option<u32> {
        let mut variables = self.variables.iter();
        let place = variables.position(|variable| variable.name == name)?;
        u32::try_from(place).ok()
    }

    /// Returns the variable of a value reference, if it has this type.
    ///
    /// # Errors
    /// [`CallRefused`].
    pub fn variable(&self, reference: u32, access: Access) -> Result<&Variable, CallRefused> {
        let variable = self.known(reference)?;
        if variable.access() == access {
            return Ok(variable);
        }
        let own = variable.access();
        Err(format!("{}: is {own}, not {access}", variable.name).into())
    }

    fn known(&self, reference: u32) -> Result<&Variable, CallRefused> {
        let place = usize::try_from(reference).ok();
        place
            .and_then(|place| self.variables.get(place))
            .ok_or_else(|| {
                let count = self.variables.len();
                format!("value reference {reference}: unknown; there are {count} variables").into()
            })
    }

    /// Refuses a call that must not come now.
    fn expect(&self, call: &str, modes: &[Mode]) -> Result<(), CallRefused> {
        let mode = self.now.mode;
        if modes.contains(&mode) {
            return Ok(());
        }
        Err(format!("{call}: not now; the unit is {mode}").into())
    }

    /// Takes the time of the experiment, s.
    ///
    /// # Errors
    /// [`CallRefused`]: out of turn; times that are not finite, or an end before the start.
    pub fn setup_experiment(&mut self, start: f64, stop: Option<f64>) -> Result<(), CallRefused> {
        self.expect("setup of the experiment", &[Mode::Instantiated])?;
        self.now.clock = SimulatedTime::new(start, stop)?;
        Ok(())
    }

    /// Begins the initialization.
    ///
    /// # Errors
    /// [`CallRefused`]: out of turn.
    pub fn enter_initialization(&mut self) -> Result<(), CallRefused> {
        self.expect("initialization", &[Mode::Instantiated])?;
        self.now.mode = Mode::Initializing;
        Ok(())
    }

    /// Ends the initialization: the unit begins with the values that are set.
    ///
    /// # Errors
    /// [`CallRefused`]: out of turn; it cannot begin so.
    pub fn exit_initialization(&mut self) -> Result<(), CallRefused> {
        self.expect("end of the initialization", &[Mode::Initializing])?;
        self.now.unit.begin(&mut self.now.values)?;
        self.now.mode = Mode::Running;
        Ok(())
    }

    /// Ends the simulation; values can still be read.
    ///
    /// # Errors
    /// [`CallRefused`]: out of turn.
    pub fn terminate(&mut self) -> Result<(), CallRefused> {
        self.expect("end of the simulation", &[Mode::Running])?;
        self.now.mode = Mode::Terminated;
        Ok(())
    }

    /// Returns to where the unit was when it was made.
    pub fn reset(&mut self) {
        self.now = self.fresh.clone();
    }

    /// Returns a value. Outputs have one from the initialization on.
    ///
    /// # Errors
    /// [`CallRefused`]: out of turn; an unknown reference.
    pub fn get(&self, reference: u32) -> Result<f64, CallRefused> {
        let variable = self.known(reference)?;
        if self.now.mode == Mode::Instantiated {
            let mode = self.now.mode;
            return Err(format!("{}: cannot be read; the unit is {mode}", variable.name).into());
        }
        self.now
            .values
            .at(reference)
            .ok_or_else(|| CallRefused::because("a variable has no value"))
    }

    /// Sets a parameter or an input.
    ///
    /// # Errors
    /// [`CallRefused`]: out of turn; an unknown reference; an output; a value that is NaN or out of its
    /// range. The sentence names the variable.
    pub fn set(&mut self, reference: u32, value: f64) -> Result<(), CallRefused> {
        self.settable(reference, value)?;
        self.now.values.put_at(reference, value);
        Ok(())
    }

    /// Sets several, or none of them.
    ///
    /// # Errors
    /// As [`set`](Self::set).
    pub fn set_all(&mut self, pairs: &[(u32, f64)]) -> Result<(), CallRefused> {
        for (reference, value) in pairs {
            self.settable(*reference, *value)?;
        }
        for (reference, value) in pairs {
            self.now.values.put_at(*reference, *value);
        }
        Ok(())
    }

    fn settable(&self, reference: u32, value: f64) -> Result<(), CallRefused> {
        let variable = self.known(reference)?;
        let name = &variable.name;
        let mode = self.now.mode;
        let is_before = matches!(mode, Mode::Instantiated | Mode::Initializing);
        match variable.causality {
            Causality::Output => Err(format!("{name}: is an output").into()),
            Causality::Parameter if !is_before => {
                Err(format!("{name}: is a parameter; the unit is {mode}").into())
            }
            Causality::Input if !(is_before || mode == Mode::Running) => {
                Err(format!("{name}: cannot be set; the unit is {mode}").into())
            }
            _ => Ok(variable.check(value)?),
        }
    }

    /// Computes the cycles of a communication step of this length (s) at this time (s), with the inputs
    /// that are set.
    ///
    /// # Errors
    /// [`CallRefused`]: out of turn; a step that is no whole multiple of the cycle, beyond the end or too
    /// long; another time than that of the unit; a cycle that fails, after which the unit is left
    /// there.
    pub fn step(&mut self, time: f64, length: f64) -> Result<(), CallRefused> {
        self.expect("step", &[Mode::Running])?;
        let cycles = self.now.clock.cycles(time, length)?;
        for _ in 0..cycles {
            let Saved { unit, values, .. } = &mut self.now;
            if let Err(reason) = unit.cycle(values, &mut self.log) {
                self.now.mode = Mode::Failed;
                return Err(reason.into());
            }
            self.now.clock.advance();
        }
        Ok(())
    }

    /// Returns the time of the unit, s.
    #[must_use]
    pub fn time(&self) -> f64 {
        self.now.clock.time()
    }

    /// Returns the warnings since the last call.
    pub fn take_warnings(&mut self) -> Vec<String> {
        self.log.take()
    }

    /// Returns a copy of the state.
    #[must_use]
    pub fn save(&self) -> Saved {
        self.now.clone()
    }

    /// Goes on from a state that was saved of this unit.
    pub fn restore(&mut self, saved: &Saved) {
        self.now = saved.clone();
    }
}
