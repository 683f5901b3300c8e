//! Round trips, canonical encoding, and the deframer over every way to cut a stream.

use proptest::prelude::*;
use std::vec::Vec as StdVec;

use super::*;
use crate::control::axis::{Actual, Offsets};
use crate::control::channel::{LimitValues, Limits};
use crate::control::message::{
    AxisFlags, AxisLimits, AxisState, Capabilities, Cause, ClientMessage, Command, Counters, Hello, Mode, Phase,
    Refusal, ServerMessage, State, Welcome,
};
use crate::units::{Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS};

fn offsets() -> impl Strategy<Value = Offsets> {
    (any::<i32>(), any::<i32>(), any::<i16>()).prop_map(|(p, v, t)| Offsets {
        position: OffsetNm(p),
        velocity: VelocityUmS(v),
        torque: TorquePermille(t),
    })
}

fn client<const N: usize>() -> impl Strategy<Value = ClientMessage<N>> {
    let command = (any::<[u64; 3]>(), any::<bool>(), offsets()).prop_map(|(n, obtain, target)| {
        ClientMessage::Command(Command {
            epoch: Epoch(n[0]),
            sequence: Sequence(n[1]),
            echo: Tick(n[2]),
            mode: if obtain { Mode::Obtain } else { Mode::Submit },
            targets: [target; N],
        })
    });
    prop_oneof![
        (any::<u8>(), any::<u16>())
            .prop_map(|(axes, bits)| ClientMessage::Hello(Hello { axes, capabilities: Capabilities(bits) })),
        command,
        any::<u64>().prop_map(|n| ClientMessage::Goodbye(Epoch(n))),
        any::<u64>().prop_map(|n| ClientMessage::Stop(Epoch(n))),
    ]
}

fn server<const N: usize>() -> impl Strategy<Value = ServerMessage<N>> {
    let limits = (0..i32::MAX, 1..1000i32, 1..1000i32).prop_map(|(max, step, more)| LimitValues {
        max,
        step: step + more,
        accel: 2 * step + more + more,
        ramp: step,
    });
    let welcome =
        (any::<[u64; 2]>(), any::<[u32; 2]>(), any::<u8>(), limits).prop_map(|(wide, narrow, window, limits)| {
            ServerMessage::Welcome(Welcome {
                epoch: Epoch(wide[0]),
                tick: Tick(wide[1]),
                cycle_us: narrow[0],
                echo_window: window,
                capabilities: Capabilities(u16::from(window)),
                kinematics_checksum: narrow[1],
                limits: [AxisLimits {
                    position: Limits::new(limits).unwrap(),
                    velocity: Limits::DISABLED,
                    torque: Limits::new(limits).unwrap(),
                }; N],
            })
        });
    let state = (any::<[u64; 3]>(), any::<[u32; 11]>(), offsets(), offsets(), any::<[i64; 2]>(), 0..32u8).prop_map(
        |(wide, counts, offsets, shadow, positions, flags)| {
            ServerMessage::State(State {
                tick: Tick(wide[0]),
                epoch: Epoch(wide[1]),
                accepted: Sequence(wide[2]),
                phase: Phase::Obtain,
                cause: Cause::Restart,
                on_time_of_100: flags,
                arrival_us: 7,
                ramp_ticks_left: counts[10],
                counters: Counters {
                    received: counts[0],
                    missed: counts[1],
                    late: counts[2],
                    duplicate: counts[3],
                    stale: counts[4],
                    malformed: counts[5],
                    out_of_range: counts[6],
                    limited: counts[7],
                    clamped: counts[8],
                    non_owner: counts[9],
                    longest_miss_run: 3,
                },
                axes: [AxisState {
                    nominal: PositionNm(positions[0]),
                    offsets,
                    shadow,
                    actual: Actual {
                        position: PositionNm(positions[1]),
                        velocity: offsets.velocity,
                        torque: offsets.torque,
                    },
                    flags: AxisFlags::from_bits(flags).unwrap(),
                }; N],
            })
        },
    );
    let refusal = (1..8u8, any::<u32>()).prop_map(|(code, n)| {
        let small = u8::try_from(n % 256).unwrap();
        ServerMessage::Refusal(match code {
            1 => Refusal::Busy,
            2 => Refusal::Ramping { ticks_left: n },
            3 => Refusal::Faulted { ticks_left: n },
            4 => Refusal::Version { supported: small },
            5 => Refusal::Axes { expected: small },
            6 => Refusal::Capability { needed: Capabilities(u16::from(small)) },
            _ => Refusal::Unavailable,
        })
    });
    prop_oneof![welcome, state, refusal]
}

/// Every frame that comes out of a stream cut at `cuts`.
fn deframe(stream: &[u8], cuts: &[usize]) -> Result<StdVec<StdVec<u8>>, FrameError> {
    let mut deframer = Deframer::new();
    let mut frames = StdVec::new();
    let mut from = 0;
    for to in cuts.iter().copied().chain([stream.len()]) {
        let mut chunk = &stream[from.min(to)..to];
        from = to;
        loop {
            match deframer.feed(chunk) {
                Feed::Incomplete => break,
                Feed::Frame { frame, consumed } => {
                    frames.push(frame.body().to_vec());
                    assert!(consumed <= chunk.len());
                    chunk = &chunk[consumed..];
                }
                Feed::Broken(error) => return Err(error),
            }
        }
    }
    Ok(frames)
}

proptest! {
    #[test]
    fn client_messages_survive_the_wire(message in client::<6>()) {
        let bytes = encode_client(&message);
        let frame = Frame::parse(&bytes).unwrap();
        prop_assert_eq!(decode_client::<6>(&frame), Ok(message));
    }

    #[test]
    fn server_messages_survive_the_wire(message in server::<6>()) {
        let bytes = encode_server(&message);
        let frame = Frame::parse(&bytes).unwrap();
        prop_assert_eq!(decode_server::<6>(&frame), Ok(message));
    }

    /// Whatever decodes encodes to the same bytes again: one encoding per message.
    #[test]
    fn decoding_is_canonical(message in client::<2>(), answer in server::<2>(), at in 0..200usize, bit in 0..8u32) {
        let mut damaged = encode_client(&message).to_vec();
        repair(&mut damaged, at, bit);
        let frame = Frame::parse(&damaged);
        if let Some(Ok(read)) = frame.ok().map(|frame| decode_client::<2>(&frame)) {
            prop_assert_eq!(&*encode_client(&read), &*damaged);
        }
        let mut damaged = encode_server(&answer).to_vec();
        repair(&mut damaged, at, bit);
        let frame = Frame::parse(&damaged);
        if let Some(Ok(read)) = frame.ok().map(|frame| decode_server::<2>(&frame)) {
            prop_assert_eq!(&*encode_server(&read), &*damaged);
        }
    }

    #[test]
    fn any_bytes_are_judged(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
        let _judged = deframe(&bytes, &[]);
        if let Ok(frame) = Frame::parse(&bytes) {
            let _message = decode_client::<3>(&frame);
        }
    }
}

/// Flips one bit and makes the checksum right again.
fn repair(bytes: &mut StdVec<u8>, at: usize, bit: u32) {
    let body_end = bytes.len() - TRAILER_LEN;
    bytes[at % body_end] ^= 1 << bit;
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes[..body_end]);
    bytes.truncate(body_end);
    bytes.extend_from_slice(&crc.to_le_bytes());
}

#[test]
fn the_stream_may_be_cut_anywhere() {
    let hello = ClientMessage::<3>::Hello(Hello { axes: 3, capabilities: Capabilities::NONE });
    let stop = ClientMessage::<3>::Stop(Epoch(9));
    let mut stream = encode_client(&hello).to_vec();
    stream.extend_from_slice(&encode_client(&stop));
    let whole = deframe(&stream, &[]).unwrap();
    assert_eq!(whole.len(), 2);
    for first in 0..stream.len() {
        for second in first..stream.len() {
            assert_eq!(deframe(&stream, &[first, second]).as_ref(), Ok(&whole));
        }
    }
}

#[test]
fn a_broken_stream_says_why_and_stays_broken() {
    let good = encode_client(&ClientMessage::<3>::Goodbye(Epoch(1)));
    let broken = |at: usize, value: u8| {
        let mut bytes = good.to_vec();
        bytes[at] = value;
        deframe(&bytes, &[]).unwrap_err()
    };
    assert_eq!(broken(0, b'X'), FrameError::Magic);
    assert_eq!(broken(2, 9), FrameError::Version { received: 9 });
    assert_eq!(broken(5, 2), FrameError::TooLong { length: 0x208 });
    assert_eq!(broken(9, 1), FrameError::Checksum);
    let mut deframer = Deframer::new();
    assert_eq!(deframer.feed(b"XXXXXX"), Feed::Broken(FrameError::Magic));
    assert_eq!(deframer.feed(&good), Feed::Broken(FrameError::Magic));
}

#[test]
fn bad_content_is_named() {
    let judge = |kind: u8, body: &[u8]| {
        let mut bytes = b"GT\x01".to_vec();
        bytes.push(kind);
        let length = u16::try_from(body.len()).unwrap();
        bytes.extend_from_slice(&length.to_le_bytes());
        bytes.extend_from_slice(body);
        bytes.extend_from_slice(&[0; 4]);
        let end = bytes.len() - 1;
        repair(&mut bytes, end, 0);
        // `repair` flipped a bit of the body's start region only when it had to; undo it by flipping again.
        repair(&mut bytes, end, 0);
        decode_client::<1>(&Frame::parse(&bytes).unwrap())
    };
    assert_eq!(judge(99, &[]), Err(ContentError::Kind { received: 99 }));
    assert_eq!(judge(4, &[]), Err(ContentError::Kind { received: 4 }));
    assert_eq!(judge(1, &[1]), Err(ContentError::Length { expected: 4, received: 1 }));
    assert_eq!(judge(1, &[1, 7, 0, 0]), Err(ContentError::Reserved));
    let mut command = [0_u8; 38];
    command[24] = 3;
    command[25] = 1;
    assert_eq!(judge(3, &command), Err(ContentError::Code { received: 3 }));
    command[24] = 1;
    command[25] = 2;
    assert_eq!(judge(3, &command), Err(ContentError::Axes { expected: 1, received: 2 }));
}

/// The largest message at the largest number of axes fits a frame.
#[test]
fn every_message_fits() {
    let limits = AxisLimits { position: Limits::DISABLED, velocity: Limits::DISABLED, torque: Limits::DISABLED };
    let welcome = ServerMessage::<6>::Welcome(Welcome {
        epoch: Epoch(1),
        tick: Tick(1),
        cycle_us: 1000,
        echo_window: 0,
        capabilities: Capabilities::NONE,
        kinematics_checksum: 0,
        limits: [limits; 6],
    });
    assert_eq!(encode_server(&welcome).len(), 10 + 316);
    let command = ClientMessage::<6>::Command(Command {
        epoch: Epoch(1),
        sequence: Sequence(1),
        echo: Tick(1),
        mode: Mode::Submit,
        targets: [Offsets::default(); 6],
    });
    assert_eq!(encode_client(&command).len(), 10 + 88);
}
