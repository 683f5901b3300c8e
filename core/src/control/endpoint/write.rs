//! References of a tick, and what becomes of them.
//!
//! The embedder owes the endpoint one answer per tick. It settles both what the State of this tick
//! reports and what the next tick goes on from, so the two cannot differ. An answer that never comes
//! is *unknown*, and stops.

use crate::control::axis::{InForce, Reference};
use crate::control::session::{LastWrite, Output, Session};

/// Result of [`super::Endpoint::tick`].
#[must_use = "write the references, then say what became of them; not said is unknown, which stops"]
#[derive(Debug)]
pub enum Write<'a, const N: usize> {
    /// The references are to be written to the drives before anything else.
    Due(PendingWrite<'a, N>),
    /// Nothing may be written: the values in force at the drives are unknown or beyond their limits.
    /// They are to be read back.
    Withheld(PendingReadBack<'a, N>),
}

/// References that are to be written. Consumed by what became of them.
#[must_use = "not said is unknown, which stops"]
#[derive(Debug)]
pub struct PendingWrite<'a, const N: usize>(Pending<'a, N>);

/// A tick without references. Consumed by the values in force at the drives.
#[must_use = "not said is unknown, which stops"]
#[derive(Debug)]
pub struct PendingReadBack<'a, const N: usize>(Pending<'a, N>);

/// A tick that waits for the fate of its references.
#[derive(Debug)]
pub(crate) struct Pending<'a, const N: usize> {
    session: &'a Session<N>,
    output: &'a mut Output<N>,
    /// Fate that the next tick goes on from: unknown, unless it is told.
    last_write: &'a mut LastWrite<N>,
    is_told: &'a mut bool,
}

impl<'a, const N: usize> Write<'a, N> {
    /// Returns the references of a tick, of which nothing is told.
    pub(crate) const fn of(
        session: &'a Session<N>,
        output: &'a mut Output<N>,
        last_write: &'a mut LastWrite<N>,
        is_told: &'a mut bool,
    ) -> Self {
        *last_write = LastWrite::Unknown;
        *is_told = false;
        let withheld = output.withheld;
        let pending = Pending {
            session,
            output,
            last_write,
            is_told,
        };
        if withheld {
            Self::Withheld(PendingReadBack(pending))
        } else {
            Self::Due(PendingWrite(pending))
        }
    }

    const fn pending(&self) -> &Pending<'a, N> {
        match self {
            Self::Due(PendingWrite(pending)) | Self::Withheld(PendingReadBack(pending)) => pending,
        }
    }

    /// Returns the output of the tick, whose State is that of references that the drives take: for the
    /// stop latch, and for a log.
    #[must_use]
    pub const fn output(&self) -> &Output<N> {
        self.pending().output
    }

    /// Returns the parts of the references: what is in force once the drives have taken them.
    #[must_use]
    pub fn parts(&self) -> [InForce; N] {
        self.pending().session.demanded()
    }

    /// Takes note that nothing is known of the drives: [`PendingWrite::unknown`],
    /// [`PendingReadBack::unknown`].
    pub fn unknown(self) {
        match self {
            Self::Due(write) => write.unknown(),
            Self::Withheld(drives) => drives.unknown(),
        }
    }
}

impl<const N: usize> PendingWrite<'_, N> {
    /// Returns the references of the axes. [`super::MotorMap::spread`] has those of the motors.
    #[must_use]
    pub const fn references(&self) -> &[Reference; N] {
        &self.0.output.references
    }

    /// Returns the parts of the references: what is in force once the drives have taken them.
    #[must_use]
    pub fn parts(&self) -> [InForce; N] {
        self.0.session.demanded()
    }

    /// Takes note that the drives have taken the references.
    pub fn accepted(self) {
        *self.0.last_write = LastWrite::Accepted;
        *self.0.is_told = true;
    }

    /// Takes note that the drives have not taken the references, which stops; they were read back and
    /// have these values in force. Values beyond the limits count as unknown.
    pub fn refused(self, in_force: [InForce; N]) {
        self.0.tell(Some(&in_force));
    }

    /// Takes note that the drives may have taken any part of the references, which stops. Nothing is
    /// written until they are read back.
    pub fn unknown(self) {
        self.0.tell(None);
    }
}

impl<const N: usize> PendingReadBack<'_, N> {
    /// Takes note that the drives were read back, and have these values in force. The next tick goes on
    /// from them, unless they are beyond the limits.
    pub fn read_back(self, in_force: [InForce; N]) {
        self.0.tell(Some(&in_force));
    }

    /// Takes note that the drives cannot be read back.
    pub fn unknown(self) {
        self.0.tell(None);
    }
}

impl<const N: usize> Pending<'_, N> {
    /// Settles references that are not in force. The State reports what is: the values read back, if
    /// they are within their limits, else those of before.
    fn tell(self, read_back: Option<&[InForce; N]>) {
        *self.is_told = true;
        if let Some(in_force) = read_back {
            *self.last_write = LastWrite::Refused {
                in_force: *in_force,
            };
        }
        let known = read_back.filter(|in_force| self.session.admits(in_force));
        report(self.output, known.unwrap_or(self.session.in_force()));
    }
}

/// Lets the State report these values as in force.
pub(super) fn report<const N: usize>(output: &mut Output<N>, in_force: &[InForce; N]) {
    for (axis, in_force) in output.state.axes.iter_mut().zip(in_force) {
        axis.nominal = in_force.nominal;
        axis.offsets = in_force.offsets;
    }
}
