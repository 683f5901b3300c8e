//! Raw bytes in random chunks: the deframer is total, a stream means the same however it is cut,
//! what decodes is canonical (T8).

use gantry_tau_proofs::properties::wire::cutting_changes_nothing;

/// The first byte says how many of the next are chunk lengths; the rest is the stream.
pub fn deframer(data: &[u8]) {
    let Some((count, rest)) = data.split_first() else {
        return;
    };
    let count = usize::from(count % 16).min(rest.len());
    let (lengths, stream) = rest.split_at(count);
    cutting_changes_nothing(stream, lengths);
}
