//! Force samples from the machine that has the sensor to the client that needs them: a stream of
//! fixed records over TCP.
//!
//! It stands for the thesis' path from the sensor to the controller `[T 4.2.3, 4.2.5]` and is not
//! part of the controller's protocol. A record is 56 bytes, little-endian: tick `u64`, then force
//! (N) and moment (N m) in sensor axes as six `f64`.

use std::io;

use crate::links::{
    MAX_RECORD, Publisher, Record, RecordReader, SIX_COMPONENTS, put_six_components, six_components,
};

/// One sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Tick in which it was taken.
    pub tick: u64,
    /// Force (N) then moment (N m), sensor axes.
    pub wrench: [f64; 6],
}

impl Record for Sample {
    fn encode(&self, bytes: &mut [u8; MAX_RECORD]) -> usize {
        put_six_components(bytes, self.tick, &self.wrench)
    }

    fn expected(_: &[u8]) -> io::Result<usize> {
        Ok(SIX_COMPONENTS)
    }

    fn decode(bytes: &[u8]) -> Self {
        let (tick, wrench) = six_components(bytes);
        Self { tick, wrench }
    }
}

/// Publishes samples from the cycle.
pub type SensorPublisher = Publisher<Sample>;
/// Reads samples; keeps the latest.
pub type SensorReader = RecordReader<Sample>;

#[cfg(test)]
mod tests {
    use super::*;
    use gantry_tau_system::dial::NEVER;

    fn sample(tick: u64) -> Sample {
        Sample {
            tick,
            wrench: [1.0, -2.0, 3.5, 0.1, f64::MIN_POSITIVE, -0.0],
        }
    }

    #[test]
    fn the_latest_sample_arrives() {
        let mut publisher = SensorPublisher::bind(([127, 0, 0, 1], 0).into()).unwrap();
        let mut reader = SensorReader::connect(publisher.address().unwrap(), &NEVER).unwrap();
        let mut tick = 0;
        let received = loop {
            tick += 1;
            publisher.publish(&sample(tick));
            if let Some(latest) = reader.latest().unwrap() {
                break latest;
            }
        };
        assert_eq!(received, sample(received.tick));
        drop(publisher);
        while reader.latest().is_ok() {
            std::thread::yield_now();
        }
    }
}
