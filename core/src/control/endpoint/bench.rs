//! An endpoint for tests, and its ticks as a host sees them.

use std::vec::Vec as StdVec;

use super::{CONNECTIONS, Endpoint, FRAMES, Transport, Write};
use crate::control::axis::{Offsets, Reference};
use crate::control::fixture::{command, on_time};
use crate::control::message::{ClientMessage, Mode, ServerMessage};
use crate::control::session::config::{Config, Parameters};
use crate::control::session::{Connection, Output, Reading, Session, Start, TickInput};
use crate::control::wire::{Frame, FrameBytes, decode_server, encode_client};
use crate::units::{EpochRange, PositionNm};

pub(crate) const NOMINAL: [PositionNm; 2] = [PositionNm(0), PositionNm(1_000)];

/// One tick.
pub(crate) struct Ticked {
    pub(crate) references: [Reference; 2],
    pub(crate) output: Output<2>,
    pub(crate) sent: StdVec<(Connection, StdVec<u8>)>,
    pub(crate) close: StdVec<Connection>,
}

impl Ticked {
    /// The sent messages and their recipients.
    pub(crate) fn messages(&self) -> StdVec<(Connection, ServerMessage<2>)> {
        self.sent
            .iter()
            .map(|(to, bytes)| {
                let frame = Frame::parse(bytes).unwrap();
                (*to, decode_server(&frame).unwrap())
            })
            .collect()
    }
}

pub(crate) struct Bench {
    pub(crate) endpoint: Endpoint<2>,
    sequence: u64,
}

impl Bench {
    pub(crate) fn new(parameters: Parameters<2>) -> Self {
        let session =
            Session::new(Config::new(parameters).unwrap(), &Start::at_rest(NOMINAL)).unwrap();
        Self {
            endpoint: Endpoint::new(session, EpochRange::VOLATILE),
            sequence: 0,
        }
    }

    pub(crate) fn open(&mut self, transport: Transport) -> Connection {
        self.endpoint.open(transport).unwrap()
    }

    /// The next command to answer the last State.
    pub(crate) fn command(&mut self, mode: Mode, targets: [Offsets; 2]) -> FrameBytes {
        self.sequence += 1;
        encode_client(&ClientMessage::Command(command(
            self.endpoint.session(),
            self.sequence,
            mode,
            targets,
        )))
    }

    pub(crate) fn input() -> TickInput<2> {
        TickInput {
            reading: Some(Reading::unmeasured(NOMINAL)),
            ..on_time()
        }
    }

    pub(crate) fn tick(&mut self) -> Ticked {
        let Write::Due(write) = self.endpoint.tick(&Self::input()) else {
            panic!("nothing to write");
        };
        let references = *write.references();
        write.accepted();
        assert!(self.endpoint.is_valid());
        let mut sent = StdVec::new();
        while let Some((to, frame)) = self.endpoint.poll_transmit() {
            sent.push((to, frame.to_vec()));
            assert!(sent.len() <= FRAMES);
        }
        let output = self.endpoint.output().unwrap().clone();
        let close = core::iter::from_fn(|| self.endpoint.poll_close())
            .take(CONNECTIONS + 1)
            .collect();
        assert!(self.endpoint.is_valid());
        Ticked {
            references,
            output,
            sent,
            close,
        }
    }
}
