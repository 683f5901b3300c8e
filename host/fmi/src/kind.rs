//! Kinds of units.

use std::fmt;
use std::str::FromStr;

use crate::variable::Variable;

/// Text of a library of units, and of no other: which version it has.
pub const MARK: &str = concat!("gantry-tau units ", env!("CARGO_PKG_VERSION"));

/// Kind of a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Server and compensating client: session, limits and ramp are inside.
    Server,
    /// Simulated machine: drives, springs, masses, instruments.
    Machine,
    /// Compensation alone, from a force to targets, without a session and its limits.
    Compensator,
}

/// Text that names no kind.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is not a kind; expected server, machine or compensator")]
pub struct UnknownKind(String);

impl Kind {
    /// Every kind.
    pub const ALL: [Self; 3] = [Self::Server, Self::Machine, Self::Compensator];

    /// Name in options and files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Server => "server",
            Self::Machine => "machine",
            Self::Compensator => "compensator",
        }
    }

    /// Description of a unit of this kind.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::Server => {
                "Server and compensating client: force and nominal positions to references, within limits"
            }
            Self::Machine => {
                "Simulated machine: references and load to positions, displacement and force reading"
            }
            Self::Compensator => {
                "Compensation alone: force and nominal positions to targets, without a session"
            }
        }
    }

    /// Name of its library in the unit, without the extension.
    #[must_use]
    pub const fn model_identifier(self) -> &'static str {
        match self {
            Self::Server => "gantry_tau_server",
            Self::Machine => "gantry_tau_machine",
            Self::Compensator => "gantry_tau_compensator",
        }
    }

    /// Returns the GUID of a unit of this kind: it tells kind and number of axes, and the fingerprint
    /// of version and variables.
    pub(crate) fn guid(self, axes: usize, variables: &[Variable]) -> String {
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(MARK.as_bytes());
        for variable in variables {
            hasher.update(variable.fingerprint().as_bytes());
        }
        format!("{{{}-{axes}-{:08x}}}", self.name(), hasher.finalize())
    }

    /// Returns the kind that a GUID tells.
    ///
    /// # Errors
    /// [`UnknownKind`].
    pub fn of_guid(guid: &str) -> Result<Self, UnknownKind> {
        let inner = guid.trim_start_matches('{');
        inner.split('-').next().unwrap_or_default().parse()
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Kind {
    type Err = UnknownKind;

    fn from_str(text: &str) -> Result<Self, UnknownKind> {
        let mut kinds = Self::ALL.into_iter();
        kinds
            .find(|kind| kind.name() == text)
            .ok_or_else(|| UnknownKind(text.to_owned()))
    }
}
