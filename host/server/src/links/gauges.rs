//! Length gauges from the machine that has them to the program that measures a campaign: a stream
//! of records over TCP.
//!
//! It stands for the thesis' path from the gauges to the controller `[T 4.2.6]` and is not part of
//! the controller's protocol. A record is, little-endian: tick `u64` (of the publisher's own clock,
//! another one in each record), count `u64` of at most 16, then as many lengths in metres as `f64`;
//! at most 144 bytes. NaN: the gauge is not mounted.

use std::io;

use crate::links::{MAX_RECORD, Publisher, Record, RecordReader, fields, put_fields};

/// Largest number of gauges.
pub const MAX_GAUGES: usize = 16;
/// Bytes of tick and count.
pub const HEAD: usize = 16;

/// Lengths of all gauges in one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lengths {
    /// Tick in which they were taken.
    pub tick: u64,
    lengths_m: [f64; MAX_GAUGES],
    count: usize,
}

impl Lengths {
    /// Lengths, m; what is beyond [`MAX_GAUGES`] is left out.
    #[must_use]
    pub fn new(tick: u64, lengths_m: impl IntoIterator<Item = f64>) -> Self {
        let mut lengths = Self {
            tick,
            lengths_m: [0.0; MAX_GAUGES],
            count: 0,
        };
        for (place, length_m) in lengths.lengths_m.iter_mut().zip(lengths_m) {
            *place = length_m;
            lengths.count += 1;
        }
        lengths
    }

    /// The lengths, m.
    #[must_use]
    pub fn lengths_m(&self) -> &[f64] {
        self.lengths_m.get(..self.count).unwrap_or_default()
    }
}

impl Record for Lengths {
    fn encode(&self, bytes: &mut [u8; MAX_RECORD]) -> usize {
        let head = [self.tick.to_le_bytes(), (self.count as u64).to_le_bytes()];
        put_fields(
            bytes,
            head.into_iter().chain(
                self.lengths_m()
                    .iter()
                    .map(|length_m| length_m.to_le_bytes()),
            ),
        )
    }

    fn expected(bytes: &[u8]) -> io::Result<usize> {
        let Some(count) = fields(bytes).nth(1).map(u64::from_le_bytes) else {
            return Ok(HEAD);
        };
        match usize::try_from(count) {
            Ok(count) if count <= MAX_GAUGES => Ok(HEAD + 8 * count),
            _ => {
                let reason =
                    format!("a record has {count} gauges; at most {MAX_GAUGES} are possible");
                Err(io::Error::new(io::ErrorKind::InvalidData, reason))
            }
        }
    }

    fn decode(bytes: &[u8]) -> Self {
        let tick = fields(bytes).next().map_or(0, u64::from_le_bytes);
        Self::new(tick, fields(bytes).skip(2).map(f64::from_le_bytes))
    }
}

/// Publishes lengths from the cycle.
pub type GaugePublisher = Publisher<Lengths>;
/// Reads lengths; keeps the latest.
pub type GaugeReader = RecordReader<Lengths>;

const _: () = assert!(
    HEAD + 8 * MAX_GAUGES == MAX_RECORD,
    "the longest record has all gauges"
);

#[cfg(test)]
mod tests {
    use super::*;
    use gantry_tau_system::dial::NEVER;
    use std::io::Write;
    use std::net::TcpListener;

    fn lengths(tick: u64) -> Lengths {
        Lengths::new(tick, [1.0e-6, -2.0e-6, f64::MIN_POSITIVE])
    }

    #[test]
    fn the_latest_lengths_arrive() {
        let mut publisher = GaugePublisher::bind(([127, 0, 0, 1], 0).into()).unwrap();
        let mut reader = GaugeReader::connect(publisher.address().unwrap(), &NEVER).unwrap();
        let mut tick = 0;
        let received = loop {
            tick += 1;
            publisher.publish(&lengths(tick));
            if let Some(latest) = reader.latest().unwrap() {
                break latest;
            }
        };
        assert_eq!(received, lengths(received.tick));
        assert_eq!(received.lengths_m().len(), 3);
        drop(publisher);
        while reader.latest().is_ok() {
            std::thread::yield_now();
        }
    }

    /// Reads bytes to their end; returns the last lengths and the error.
    fn read_all(bytes: &[u8]) -> (Option<Lengths>, io::Error) {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let mut reader = GaugeReader::connect(listener.local_addr().unwrap(), &NEVER).unwrap();
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(bytes).unwrap();
        drop(stream);
        loop {
            match reader.latest() {
                Ok(_) => std::thread::yield_now(),
                Err(error) => return (reader.latest, error),
            }
        }
    }

    #[test]
    fn hostile_bytes_end_in_an_error_never_in_a_record() {
        let mut bytes = [0; MAX_RECORD];
        let length = Lengths::new(7, [1.0; 3]).encode(&mut bytes);
        let record = &bytes[..length];
        let (latest, error) = read_all(record);
        assert_eq!(
            (latest.unwrap().tick, error.kind()),
            (7, io::ErrorKind::UnexpectedEof)
        );
        for cut in 0..length {
            assert_eq!(read_all(&record[..cut]).0, None, "{cut}");
        }
        let mut seventeen = bytes;
        seventeen[8] = 17;
        let (latest, error) = read_all(&seventeen);
        assert_eq!((latest, error.kind()), (None, io::ErrorKind::InvalidData));
        assert_eq!(
            error.to_string(),
            "a record has 17 gauges; at most 16 are possible"
        );
        let mut huge = bytes;
        huge[8..16].copy_from_slice(&u64::MAX.to_le_bytes());
        assert_eq!(read_all(&huge).1.kind(), io::ErrorKind::InvalidData);
    }
}
