//! Round trips, canonical encoding, and the deframer over every way to cut a stream.

use proptest::prelude::*;
use std::vec::Vec as StdVec;

use super::*;
use crate::control::axis::{Actual, Offsets};
use crate::control::channel::Limits;
use crate::control::fixture::{REFUSALS, limits};
use crate::control::message::{
    AxisFlags, AxisLimits, AxisState, Capabilities, Cause, ClientMessage, Command, Counters, Hello,
    Mode, Phase, ServerMessage, State, Welcome,
};
use crate::units::{
    Epoch, ForceMn, MomentUnm, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS,
    WrenchSample,
};

/// Offsets with a different value at each axis.
fn offsets(axis: usize) -> Offsets {
    let count = i16::try_from(axis).unwrap();
    Offsets {
        position: OffsetNm(i32::MIN + i32::from(count)),
        velocity: VelocityUmS(-123_456_789 - i32::from(count)),
        torque: TorquePermille(i16::MAX - count),
    }
}

/// Every kind of message of a client, with every code.
fn from_client<const N: usize>() -> StdVec<ClientMessage<N>> {
    let hello = Hello {
        axes: 3,
        capabilities: Capabilities(0x1234),
    };
    let mut messages = std::vec![
        ClientMessage::Hello(hello),
        ClientMessage::Goodbye(Epoch(0x0123_4567_89ab_cdef)),
        ClientMessage::Stop(Epoch(u64::MAX)),
    ];
    messages.extend(Mode::ALL.iter().map(|mode| {
        ClientMessage::Command(Command {
            epoch: Epoch(1 << 63),
            sequence: Sequence(0x0123_4567_89ab_cdef),
            echo: Tick(7),
            mode: *mode,
            targets: core::array::from_fn(offsets),
        })
    }));
    messages
}

/// Every kind of message of a server, with every code.
fn from_server<const N: usize>() -> StdVec<ServerMessage<N>> {
    let state = State {
        tick: Tick(1),
        epoch: Epoch(2),
        accepted: Sequence(u64::MAX),
        phase: Phase::Obtain,
        cause: Cause::None,
        on_time_of_100: 99,
        arrival_us: 65_000,
        ramp_ticks_left: 4_000_000_000,
        counters: Counters {
            received: 11,
            missed: 12,
            late: 13,
            duplicate: 14,
            stale: 15,
            malformed: 16,
            out_of_range: 17,
            limited: 18,
            clamped: 19,
            non_owner: 20,
            longest_miss_run: 21,
        },
        sensor: Some(WrenchSample {
            age: 254,
            is_cut: true,
            force: [i32::MIN, 1_000, -3].map(ForceMn),
            moment: [i32::MAX, -2, 0].map(MomentUnm),
        }),
        axes: core::array::from_fn(|axis| AxisState {
            nominal: PositionNm(i64::MIN + 5),
            offsets: offsets(axis),
            shadow: offsets(axis + N),
            actual: Actual {
                position: PositionNm(6),
                velocity: VelocityUmS(-7),
                torque: TorquePermille(8),
            },
            flags: AxisFlags::ALL,
        }),
    };
    let welcome = Welcome {
        epoch: Epoch(3),
        tick: Tick(4),
        cycle_us: 1_000_000,
        echo_window: 5,
        capabilities: Capabilities::LOCKSTEP,
        kinematics_checksum: 0xfeed_f00d,
        limits: [AxisLimits {
            position: limits(i32::MAX, 5_000, 10_000, 100),
            velocity: Limits::DISABLED,
            torque: limits(100, 3, 5, 2),
        }; N],
    };
    let mut messages = std::vec![ServerMessage::Welcome(welcome)];
    messages.extend(REFUSALS.map(ServerMessage::Refusal));
    messages.extend(Phase::ALL.iter().map(|phase| {
        ServerMessage::State(State {
            phase: *phase,
            ..state
        })
    }));
    messages.extend(Cause::ALL.iter().map(|cause| {
        ServerMessage::State(State {
            cause: *cause,
            ..state
        })
    }));
    messages
}

/// Encodes and decodes a message, and the frame with each bit flipped: what decodes encodes to the
/// same bytes again.
fn is_canonical<M: Copy + PartialEq + core::fmt::Debug>(
    message: M,
    encode: fn(&M) -> FrameBytes,
    decode: fn(&Frame<'_>) -> Result<M, ContentError>,
) {
    let good = encode(&message);
    assert_eq!(decode(&Frame::parse(&good).unwrap()), Ok(message));
    assert_eq!(sealed(good.to_vec()), *good);
    for bit in 0..8 * (good.len() - TRAILER_LEN) {
        let mut damaged = good.to_vec();
        damaged[bit / 8] ^= 1 << (bit % 8);
        let damaged = sealed(damaged);
        if let Some(Ok(read)) = Frame::parse(&damaged).ok().map(|frame| decode(&frame)) {
            assert_ne!(read, message);
            assert_eq!(*encode(&read), *damaged, "bit {bit} of {message:?}");
        }
    }
}

/// A frame with the right checksum.
fn sealed(mut frame: StdVec<u8>) -> StdVec<u8> {
    let (checked, trailer) = frame.split_last_chunk_mut::<TRAILER_LEN>().unwrap();
    *trailer = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC)
        .checksum(checked)
        .to_le_bytes();
    frame
}

fn messages_are_canonical<const N: usize>() {
    for message in from_client::<N>() {
        is_canonical(message, encode_client, decode_client);
    }
    for message in from_server::<N>() {
        is_canonical(message, encode_server, decode_server);
    }
}

#[test]
fn every_message_survives_and_has_one_encoding() {
    messages_are_canonical::<1>();
    messages_are_canonical::<6>();
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
                    assert!(0 < consumed && consumed <= chunk.len());
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
    fn any_bytes_are_judged(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
        let _judged = deframe(&bytes, &[]);
        if let Ok(frame) = Frame::parse(&bytes) {
            let _message = decode_client::<3>(&frame);
        }
    }
}

#[test]
fn the_stream_may_be_cut_anywhere() {
    let hello = ClientMessage::<3>::Hello(Hello {
        axes: 3,
        capabilities: Capabilities::NONE,
    });
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

/// Error of a stream with one other byte.
fn broken(good: &[u8], at: usize, value: u8) -> FrameError {
    let mut bytes = good.to_vec();
    bytes[at] = value;
    deframe(&bytes, &[]).unwrap_err()
}

#[test]
fn a_broken_stream_says_why_and_stays_broken() {
    let good = encode_client(&ClientMessage::<3>::Goodbye(Epoch(1)));
    assert_eq!(broken(&good, 0, b'X'), FrameError::Magic);
    assert_eq!(broken(&good, 2, 9), FrameError::Version { received: 9 });
    assert_eq!(broken(&good, 5, 2), FrameError::TooLong { length: 0x208 });
    assert_eq!(broken(&good, 6, 1), FrameError::Suite { received: 1 });
    assert_eq!(broken(&good, 7, 2), FrameError::Suite { received: 0x200 });
    assert_eq!(broken(&good, 9, 1), FrameError::Checksum);
    let mut deframer = Deframer::new();
    assert_eq!(deframer.feed(b"noise..."), Feed::Broken(FrameError::Magic));
    assert_eq!(deframer.feed(&good), Feed::Broken(FrameError::Magic));
}

/// Decodes a frame of this kind and body.
fn judge(kind: u8, body: &[u8]) -> Result<ClientMessage<1>, ContentError> {
    let length = u8::try_from(body.len()).unwrap();
    let bytes = sealed(
        [
            &[b'G', b'T', PROTOCOL_VERSION, kind, length, 0, 0, 0],
            body,
            &[0; TRAILER_LEN],
        ]
        .concat(),
    );
    decode_client(&Frame::parse(&bytes).unwrap())
}

#[test]
fn bad_content_is_named() {
    assert_eq!(judge(99, &[]), Err(ContentError::Kind { received: 99 }));
    assert_eq!(judge(4, &[]), Err(ContentError::Kind { received: 4 }));
    assert_eq!(
        judge(1, &[1]),
        Err(ContentError::Length {
            expected: 4,
            received: 1
        })
    );
    assert_eq!(judge(1, &[1, 7, 0, 0]), Err(ContentError::Reserved));
    let mut command = [0_u8; 38];
    command[24] = 3;
    command[25] = 1;
    assert_eq!(judge(3, &command), Err(ContentError::Code { received: 3 }));
    command[24] = 1;
    command[25] = 2;
    assert_eq!(
        judge(3, &command),
        Err(ContentError::Axes {
            expected: 1,
            received: 2
        })
    );
}

/// The bodies of `wire.md`, at the largest number of axes.
#[test]
fn bodies_have_their_lengths() {
    assert_eq!(
        (
            Welcome::<6>::LENGTH,
            State::<6>::LENGTH,
            Command::<6>::LENGTH
        ),
        (316, 366, 88)
    );
}

/// The bytes that every version of the protocol keeps.
#[test]
fn a_notice_is_a_refusal_of_version_1() {
    let notice = encode_notice(Notice::VERSION);
    let bytes = b"GT\x01\x07\x08\0\x04\x02\0\0\0\0\0\0\xda\x7f\x60\x8e";
    assert_eq!(*notice, bytes[..]);
    assert_eq!(*notice, sealed(notice.to_vec()));
    for at in 0..8 {
        let mut other = notice.to_vec();
        other[at] ^= 1;
        let error = Frame::parse(&other).unwrap_err();
        let is_notice = matches!(error, FrameError::Notice(_));
        assert_eq!(is_notice, at >= 6, "byte {at}: {error}");
    }
}

/// A frame of kind 1 with a body of zeros.
fn zeros(length: u16) -> StdVec<u8> {
    let [low, high] = length.to_le_bytes();
    let header = [b'G', b'T', PROTOCOL_VERSION, 1, low, high, 0, 0];
    sealed(
        [
            &header[..],
            &std::vec![0; usize::from(length) + TRAILER_LEN],
        ]
        .concat(),
    )
}

#[test]
fn the_longest_frame_passes_and_no_longer_one() {
    let most = u16::try_from(MAX_BODY).unwrap();
    assert_eq!(zeros(most).len() - TRAILER_LEN + TAG_LEN, MAX_FRAME);
    assert_eq!(
        Frame::parse(&zeros(most)).map(|frame| frame.body().len()),
        Ok(MAX_BODY)
    );
    let body = StdVec::from([0; MAX_BODY + 1]);
    assert!(Frame::from_parts(1, &body[1..]).is_some() && Frame::from_parts(1, &body).is_none());
    let stream = [zeros(most), zeros(0)].concat();
    assert_eq!(deframe(&stream, &[]).unwrap().len(), 2);
    let error = FrameError::TooLong { length: most + 1 };
    assert_eq!(
        (
            Frame::parse(&zeros(most + 1)),
            deframe(&zeros(most + 1), &[])
        ),
        (Err(error), Err(error))
    );
}

#[test]
fn frames_are_equal_by_their_bytes() {
    let [one, other] = [1, 2].map(|epoch| encode_client(&ClientMessage::<1>::Stop(Epoch(epoch))));
    assert!(one == one.clone() && one != other);
    assert_eq!(std::format!("{one:?}"), std::format!("{:?}", &one[..]));
}

/// The first `held` bytes of a frame; what follows them is noise.
fn collected(frame: &[u8], held: usize, noise: u8) -> Option<Collector> {
    let mut bytes = [noise; MAX_FRAME];
    bytes[..frame.len()].copy_from_slice(frame);
    Collector::from_parts(bytes, held, Suite::Checksum)
}

#[test]
fn a_collector_holds_part_of_one_frame_and_no_more() {
    let frame = zeros(4);
    for held in 0..=frame.len() {
        let collector = collected(&frame, held, 7).unwrap();
        assert_eq!(
            (collector.held(), collector.is_whole()),
            (&frame[..held], held == frame.len())
        );
        assert_eq!(Some(&collector), collected(&frame, held, 8).as_ref());
        assert_ne!(
            Some(collector),
            collected(&frame, (held + 1) % frame.len(), 7)
        );
    }
    assert_eq!(collected(&frame, frame.len() + 1, 7), None);
    assert_eq!(collected(b"no frame", HEADER_LEN, 7), None);
    assert!(collected(b"no frame", HEADER_LEN - 1, 7).is_some());
}

#[test]
fn a_deframer_has_returned_what_is_whole() {
    let frame = zeros(4);
    let [part, whole] = [9, frame.len()].map(|held| collected(&frame, held, 7).unwrap());
    let broken = Stage::Broken(FrameError::Magic);
    let cases = [
        (&part, Stage::Collecting, true),
        (&whole, Stage::Collecting, false),
        (&part, Stage::Returned, false),
        (&whole, Stage::Returned, true),
        (&part, broken, true),
        (&whole, broken, true),
    ];
    for (collector, stage, is_valid) in cases {
        let deframer = Deframer::from_parts(collector.clone(), stage);
        assert_eq!(deframer.is_some(), is_valid, "{stage:?}");
        let rest = deframer.filter(|_| stage == Stage::Collecting);
        assert!(rest.is_none_or(|mut deframer| matches!(
            deframer.feed(&frame[9..]),
            Feed::Frame { consumed: 7, .. }
        )));
    }
}
