//! An endpoint with keys.

use super::gate::{Budget, Coming, Gate, Greeting};
use super::slot::keyed::Heard;
use super::slot::{Answer, Slot};
use super::{Endpoint, Full, Greeted, Transport, find};
use crate::control::keys::{KeyId, Keyring};
use crate::control::message::{Challenge, KeyedHello, Refusal};
use crate::control::session::{Connection, Event, Input, Session};
use crate::control::wire::{Body, FrameBytes, Kind, Sealed, Suite};
use crate::units::EpochRange;

impl<const N: usize> Endpoint<N> {
    /// Creates an endpoint whose frames have tags: only holders of these keys are heard. `budget`
    /// bounds what others cost per tick.
    ///
    /// Over datagrams a peer without a connection is heard by [`Self::greet`] only.
    #[must_use]
    pub fn keyed(
        session: Session<N>,
        epochs: EpochRange,
        keyring: Keyring,
        budget: Budget,
    ) -> Self {
        Self {
            gate: Some(Gate::new(keyring, budget)),
            ..Self::new(session, epochs)
        }
    }

    /// Returns the name of the key of the current session; `None` without one.
    #[must_use]
    pub fn granted_key(&self) -> Option<KeyId> {
        hello_of(&self.slots, self.session.owner()?).map(|hello| hello.key)
    }

    /// As [`Self::greet`].
    pub(super) fn greet_keyed(&mut self, peer: &[u8; 18], datagram: &[u8]) -> Greeted<'_> {
        let Some(gate) = &mut self.gate else {
            return Greeted::Nothing;
        };
        let greeting = match Sealed::parse(datagram, Suite::Tag) {
            Ok(sealed) => gate.judge(sealed, peer, &coming(&self.session, &self.input.epochs)),
            Err(_) => Greeting::Silence,
        };
        match greeting {
            Greeting::Silence => {
                count_unauthentic(&mut self.input);
                Greeted::Nothing
            }
            Greeting::Challenge(hello, cookie) => {
                self.answer(&hello, Kind::Challenge, &Challenge { cookie })
            }
            Greeting::ReadOnly(hello) => self.answer(&hello, Kind::Refusal, &Refusal::Role),
            Greeting::Proven(hello) => match self.open(Transport::Datagram) {
                Ok(connection) => {
                    let slot = find(&mut self.slots, connection);
                    let heard = slot.map(|slot| slot.greeted(greeting));
                    if let Some(Heard::Frame(Some(event))) = heard {
                        self.admit(connection, event, false);
                    }
                    Greeted::Peer(connection)
                }
                Err(Full) => self.answer(&hello, Kind::Refusal, &Refusal::Unavailable),
            },
        }
    }

    /// Encloses an answer to a Hello of a peer without a connection.
    fn answer<B: Body>(&mut self, hello: &KeyedHello, kind: Kind, body: &B) -> Greeted<'_> {
        self.frame.enclose(kind, body);
        if let Some(gate) = &self.gate {
            gate.tag_answer(Some(hello), &mut self.frame);
        }
        Greeted::Answer(&self.frame)
    }
}

/// Decodes the next frame of a connection, and counts it if it is not authentic.
pub fn decode<const N: usize>(
    slot: &mut Slot,
    bytes: &[u8],
    is_owner: bool,
    gate: &mut Gate,
    session: &Session<N>,
    input: &mut Input<N>,
) -> Option<(Option<Event<N>>, usize)> {
    let coming = coming(session, &input.epochs);
    let (heard, consumed) = slot.decode_keyed(bytes, is_owner, gate, &coming)?;
    let event = match heard {
        Heard::Frame(event) => event,
        Heard::Nothing => {
            count_unauthentic(input);
            None
        }
    };
    Some((event, consumed))
}

fn count_unauthentic<const N: usize>(input: &mut Input<N>) {
    input.unauthentic = input.unauthentic.saturating_add(1);
}

fn coming<'a, const N: usize>(session: &'a Session<N>, epochs: &EpochRange) -> Coming<'a, N> {
    Coming {
        session,
        epoch: epochs.after(session.epoch()),
    }
}

/// Encloses an answer of a slot.
pub fn enclose(answer: Answer, frame: &mut FrameBytes) {
    match answer {
        Answer::Notice(notice) => frame.notice(notice),
        Answer::Challenge(challenge) => frame.enclose(Kind::Challenge, &challenge),
        Answer::ReadOnly => frame.enclose(Kind::Refusal, &Refusal::Role),
    }
}

/// Returns the Hello of a connection.
#[inline(never)]
pub(super) fn hello_of(slots: &[Slot], connection: Connection) -> Option<&KeyedHello> {
    let slot = slots.iter().find(|slot| slot.connection == connection)?;
    slot.hello.as_ref()
}

/// Tags an answer to a Hello, if there are keys.
pub(super) fn tag_answer(
    gate: &Option<Gate>,
    slots: &[Slot],
    connection: Connection,
    frame: &mut FrameBytes,
) {
    if let Some(gate) = gate {
        gate.tag_answer(hello_of(slots, connection), frame);
    }
}

#[cfg(test)]
mod tests;
