//! Framing: part of T8.

use gantry_tau_core::wire::{
    Deframer, Feed, Frame, FrameError, decode_client, decode_server, encode_client, encode_server,
};

/// Kind and body of every frame in a stream, or why it broke and after how many frames.
type Deframed = (Vec<(u8, Vec<u8>)>, Option<FrameError>);

/// Feeds a stream in the given chunks.
///
/// # Panics
/// When the deframer claims bytes it was not given.
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
                    canonical(&frame);
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
///
/// # Panics
/// When it does not.
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

/// What decodes encodes to the same frame again.
///
/// # Panics
/// When it does not.
pub fn canonical(frame: &Frame<'_>) {
    if let Ok(message) = decode_client::<3>(frame) {
        same_body(frame, &encode_client(&message));
    }
    if let Ok(message) = decode_server::<3>(frame) {
        same_body(frame, &encode_server(&message));
    }
}

fn same_body(frame: &Frame<'_>, encoded: &[u8]) {
    assert!(
        Frame::parse(encoded) == Ok(*frame),
        "T8: decode(b) = m => encode(m) = b"
    );
}
