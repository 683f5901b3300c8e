//! Sample types of a stream that a monitor reads, found once by their definitions.

use gantry_tau_labcomm::samples::{Axes, SessionEvent, State, Tool};
use gantry_tau_labcomm::{Definition, Sample};
use gantry_tau_server::publication::{DriveStates, MachineIdentity};

use super::stream::StreamError;

/// Sample type that a monitor reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SampleType {
    State,
    Axes3,
    Axes6,
    Tool,
    SessionEvent,
    Drives3,
    Drives6,
    Machine,
}

impl SampleType {
    const ALL: [Self; 8] = [
        Self::State,
        Self::Axes3,
        Self::Axes6,
        Self::Tool,
        Self::SessionEvent,
        Self::Drives3,
        Self::Drives6,
        Self::Machine,
    ];

    /// Name of the sample.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::State => State::NAME,
            Self::Axes3 => Axes::<3>::NAME,
            Self::Axes6 => Axes::<6>::NAME,
            Self::Tool => Tool::NAME,
            Self::SessionEvent => SessionEvent::NAME,
            Self::Drives3 => DriveStates::<3>::NAME,
            Self::Drives6 => DriveStates::<6>::NAME,
            Self::Machine => MachineIdentity::NAME,
        }
    }

    fn is(self, definition: &Definition<'_>) -> bool {
        match self {
            Self::State => definition.is::<State>(),
            Self::Axes3 => definition.is::<Axes<3>>(),
            Self::Axes6 => definition.is::<Axes<6>>(),
            Self::Tool => definition.is::<Tool>(),
            Self::SessionEvent => definition.is::<SessionEvent>(),
            Self::Drives3 => definition.is::<DriveStates<3>>(),
            Self::Drives6 => definition.is::<DriveStates<6>>(),
            Self::Machine => definition.is::<MachineIdentity>(),
        }
    }
}

/// Sample types of a stream by their indices.
#[derive(Clone, Debug, Default)]
pub(super) struct SampleTypes(Vec<(u32, SampleType)>);

impl SampleTypes {
    /// Adds the type of a definition; others than those of a monitor are passed over.
    ///
    /// # Errors
    /// [`StreamError::OtherType`]: the name of one, with another type.
    pub(super) fn define(&mut self, definition: &Definition<'_>) -> Result<(), StreamError> {
        let mut all = SampleType::ALL.into_iter();
        if let Some(sample) = all.find(|sample| sample.is(definition)) {
            if self.of(definition.index).is_none() {
                self.0.push((definition.index, sample));
            }
            return Ok(());
        }
        match SampleType::ALL
            .into_iter()
            .map(SampleType::name)
            .find(|name| name.as_bytes() == definition.name)
        {
            Some(name) => Err(StreamError::OtherType { name }),
            None => Ok(()),
        }
    }

    /// Returns the type of an index; `None` if a monitor does not read it.
    ///
    /// # Errors
    /// [`StreamError::Missing`]: samples come, and one that is needed is not defined.
    pub(super) fn needed(&self, index: u32) -> Result<Option<SampleType>, StreamError> {
        let missing = if !self.has(SampleType::State) {
            SampleType::State
        } else if !self.has(SampleType::Axes3) && !self.has(SampleType::Axes6) {
            SampleType::Axes3
        } else {
            return Ok(self.of(index));
        };
        Err(StreamError::Missing {
            name: missing.name(),
        })
    }

    /// True if a type is defined.
    pub(super) fn has(&self, sample: SampleType) -> bool {
        self.0.iter().any(|(_, defined)| *defined == sample)
    }

    fn of(&self, index: u32) -> Option<SampleType> {
        let mut all = self.0.iter();
        all.find(|(defined, _)| *defined == index)
            .map(|(_, sample)| *sample)
    }
}
