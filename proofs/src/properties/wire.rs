//! The decoder: T8. Bodies without a checksum, frames with one, and the stream by induction on one
//! chunk.

use std::array::from_fn;

use gantry_tau_core::control::message::{Command, Hello, Refusal, State, Welcome};
use gantry_tau_core::control::wire::{
    Body, Collector, ContentError, Deframer, Feed, Frame, FrameError, HEADER_LEN, Kind, MAX_BODY,
    Notice, PROTOCOL_VERSION, Stage, Suite, TRAILER_LEN, decode_client, decode_server, enclose,
    encode_client, encode_notice, encode_server,
};
use gantry_tau_core::units::Epoch;
use gantry_tau_core::verification::control::checksum;

/// From bytes to a message and back: the same bytes.
///
/// # Errors
/// The reason, if the bytes are not a message.
pub fn body_is_canonical<B: Body>(bytes: &[u8]) -> Result<(), ContentError> {
    let body = B::read(bytes)?;
    assert!(bytes.len() == B::LENGTH, "T8: one length");
    let mut scratch = [0; MAX_BODY];
    let again = &mut scratch[..B::LENGTH];
    assert!(body.write(again).is_ok(), "T8: a body fits its length");
    assert!(again == bytes, "T8: decode(b) = m => encode(m) = b");
    Ok(())
}

/// From a message to bytes and back: the same message.
pub fn body_survives<B: Body + PartialEq>(body: &B) {
    let mut scratch = [0; MAX_BODY];
    let bytes = &mut scratch[..B::LENGTH];
    assert!(body.write(bytes).is_ok(), "T8: a body fits its length");
    let read = B::read(bytes);
    assert!(read.as_ref() == Ok(body), "T8: decode(encode(m)) = m");
}

/// One chunk into a collector: it stays valid and holds what it held and the front of the chunk, no
/// more than was given. The byte `at` speaks for every byte. `Ok(true)` when a frame is complete.
///
/// That makes the outcome a function of the held bytes and the chunk in one row, so no cut can
/// change it.
///
/// # Errors
/// When the header is bad.
pub fn chunk_is_collected(before: &Collector, chunk: &[u8], at: usize) -> Result<bool, FrameError> {
    let mut after = before.clone();
    let outcome = after.consume(chunk);
    let old = before.held();
    match outcome {
        Err(error) => header_is_bad(from_fn(|at| row(old, chunk, at)), error),
        Ok(complete) => {
            let taken = complete.unwrap_or(chunk.len());
            assert!(taken <= chunk.len(), "T8: consumed <= given");
            assert!(after.is_valid(), "T8: the invariant is kept");
            assert!(after.is_whole() == complete.is_some(), "T8: complete");
            let held = after.held();
            assert!(held.len() == old.len() + taken, "T8: as many as taken");
            let same = at >= held.len() || row(old, chunk, at) == Some(held[at]);
            assert!(same, "T8: held is what was held, and what was taken");
        }
    }
    outcome.map(|complete| complete.is_some())
}

/// Byte `at` of the held bytes and the chunk in one row; `None` behind it.
fn row(held: &[u8], chunk: &[u8], at: usize) -> Option<u8> {
    let new = at.checked_sub(held.len()).and_then(|at| chunk.get(at));
    held.get(at).or(new).copied()
}

/// A header is all there, and this is what is wrong with it.
fn header_is_bad(header: [Option<u8>; HEADER_LEN], error: FrameError) {
    assert!(
        !header.contains(&None),
        "T8: a header is judged when it is there"
    );
    let wrong = wrong_with_header(header.map(Option::unwrap_or_default));
    assert!(wrong == Some(error), "T8: the first thing wrong is named");
}

/// First thing wrong with a header, front to back; a notice is known by the front of its own.
fn wrong_with_header(header: [u8; HEADER_LEN]) -> Option<FrameError> {
    let [m0, m1, version, kind, l0, l1, s0, s1] = header;
    let [length, suite] = [[l0, l1], [s0, s1]].map(u16::from_le_bytes);
    if [m0, m1] != *b"GT" {
        Some(FrameError::Magic)
    } else if (version, kind, length) == (1, Kind::Refusal.code(), 8) {
        let (reason, detail) = (s0, s1);
        Some(FrameError::Notice(Notice { reason, detail }))
    } else if version != PROTOCOL_VERSION {
        Some(FrameError::Version { received: version })
    } else if usize::from(length) > MAX_BODY {
        Some(FrameError::TooLong { length })
    } else {
        (suite != 0).then_some(FrameError::Suite { received: suite })
    }
}

/// A notice has one frame, which is no other frame.
pub fn notice_is_read(notice: Notice) {
    let bytes = encode_notice(notice);
    let [reason, detail] = [notice.reason, notice.detail];
    let front = [b'G', b'T', 1, 7, 8, 0, reason, detail, 0, 0, 0, 0, 0, 0];
    assert!(bytes.len() == 18, "T8: a notice has 18 bytes");
    assert!(
        bytes.first_chunk() == Some(&front),
        "T8: a notice is a Refusal of version 1"
    );
    assert!(
        Frame::parse(&bytes) == Err(FrameError::Notice(notice)),
        "T8: a notice is read as it was written"
    );
}

/// Bytes are a frame, with the kind and the body that lie in them, exactly if nothing is wrong with
/// them; and the first thing wrong is named. The byte `at` speaks for every byte of the body.
///
/// # Errors
/// The reason, if they are not a frame.
pub fn frame_is_parsed(bytes: &[u8], at: usize) -> Result<(), FrameError> {
    let wrong = first_wrong(bytes);
    let frame = match Frame::parse(bytes) {
        Ok(frame) => frame,
        Err(error) => {
            assert!(
                Some(error) == wrong,
                "T8: the first thing wrong with a frame is named"
            );
            return Err(error);
        }
    };
    assert!(wrong.is_none(), "T8: only good frames pass");
    assert!(frame.kind_code() == bytes[3], "T8: the kind byte");
    let body = frame.body();
    let outside = HEADER_LEN + TRAILER_LEN;
    assert!(
        body.len() == bytes.len() - outside && body.len() <= MAX_BODY,
        "T8: between header and checksum"
    );
    assert!(
        at >= body.len() || body[at] == bytes[HEADER_LEN + at],
        "T8: what lies between"
    );
    Ok(())
}

/// First thing wrong with bytes that should be one frame, front to back, the checksum last.
fn first_wrong(bytes: &[u8]) -> Option<FrameError> {
    let Some((header, rest)) = bytes.split_first_chunk() else {
        return Some(FrameError::Length);
    };
    let wrong = wrong_with_header(*header);
    if wrong.is_some() {
        return wrong;
    }
    let body = usize::from(u16::from_le_bytes([header[4], header[5]]));
    if rest.len() != body + TRAILER_LEN {
        return Some(FrameError::Length);
    }
    let (checked, trailer) = bytes.split_last_chunk()?;
    (checksum(checked) != u32::from_le_bytes(*trailer)).then_some(FrameError::Checksum)
}

/// A body in a frame is that body, of its kind. The byte `at` speaks for every byte. [`enclose`]
/// knows of a body only its length and how to write it, so that any bytes stand for every message
/// of that length.
pub fn frame_survives<B: Body>(kind: Kind, body: &B, at: usize) {
    let bytes = enclose(kind, body);
    let mut scratch = [0; MAX_BODY];
    let written = &mut scratch[..B::LENGTH];
    assert!(body.write(written).is_ok(), "T8: a body fits its length");
    let Ok(frame) = Frame::parse(&bytes) else {
        panic!("T8: what is enclosed is a frame");
    };
    assert!(
        frame.kind_code() == kind.code(),
        "T8: a frame keeps its kind"
    );
    assert!(
        frame.body().len() == B::LENGTH,
        "T8: a frame keeps its length"
    );
    assert!(
        at >= B::LENGTH || frame.body()[at] == written[at],
        "T8: a frame keeps its body"
    );
}

/// Bytes that are a frame with this kind and this body are its only frame, checksum included. True
/// if they are one.
pub fn frame_is_canonical<B: Body>(kind: Kind, bytes: &[u8]) -> bool {
    let Ok(frame) = Frame::parse(bytes) else {
        return false;
    };
    let Ok(body) = B::read(frame.body()) else {
        return false;
    };
    if frame.kind_code() != kind.code() {
        return false;
    }
    let again = enclose(kind, &body);
    assert!(again.len() == bytes.len(), "T8: one length");
    // Byte by byte: the number of the given bytes is what a model checker knows to be fixed.
    let all_same = bytes
        .iter()
        .enumerate()
        .all(|(at, byte)| again.get(at) == Some(byte));
    assert!(all_same, "T8: decode(b) = m => encode(m) = b");
    true
}

/// True if the bytes are a frame of some message to or from a server of `N` axes; it is then the
/// only one.
#[must_use]
pub fn message_is_canonical<const N: usize>(bytes: &[u8]) -> bool {
    [
        frame_is_canonical::<Hello>(Kind::Hello, bytes),
        frame_is_canonical::<Command<N>>(Kind::Command, bytes),
        frame_is_canonical::<Epoch>(Kind::Goodbye, bytes),
        frame_is_canonical::<Epoch>(Kind::Stop, bytes),
        frame_is_canonical::<Welcome<N>>(Kind::Welcome, bytes),
        frame_is_canonical::<State<N>>(Kind::State, bytes),
        frame_is_canonical::<Refusal>(Kind::Refusal, bytes),
    ]
    .contains(&true)
}

/// One chunk into a deframer: it stays valid; broken stays broken; a frame is returned when the
/// collector has one, unless its checksum is wrong, and is made of the collected bytes. True if one
/// was returned.
pub fn feed_is_judged(collector: &Collector, stage: Stage, chunk: &[u8]) -> bool {
    let Some(mut deframer) = Deframer::from_parts(collector.clone(), stage) else {
        return false;
    };
    let mut collected = collector.clone();
    if stage == Stage::Returned {
        collected.clear();
    }
    let taken = match stage {
        Stage::Broken(error) => Err(error),
        Stage::Collecting | Stage::Returned => collected.consume(chunk),
    };
    let returned = match (deframer.feed(chunk), taken) {
        (Feed::Frame { frame, consumed }, Ok(Some(taken))) => {
            assert!(consumed == taken, "T8: consumed is what was collected");
            let body = frame.body().len();
            let whole = HEADER_LEN + body + TRAILER_LEN;
            assert!(
                collected.suite() == Suite::Checksum,
                "T8: a tag is no checksum"
            );
            assert!(whole == collected.held().len(), "T8: the whole frame");
            assert!(frame.kind_code() == collected.held()[3], "T8: its kind");
            true
        }
        (Feed::Broken(FrameError::Checksum), Ok(Some(_))) | (Feed::Incomplete, Ok(None)) => false,
        (Feed::Broken(error), Err(why)) => {
            assert!(error == why, "T8: broken stays broken");
            false
        }
        _ => panic!("T8: a frame is returned when it is there"),
    };
    assert!(deframer.is_valid(), "T8: the deframer's invariant is kept");
    returned
}

/// Bytes as long as their header states, cut in two: the deframer says of them what
/// [`Frame::parse`] says, after the second part. A returned frame is gone when `next` arrives,
/// which is less than a header. True if one was returned.
pub fn cut_frame_is_judged_alike(bytes: &[u8], cut: usize, next: &[u8]) -> bool {
    let (first, second) = bytes.split_at(cut);
    let mut deframer = Deframer::new();
    assert!(deframer.feed(first) == Feed::Incomplete, "T8: not yet");
    assert!(!deframer.is_at_boundary() || first.is_empty(), "T8: inside");
    match (deframer.feed(second), Frame::parse(bytes)) {
        (Feed::Frame { frame, consumed }, Ok(parsed)) => {
            assert!(consumed == second.len(), "T8: all of it is taken");
            assert!(frame == parsed, "T8: any split, the same frame");
        }
        (Feed::Broken(error), Err(why)) => {
            assert!(error == why, "T8: any split, the same error");
            return false;
        }
        _ => panic!("T8: any split, the same verdict"),
    }
    assert!(
        deframer.is_at_boundary(),
        "T8: after a frame, at a boundary"
    );
    assert!(
        deframer.feed(next) == Feed::Incomplete,
        "T8: a returned frame is dropped"
    );
    assert!(deframer.is_valid(), "T8: the deframer's invariant is kept");
    true
}

/// Kind and body of every frame in a stream, or why it broke and after how many frames.
type Deframed = (Vec<(u8, Vec<u8>)>, Option<FrameError>);

/// Feeds a stream in the given chunks.
#[must_use]
pub fn deframe<'a>(chunks: impl Iterator<Item = &'a [u8]>) -> Deframed {
    let mut deframer = Deframer::new();
    let mut frames = Vec::new();
    for chunk in chunks {
        let mut rest = chunk;
        loop {
            match deframer.feed(rest) {
                Feed::Incomplete => break,
                Feed::Frame { frame, consumed } => {
                    assert!(consumed <= rest.len(), "T8: consumed <= given");
                    assert!(consumed > 0, "T8: no frame twice");
                    decoded_frame_is_canonical::<3>(&frame);
                    frames.push((frame.kind_code(), frame.body().to_vec()));
                    rest = &rest[consumed..];
                }
                Feed::Broken(error) => return (frames, Some(error)),
            }
        }
    }
    (frames, None)
}

/// A stream means the same however it is cut.
pub fn cutting_changes_nothing(stream: &[u8], chunk_lengths: &[u8]) {
    let whole = deframe(std::iter::once(stream));
    let mut rest = stream;
    let mut lengths = chunk_lengths
        .iter()
        .cycle()
        .map(|length| usize::from(*length) + 1);
    let chunks = std::iter::from_fn(|| {
        let length = lengths.next().unwrap_or(1).min(rest.len());
        let (chunk, after) = rest.split_at(length);
        rest = after;
        (length > 0).then_some(chunk)
    });
    assert!(deframe(chunks) == whole, "T8: any split");
}

/// A frame that decodes encodes to the same frame again.
fn decoded_frame_is_canonical<const N: usize>(frame: &Frame<'_>) {
    let kind = frame.kind_code();
    let body = frame.body();
    for encoded in [
        decode_client::<N>(frame).map(|message| encode_client(&message)),
        decode_server::<N>(frame).map(|message| encode_server(&message)),
    ]
    .into_iter()
    .flatten()
    {
        let again =
            Frame::parse(&encoded).map(|frame| (frame.kind_code(), frame.body()) == (kind, body));
        assert!(again == Ok(true), "T8: decode(b) = m => encode(m) = b");
    }
}

/// A frame whose outside is right, with any contents: by the page `wire.md`, without core.
#[must_use]
pub fn sealed(version: u8, kind: u8, body: &[u8]) -> Vec<u8> {
    let length = u16::try_from(body.len()).unwrap_or(u16::MAX);
    let mut bytes = vec![b'G', b'T', version, kind];
    bytes.extend_from_slice(&length.to_le_bytes());
    bytes.extend_from_slice(&[0, 0]);
    bytes.extend_from_slice(body);
    bytes.extend_from_slice(&crc_32(&bytes).to_le_bytes());
    bytes
}

/// CRC-32/ISO-HDLC, bit by bit.
#[must_use]
pub fn crc_32(bytes: &[u8]) -> u32 {
    let mut register = u32::MAX;
    for byte in bytes {
        register ^= u32::from(*byte);
        for _ in 0..8 {
            let carry = register & 1 == 1;
            register >>= 1;
            if carry {
                register ^= 0xedb8_8320;
            }
        }
    }
    !register
}

/// A sealed frame is refused for its version or its length, or is parsed; its message has no other
/// encoding; it is the same however it is cut; and it is a frame no more when one bit of it flips.
/// The first cut lies at `cut`, the bit is number `bit`.
pub fn sealed_frame_is_judged(version: u8, kind: u8, body: &[u8], cut: u16, bit: u16) {
    let bytes = sealed(version, kind, body);
    let expected = first_wrong(&bytes).map_or(Ok(()), Err);
    let is_for_its_front = version != PROTOCOL_VERSION || body.len() > MAX_BODY;
    assert!(
        expected.is_err() == is_for_its_front,
        "T8: sealed frames of this version are frames"
    );
    assert!(
        frame_is_parsed(&bytes, bit.into()) == expected,
        "T8: refused for what is wrong with it, and for nothing else"
    );
    cutting_changes_nothing(&[&bytes[..], &bytes[..]].concat(), &cut.to_le_bytes());
    if expected.is_err() {
        return;
    }
    let _ = (
        message_is_canonical::<1>(&bytes),
        message_is_canonical::<3>(&bytes),
        message_is_canonical::<6>(&bytes),
    );
    let at = usize::from(cut) % bytes.len();
    let returned = cut_frame_is_judged_alike(&bytes, at, b"GT");
    assert!(returned, "T8: a frame that parses is returned");
    let mut damaged = bytes;
    let bit = usize::from(bit) % (damaged.len() * 8);
    damaged[bit / 8] ^= 1 << (bit % 8);
    assert!(
        frame_is_parsed(&damaged, 0).is_err(),
        "T8: one wrong bit is noticed"
    );
}
