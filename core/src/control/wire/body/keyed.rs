//! Bodies of the messages before a session with keys, and parts of others that are read before their
//! tags are checked.

use super::super::cursor::{Reader, Short, Writer};
use super::{Body, ContentError, reader};
use crate::control::keys::KeyId;
use crate::control::message::{Challenge, Command, Hello, KeyedHello};
use crate::units::{Epoch, Sequence, Tick};

/// Returns epoch, sequence and echo in the body of a Command; `None` for a wrong length.
pub(crate) fn claims_of_command<const N: usize>(body: &[u8]) -> Option<(Epoch, Sequence, Tick)> {
    let mut r = reader::<Command<N>>(body).ok()?;
    let (epoch, sequence, echo) = (r.u64().ok()?, r.u64().ok()?, r.u64().ok()?);
    Some((Epoch(epoch), Sequence(sequence), Tick(echo)))
}

/// Returns epoch, number of axes and checksum of the kinematics in the body of a Welcome for any number
/// of axes.
pub(crate) fn session_of_welcome(body: &[u8]) -> Option<(Epoch, u8, u32)> {
    let mut r = Reader::new(body);
    let epoch = Epoch(r.u64().ok()?);
    let _tick_cycle_and_window: [u8; 13] = r.read_exact().ok()?;
    let axes = r.u8().ok()?;
    let _capabilities = r.u16().ok()?;
    Some((epoch, axes, r.u32().ok()?))
}

impl Body for KeyedHello {
    const LENGTH: usize = Hello::LENGTH + 8 + 16 + 16;

    fn write(&self, body: &mut [u8]) -> Result<(), Short> {
        let (hello, rest) = body.split_at_mut_checked(Hello::LENGTH).ok_or(Short)?;
        self.hello.write(hello)?;
        let mut w = Writer::new(rest);
        w.bytes(self.key.0)?;
        w.bytes(self.nonce)?;
        w.bytes(self.cookie)
    }

    fn read(body: &[u8]) -> Result<Self, ContentError> {
        reader::<Self>(body)?;
        let (hello, rest) = body.split_at_checked(Hello::LENGTH).ok_or(Short)?;
        let mut r = Reader::new(rest);
        Ok(Self {
            hello: Hello::read(hello)?,
            key: KeyId(r.read_exact()?),
            nonce: r.read_exact()?,
            cookie: r.read_exact()?,
        })
    }
}

impl Body for Challenge {
    const LENGTH: usize = 16;

    fn write(&self, body: &mut [u8]) -> Result<(), Short> {
        Writer::new(body).bytes(self.cookie)
    }

    fn read(body: &[u8]) -> Result<Self, ContentError> {
        let cookie = reader::<Self>(body)?.read_exact()?;
        Ok(Self { cookie })
    }
}
