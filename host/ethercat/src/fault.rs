//! Faults of a running bus, by name.

use std::fmt;

use ethercrab::AlStatusCode;

use crate::cia402::{CSP, PowerState};
use crate::steering::SteeringFault;

/// Reason why a cycle failed. Motors are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// No answer came in time.
    NoAnswer,
    /// An answer came, and its working counter is wrong: at least one drive did not take the
    /// references, or did not give its measurements.
    WorkingCounter {
        /// Number that the drives together add.
        expected: u16,
        /// Number that they added.
        received: u16,
    },
    /// A drive does not answer.
    Absent {
        /// The motor.
        motor: u8,
    },
    /// A drive left OP.
    State {
        /// The motor.
        motor: u8,
        /// State of the application layer: 1 INIT, 2 PRE-OP, 4 SAFE-OP.
        state: u8,
        /// AL status code.
        code: u16,
    },
    /// A drive reports a fault.
    Drive {
        /// The motor.
        motor: u8,
        /// Error code, 603Fh; 0 when it is not known.
        error_code: u16,
    },
    /// A drive reports a following error.
    FollowingError {
        /// The motor.
        motor: u8,
    },
    /// A drive is in another mode of operation than cyclic synchronous position: it would take the
    /// references for something else.
    Mode {
        /// The motor.
        motor: u8,
        /// Mode, 6061h.
        mode: i8,
    },
    /// A drive does not follow its references: it is not in operation enabled.
    NotEnabled {
        /// The motor.
        motor: u8,
        /// Its state.
        state: PowerState,
    },
    /// The cycle does not follow the reference clock of the bus.
    Clock(SteeringFault),
    /// The cycle did not come into phase with SYNC0 within 5 s at the start.
    NotInPhase,
    /// The references of a frame without a right answer were sent again, in place of those of this
    /// cycle, and the drives have them.
    Resent,
    /// The process image has another length than was mapped.
    Image,
    /// The drives are not started yet.
    NotStarted,
    /// The drives are being enabled again after a re-arm.
    Rearming,
}

impl Fault {
    /// True for a fault that one cycle can have and the next one not: nothing but a frame is lost.
    #[must_use]
    pub const fn is_of_one_cycle(&self) -> bool {
        matches!(
            self,
            Self::NoAnswer | Self::WorkingCounter { .. } | Self::Absent { .. }
        )
    }

    /// Returns the motor that it concerns.
    #[must_use]
    pub const fn motor(&self) -> Option<u8> {
        match self {
            Self::Absent { motor }
            | Self::State { motor, .. }
            | Self::Drive { motor, .. }
            | Self::FollowingError { motor }
            | Self::Mode { motor, .. }
            | Self::NotEnabled { motor, .. } => Some(*motor),
            Self::NoAnswer
            | Self::WorkingCounter { .. }
            | Self::Clock(_)
            | Self::NotInPhase
            | Self::Resent
            | Self::Image
            | Self::NotStarted
            | Self::Rearming => None,
        }
    }

    /// Returns a code that tells more: AL status code, error code of the drive, or working counter.
    #[must_use]
    pub const fn code(&self) -> Option<u16> {
        match self {
            Self::State { code, .. } => Some(*code),
            Self::Drive { error_code, .. } if *error_code != 0 => Some(*error_code),
            Self::WorkingCounter { received, .. } => Some(*received),
            _ => None,
        }
    }

    /// Returns the fault's name.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::NoAnswer => "no answer on the bus in time",
            Self::WorkingCounter { .. } => "the working counter is wrong",
            Self::Absent { .. } => "the drive does not answer",
            Self::State { .. } => "the drive left OP",
            Self::Drive { .. } => "the drive is in fault",
            Self::FollowingError { .. } => "following error",
            Self::Mode { .. } => "the drive is in another mode of operation",
            Self::NotEnabled { .. } => "the drive is not in operation enabled",
            Self::Clock(SteeringFault::Phase { .. }) => {
                "the cycle does not follow the clock of the bus: frames pass far from their place before SYNC0"
            }
            Self::Clock(SteeringFault::Standing) => {
                "the cycle does not follow the clock of the bus: the time of the reference does not go on"
            }
            Self::Clock(SteeringFault::Drift) => {
                "the cycle does not follow the clock of the bus: the clocks of PC and bus differ by more than 1000 ppm"
            }
            Self::NotInPhase => "the cycle was not in phase with SYNC0 within 5 s",
            Self::Resent => "the references of a lost frame were sent again",
            Self::Image => "the process data has another length than was mapped",
            Self::NotStarted => "the drives are not started",
            Self::Rearming => "the drives are being enabled again",
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(motor) = self.motor() {
            write!(f, "motor {motor}: ")?;
        }
        f.write_str(self.name())?;
        match self {
            Self::WorkingCounter { expected, received } => {
                write!(f, " ({received}, expected {expected})")
            }
            Self::State { state, code, .. } => {
                write!(
                    f,
                    " (state {state}, AL status code {})",
                    AlStatusCode::from(*code)
                )
            }
            Self::Drive { error_code, .. } if *error_code != 0 => {
                write!(f, " (error code {error_code:04X}h)")
            }
            Self::Mode { mode, .. } => write!(f, " (6061h: {mode}, expected {CSP})"),
            Self::NotEnabled { state, .. } => write!(f, " ({})", state.name()),
            Self::Clock(SteeringFault::Phase { phase_us }) => write!(f, " ({phase_us} us)"),
            _ => Ok(()),
        }
    }
}

impl std::error::Error for Fault {}
