//! Sample types of a stream that a monitor reads, found once by their definitions.

use gantry_tau_labcomm::samples::{Axes, SessionEvent, State, Tool};
use gantry_tau_labcomm::{Definition, Sample};

use super::stream::StreamError;
use crate::publication::{Drives, Machine};

/// Sample type that a monitor reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    State,
    Axes3,
    Axes6,
    Tool,
    SessionEvent,
    Drives3,
    Drives6,
    Machine,
}

impl Kind {
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
            Self::Drives3 => Drives::<3>::NAME,
            Self::Drives6 => Drives::<6>::NAME,
            Self::Machine => Machine::NAME,
        }
    }

    fn is(self, definition: &Definition<'_>) -> bool {
        match self {
            Self::State => definition.is::<State>(),
            Self::Axes3 => definition.is::<Axes<3>>(),
            Self::Axes6 => definition.is::<Axes<6>>(),
            Self::Tool => definition.is::<Tool>(),
            Self::SessionEvent => definition.is::<SessionEvent>(),
            Self::Drives3 => definition.is::<Drives<3>>(),
            Self::Drives6 => definition.is::<Drives<6>>(),
            Self::Machine => definition.is::<Machine>(),
        }
    }
}

/// Indices of these types in a stream.
#[derive(Clone, Debug, Default)]
pub(super) struct Known(Vec<(u32, Kind)>);

impl Known {
    /// Takes a definition; others than those of a monitor are passed over.
    ///
    /// # Errors
    /// [`StreamError::OtherType`]: the name of one, with another type.
    pub(super) fn define(&mut self, definition: &Definition<'_>) -> Result<(), StreamError> {
        if let Some(kind) = Kind::ALL.into_iter().find(|kind| kind.is(definition)) {
            if self.find(definition.index).is_none() {
                self.0.push((definition.index, kind));
            }
            return Ok(());
        }
        match Kind::ALL.into_iter().map(Kind::name).find(|name| name.as_bytes() == definition.name) {
            Some(name) => Err(StreamError::OtherType { name }),
            None => Ok(()),
        }
    }

    /// Type of an index; `None` if a monitor does not read it.
    ///
    /// # Errors
    /// [`StreamError::Missing`]: samples come, and one that is needed is not defined.
    pub(super) fn kind(&self, index: u32) -> Result<Option<Kind>, StreamError> {
        let needed = [self.has(Kind::State), self.has(Kind::Axes3) || self.has(Kind::Axes6)];
        match needed {
            [true, true] => Ok(self.find(index)),
            [false, _] => Err(StreamError::Missing { name: Kind::State.name() }),
            [true, false] => Err(StreamError::Missing { name: Kind::Axes3.name() }),
        }
    }

    /// True if a type is defined.
    pub(super) fn has(&self, kind: Kind) -> bool {
        self.0.iter().any(|(_, known)| *known == kind)
    }

    fn find(&self, index: u32) -> Option<Kind> {
        self.0.iter().find(|(known, _)| *known == index).map(|(_, kind)| *kind)
    }
}
