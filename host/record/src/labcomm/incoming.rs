//! Bytes of a stream that come in pieces, and the events in them.

use gantry_tau_labcomm::{Decoded, Decoder, Error, Event};

/// Bytes that may be walked in each call without an event, so that one up to this size is never
/// waited for.
const FREE: usize = 8_192;

/// Decoder of a stream, and the bytes that it has not used.
///
/// An event of 2006 does not tell its length, so that it is walked from its front whenever more
/// bytes have come. A walk over many bytes that ends before the event is repeated only after as
/// many more have come, or after one call per 8 KiB of them: the work is proportional to bytes and
/// calls.
#[derive(Debug)]
pub struct Incoming<const S: usize, const B: usize> {
    decoder: Box<Decoder<S, B>>,
    bytes: Vec<u8>,
    /// Number of bytes at the front that are used.
    used: usize,
    /// Number of unused bytes that the next event has at least.
    least: usize,
    /// Bytes to come before the next walk.
    wait: usize,
}

impl<const S: usize, const B: usize> Incoming<S, B> {
    /// Returns the beginning of a stream with values of at most `most` bytes.
    pub fn new(most: u32) -> Self {
        Self {
            decoder: Box::new(Decoder::new(most)),
            bytes: Vec::new(),
            used: 0,
            least: 1,
            wait: 0,
        }
    }

    /// Returns the decoder, for its offset and its definitions.
    pub const fn decoder(&self) -> &Decoder<S, B> {
        &self.decoder
    }

    /// Returns the number of bytes that no event has used.
    pub(crate) fn held(&self) -> usize {
        self.bytes.len().saturating_sub(self.used)
    }

    /// Returns the number of bytes that the next event has at least.
    pub(crate) const fn least(&self) -> usize {
        self.least
    }

    /// Appends bytes that have come.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.used);
        self.used = 0;
        self.bytes.extend_from_slice(bytes);
        self.wait = self.wait.saturating_sub(bytes.len());
    }

    /// Ends the stream: the next walk waits for nothing.
    pub const fn end(&mut self) {
        self.wait = 0;
    }

    /// Returns the next event, if it is complete and not waited for.
    ///
    /// # Errors
    /// As [`Decoder::decode`].
    pub fn next_event(&mut self) -> Result<Option<Event<'_, '_>>, Error> {
        let rest = self.bytes.get(self.used..).unwrap_or_default();
        if rest.len() < self.least || self.wait > 0 {
            self.wait = self.wait.saturating_sub(FREE);
            return Ok(None);
        }
        match self.decoder.decode(rest)? {
            Decoded::Need(least) => {
                self.wait = match least.saturating_sub(rest.len()) {
                    // The length is not known.
                    1 => rest.len().saturating_sub(FREE),
                    _ => 0,
                };
                self.least = least;
                Ok(None)
            }
            Decoded::Event { event, used } => {
                self.used = self.used.saturating_add(used);
                self.least = 1;
                Ok(Some(event))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use gantry_tau_labcomm::{Encoder, Event, Type, Version};

    use super::Incoming;

    /// Stream of 2006 with a value of `count` texts of no bytes, and one of a byte behind it.
    fn texts(count: u32) -> Vec<u8> {
        let mut bytes = vec![0; 200 + 4 * usize::try_from(count).unwrap()];
        let mut encoder = Encoder::new(Version::V2006, &mut bytes);
        // An array of one index, not said, of strings; and a byte.
        let texts = [0, 0, 0, 0x10, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0x27];
        let texts = Type::whole(Version::V2006, &texts).unwrap();
        let byte = Type::whole(Version::V2006, &[0, 0, 0, 0x21]).unwrap();
        encoder.define_type(0x80, b"texts", &texts).unwrap();
        encoder.define_type(0x81, b"byte", &byte).unwrap();
        let value = [
            count.to_be_bytes().as_slice(),
            &vec![0; 4 * usize::try_from(count).unwrap()],
        ]
        .concat();
        encoder.data_bytes(0x80, &texts, &value).unwrap();
        encoder.data_bytes(0x81, &byte, &[7]).unwrap();
        let length = encoder.len();
        bytes.truncate(length);
        bytes
    }

    /// Events of a stream that comes in pieces, and the bytes that were walked without one.
    fn walked(stream: &[u8], piece: usize) -> (usize, usize) {
        let mut incoming = Incoming::<8, 1024>::new(1 << 24);
        let (mut events, mut repeated) = (0, 0);
        for bytes in stream.chunks(piece) {
            incoming.push(bytes);
            loop {
                let is_walked = incoming.wait == 0 && incoming.held() >= incoming.least();
                if incoming.next_event().unwrap().is_none() {
                    repeated += if is_walked { incoming.held() } else { 0 };
                    break;
                }
                events += 1;
            }
        }
        incoming.end();
        while let Some(event) = incoming.next_event().unwrap() {
            assert!(!matches!(event, Event::Skipped(_)));
            events += 1;
        }
        assert_eq!(incoming.held(), 0);
        (events, repeated)
    }

    #[test]
    fn a_long_value_in_pieces_is_walked_a_few_times_and_none_is_lost() {
        let stream = texts(250_000);
        for piece in [4_096, 65_536] {
            let (events, repeated) = walked(&stream, piece);
            assert_eq!(events, 4);
            // 4 KiB pieces, and 8 KiB for each call: three times the bytes.
            assert!(
                repeated <= 4 * stream.len(),
                "{piece}: {repeated} of {}",
                stream.len()
            );
        }
    }

    /// Number of the events that are complete and not waited for.
    fn count_events(incoming: &mut Incoming<8, 1024>) -> usize {
        let mut events = 0;
        while incoming.next_event().unwrap().is_some() {
            events += 1;
        }
        events
    }

    /// The walk is repeated without a further byte, in calls that are bounded by the size.
    #[test]
    fn a_complete_value_is_found_without_further_bytes() {
        let stream = texts(25_000);
        let mut incoming = Incoming::<8, 1024>::new(1 << 24);
        incoming.push(&stream[..90_000]);
        let mut events = count_events(&mut incoming);
        incoming.push(&stream[90_000..]);
        let mut calls = 0;
        while events < 4 {
            events += count_events(&mut incoming);
            calls += 1;
        }
        assert_eq!(events, 4);
        assert!(calls <= 90_000 / super::FREE + 1, "{calls}");
    }

    #[test]
    fn a_short_event_is_found_with_its_last_byte() {
        let stream = texts(3);
        assert_eq!(walked(&stream, 1).0, 4);
        let mut incoming = Incoming::<8, 1024>::new(100);
        incoming.push(&stream[..stream.len() - 1]);
        while incoming.next_event().unwrap().is_some() {}
        incoming.push(&stream[stream.len() - 1..]);
        assert!(matches!(
            incoming.next_event(),
            Ok(Some(Event::Data { .. }))
        ));
    }
}
