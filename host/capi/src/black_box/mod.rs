//! The black box as the file that `gantry-tau replay` reads (`host/src/black_box`): one line at a time, into the caller's buffer.

mod fields;
mod text;

use gantry_tau_core::control::session::BlackBox;

use crate::code::gt_code;
use crate::memory::Reply;
pub(crate) use text::Line;
use text::Text;

/// Longest line of a black box, bytes.
pub const GT_BLACK_BOX_LINE: usize = 16_384;

/// Lines before the first tick: what the file is, the configuration, the session before the oldest tick.
const HEAD: usize = 3;

/// What a black box holds.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_black_box {
    /// Ticks recorded, at most 3 GT_BLACK_BOX_TICKS.
    pub ticks: u32,
    /// Lines of its file; 0 while no tick is recorded.
    pub lines: u32,
    /// Not 0: the end of a session has frozen it, GT_BLACK_BOX_TICKS ticks ago. It records again after gt_server_black_box_release.
    pub frozen: u8,
}

/// What a black box holds.
pub(crate) fn look<const N: usize, const TICKS: usize>(
    black_box: &BlackBox<N, TICKS>,
) -> gt_black_box {
    let ticks = ticks(black_box);
    let lines = if ticks == 0 {
        0
    } else {
        ticks.saturating_add(HEAD)
    };
    let small = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
    gt_black_box {
        ticks: small(ticks),
        lines: small(lines),
        frozen: black_box.is_frozen().into(),
    }
}

fn ticks<const N: usize, const TICKS: usize>(black_box: &BlackBox<N, TICKS>) -> usize {
    let segments = black_box.segments();
    let used = segments.iter().map(|segment| segment.entries().len());
    used.fold(0, usize::saturating_add)
}

/// Writes one line of the file.
pub(crate) fn write_line<const N: usize, const TICKS: usize>(
    black_box: &BlackBox<N, TICKS>,
    index: usize,
    line: &mut Line<'_>,
) -> Reply {
    let ticks = ticks(black_box);
    let before = black_box.before().filter(|_| ticks > 0);
    let before = before.ok_or(gt_code::Index)?;
    match index {
        0 => {
            line.put("{\"format\":\"gantry-tau black box\",\"version\":1,\"axes\":");
            N.write(line);
            line.put(",\"ticks\":");
            ticks.write(line);
            line.put("}");
        }
        1 => line.object(&[("config", before.config().parameters())]),
        2 => line.object(&[("before", before.parts())]),
        _ => {
            let tick = index.saturating_sub(HEAD);
            let entry = black_box.entries().nth(tick).ok_or(gt_code::Index)?;
            entry.write(line);
        }
    }
    line.put("\n");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use gantry_tau_core::control::axis::{Actual, Offsets, Reference};
    use gantry_tau_core::control::message::{
        AxisFlags, AxisState, Cause, ClientMessage, Command, Counters, Mode, Phase, Refusal, State,
    };
    use gantry_tau_core::control::session::fsm::Connection;
    use gantry_tau_core::control::session::{EVENTS, Entry, Event, Input, Output, Refusals};
    use gantry_tau_core::units::{
        Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS,
    };

    const FAR: PositionNm = PositionNm(i64::MIN);
    const FAST: VelocityUmS = VelocityUmS(i32::MIN);
    const STRONG: TorquePermille = TorquePermille(i16::MIN);
    const OFFSETS: Offsets = Offsets {
        position: OffsetNm(i32::MIN),
        velocity: FAST,
        torque: STRONG,
    };
    const ACTUAL: Actual = Actual {
        position: FAR,
        velocity: FAST,
        torque: STRONG,
    };
    const SOMEBODY: Connection = Connection(u64::MAX);

    /// Every number as long as it can be, every list full, every name the longest there is.
    fn longest_input() -> Input<6> {
        let mut input = Input::nothing();
        let cycle = &mut input.cycle;
        cycle.elapsed = u32::MAX;
        cycle.nominal = [FAR; 6];
        cycle.actual = [ACTUAL; 6];
        cycle.next_epoch = Epoch(u64::MAX);
        cycle.arrival_us = u16::MAX;
        for _ in 0..EVENTS {
            let command = ClientMessage::Command(Command {
                epoch: Epoch(u64::MAX),
                sequence: Sequence(u64::MAX),
                echo: Tick(u64::MAX),
                mode: Mode::Submit,
                targets: [OFFSETS; 6],
            });
            input
                .events
                .push((SOMEBODY, Event::Message(command)))
                .unwrap();
        }
        input
    }

    fn longest_output() -> Output<6> {
        let most = u32::MAX;
        let mut refusals = Refusals::new();
        for _ in 0..EVENTS {
            let ticks_left = most;
            refusals
                .push((SOMEBODY, Refusal::Ramping { ticks_left }))
                .unwrap();
        }
        Output {
            references: [Reference {
                position: FAR,
                velocity_offset: FAST,
                torque_offset: STRONG,
            }; 6],
            state: State {
                tick: Tick(u64::MAX),
                epoch: Epoch(u64::MAX),
                accepted: Sequence(u64::MAX),
                phase: Phase::SafeDisconnect,
                cause: Cause::HandshakeTimeout,
                on_time_of_100: 100,
                arrival_us: u16::MAX,
                ramp_ticks_left: most,
                counters: Counters {
                    received: most,
                    missed: most,
                    late: most,
                    duplicate: most,
                    stale: most,
                    malformed: most,
                    out_of_range: most,
                    limited: most,
                    clamped: most,
                    strangers: most,
                    longest_miss_run: u16::MAX,
                },
                axes: [AxisState {
                    nominal: FAR,
                    offsets: OFFSETS,
                    shadow: OFFSETS,
                    actual: ACTUAL,
                    flags: AxisFlags::ALL,
                }; 6],
            },
            owner: Some(SOMEBODY),
            welcome: Some(SOMEBODY),
            refusals,
            close: Some(SOMEBODY),
            ended: Some(Cause::HandshakeTimeout),
        }
    }

    #[test]
    fn no_line_is_longer_than_the_header_says() {
        let entry = Entry {
            input: longest_input(),
            output: longest_output(),
        };
        let mut room = [];
        let mut line = Line::new(&mut room);
        entry.write(&mut line);
        line.put("\n");
        let length = line.length();
        assert!(length <= GT_BLACK_BOX_LINE, "{length}");
        assert!(
            length > GT_BLACK_BOX_LINE / 2,
            "{length}: the bound is far too wide"
        );
    }

    #[test]
    fn numbers_are_written_in_full() {
        let mut room = [0; 400];
        let mut line = Line::new(&mut room);
        line.array(&[0_u64, 7, 10, 1_000_000_007, u64::MAX]);
        line.array(&[i64::MIN, -1, 0, i64::MAX]);
        line.array(&[0_u128, u128::MAX, 0x0123_4567_89ab_cdef << 64]);
        line.array(&[true, false]);
        let length = line.length();
        let text = std::str::from_utf8(&room[..length]).unwrap();
        let expected = format!(
            "[0,7,10,1000000007,{}][{},-1,0,{}][\"{:#034x}\",\"{:#034x}\",\"{:#034x}\"][true,false]",
            u64::MAX,
            i64::MIN,
            i64::MAX,
            0,
            u128::MAX,
            0x0123_4567_89ab_cdef_u128 << 64
        );
        assert_eq!(text, expected);
    }

    #[test]
    fn what_does_not_fit_is_counted() {
        let mut room = [0; 3];
        let mut line = Line::new(&mut room);
        line.put("12345");
        assert_eq!(line.length(), 5);
        assert_eq!(&room, b"123");
    }
}
