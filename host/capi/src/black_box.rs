//! The black box as a file of parts, one at a time into the caller's buffer: a head, the session
//! before the oldest tick, the ticks.
//!
//! Head: `GTBB`, version 8, number of axes, number of ticks (`u32`, little-endian). Every other
//! part: its length (`u32`, little-endian), then core's types as `postcard` writes them.
//! `gantry-tau replay` reads the file.

use gantry_tau_core::control::session::BlackBox;
use postcard::ser_flavors::Flavor;
use serde::Serialize;

use crate::code::gt_code;
use crate::error::small;
use crate::memory::Reply;
use crate::padding::padded;

/// Longest part of a black box, bytes.
pub const GT_BLACK_BOX_PART: usize = 4_096;

/// Version of the file; version 1 was lines of JSON.
const VERSION: u8 = 8;
/// Parts before the first tick: the head, and the session before the oldest tick.
const HEAD: usize = 2;
/// Bytes of the length before a part.
const LENGTH: usize = 4;

/// Contents of a black box.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_black_box {
    /// Ticks recorded, at most 3 GT_BLACK_BOX_TICKS.
    pub ticks: u32,
    /// Parts of its file; 0 while no tick is recorded.
    pub parts: u32,
    /// Not 0: the end of a session has frozen it, GT_BLACK_BOX_TICKS ticks ago. It records again
    /// after gt_server_black_box_release.
    pub frozen: u8,
}

padded! {
    gt_black_box { ticks parts frozen }
}

/// Returns the contents of a black box.
pub(crate) fn look<const N: usize, const TICKS: usize>(
    black_box: &BlackBox<N, TICKS>,
) -> gt_black_box {
    let ticks = black_box.entries().count();
    let parts = if ticks == 0 {
        0
    } else {
        ticks.saturating_add(HEAD)
    };
    gt_black_box {
        ticks: small(ticks),
        parts: small(parts),
        frozen: black_box.is_frozen().into(),
    }
}

/// Writes one part of the file. Returns its length, whether it fits or not.
pub(crate) fn write_part<const N: usize, const TICKS: usize>(
    black_box: &BlackBox<N, TICKS>,
    index: usize,
    room: &mut [u8],
) -> Reply<usize> {
    let ticks = black_box.entries().count();
    let before = black_box
        .before()
        .filter(|_| ticks > 0)
        .ok_or(gt_code::Index)?;
    match index {
        0 => {
            let mut part = Part::new(room, 0);
            part.put(b"GTBB");
            part.put(&[VERSION, u8::try_from(N).unwrap_or(0)]);
            part.put(&small(ticks).to_le_bytes());
            Ok(part.length)
        }
        1 => sized(before, room),
        _ => sized(
            black_box
                .entries()
                .nth(index.saturating_sub(HEAD))
                .ok_or(gt_code::Index)?,
            room,
        ),
    }
}

/// Writes a value with its length before it.
#[inline(never)]
fn sized(value: &impl Serialize, room: &mut [u8]) -> Reply<usize> {
    let written = postcard::serialize_with_flavor(value, Part::new(room, LENGTH));
    // The flavour never refuses, and core's types always serialise.
    let end = written.map_err(|_| gt_code::Other)?;
    let mut head = Part::new(room, 0);
    head.put(&small(end.saturating_sub(LENGTH)).to_le_bytes());
    Ok(end)
}

/// A part that is being written: as much as fits is kept, all of it is counted.
struct Part<'a> {
    room: &'a mut [u8],
    length: usize,
}

impl<'a> Part<'a> {
    const fn new(room: &'a mut [u8], length: usize) -> Self {
        Self { room, length }
    }

    fn put(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if let Some(place) = self.room.get_mut(self.length) {
                *place = *byte;
            }
            self.length = self.length.saturating_add(1);
        }
    }
}

impl Flavor for Part<'_> {
    type Output = usize;

    #[inline(never)]
    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.put(&[byte]);
        Ok(())
    }

    fn finalize(self) -> postcard::Result<usize> {
        Ok(self.length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gantry_tau_core::control::axis::{Actual, InForce, Offsets};
    use gantry_tau_core::control::channel::Limits;
    use gantry_tau_core::control::message::{ClientMessage, Command, Hello, Mode};
    use gantry_tau_core::control::session::config::{AxisConfig, Config, Parameters, Travel};
    use gantry_tau_core::control::session::{
        Connection, Entry, Event, Input, LastWrite, Output, Reading, Session, Start, TickInput,
        recorder,
    };
    use gantry_tau_core::units::{
        Epoch, EpochRange, ForceMn, MomentUnm, OffsetNm, PositionNm, Sequence, Tick,
        TorquePermille, VelocityUmS, WrenchSample,
    };

    const FAR: PositionNm = PositionNm(i64::MIN);
    const OFFSETS: Offsets = Offsets {
        position: OffsetNm(i32::MIN),
        velocity: VelocityUmS(i32::MIN),
        torque: TorquePermille(i16::MIN),
    };

    /// Numbers as long as they can be, and full lists.
    fn longest_input() -> Input<6> {
        let most = Epoch(u64::MAX);
        let mut input = Input::empty(EpochRange {
            first: most,
            last: most,
        });
        input.tick = TickInput {
            elapsed_cycles: u32::MAX,
            reading: Some(Reading {
                nominal: [FAR; 6],
                actual: [Actual {
                    position: FAR,
                    velocity: OFFSETS.velocity,
                    torque: OFFSETS.torque,
                }; 6],
            }),
            sensor: Some(WrenchSample {
                age: u8::MAX,
                is_cut: false,
                force: [ForceMn(i32::MIN); 3],
                moment: [MomentUnm(i32::MIN); 3],
            }),
            ..input.tick
        };
        input.last_write = LastWrite::Refused {
            in_force: [InForce {
                nominal: FAR,
                offsets: OFFSETS,
            }; 6],
        };
        input.arrival_us = u16::MAX;
        input.unauthentic = u16::MAX;
        let (sequence, echo) = (Sequence(u64::MAX), Tick(u64::MAX));
        let command = Command {
            epoch: most,
            sequence,
            echo,
            mode: Mode::Submit,
            targets: [OFFSETS; 6],
        };
        let event = Event::Message(ClientMessage::Command(command));
        while input.events.push((Connection(u64::MAX), event)).is_ok() {}
        input
    }

    /// An output with as many Refusals as there can be.
    fn output() -> Output<6> {
        let axis = AxisConfig::position_only(Limits::DISABLED, Travel::around_zero(u32::MAX), 0);
        let config = Config::new(Parameters::thesis([axis; 6])).unwrap();
        let mut session = Session::new(config, &Start::at_rest([PositionNm(0); 6])).unwrap();
        let mut input = Input::empty(EpochRange::VOLATILE);
        let hello = ClientMessage::Hello(Hello {
            axes: 0,
            capabilities: Default::default(),
        });
        for number in 0..16 {
            let event = (Connection(u64::MAX - number), Event::Message(hello));
            input.events.push(event).unwrap();
        }
        session.tick(&input)
    }

    #[test]
    fn no_part_is_longer_than_the_header_says() {
        let entry = recorder::Entry {
            input: longest_input(),
            output: output(),
        };
        let mut room = [0; GT_BLACK_BOX_PART];
        let length = sized(&entry, &mut room).unwrap();
        assert!(length < GT_BLACK_BOX_PART, "{length}");
        assert!(
            length > GT_BLACK_BOX_PART / 3,
            "{length}: the bound is too wide"
        );
        let read: Entry<6> = postcard::from_bytes(&room[LENGTH..length]).unwrap();
        assert_eq!(read, entry);
    }
}
