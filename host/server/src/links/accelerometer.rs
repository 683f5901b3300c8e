//! Samples of the accelerometer on the platform from the machine that has it to the client that needs
//! them: a stream of fixed records over TCP.
//!
//! A record is 56 bytes, little-endian: tick `u64`, then linear (m/s^2) and angular acceleration
//! (rad/s^2) in the accelerometer's axes as six `f64`. It shows gravity as the robot file says
//! (`sensor.accelerometer.gravity`). The angular acceleration of one with three axes is zero.

use std::io;

use crate::links::{MAX_RECORD, Publisher, Record, RecordReader, fields, put_fields};

/// Bytes of a record.
const LENGTH: usize = 56;

/// One sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acceleration {
    /// Tick in which it was taken.
    pub tick: u64,
    /// Linear (m/s^2), then angular acceleration (rad/s^2), the accelerometer's axes.
    pub components: [f64; 6],
}

impl Record for Acceleration {
    fn encode(&self, bytes: &mut [u8; MAX_RECORD]) -> usize {
        let components = self.components.map(f64::to_le_bytes);
        put_fields(
            bytes,
            [self.tick.to_le_bytes()].into_iter().chain(components),
        )
    }

    fn expected(_: &[u8]) -> io::Result<usize> {
        Ok(LENGTH)
    }

    fn decode(bytes: &[u8]) -> Self {
        let mut fields = fields(bytes);
        let tick = fields.next().map_or(0, u64::from_le_bytes);
        let mut components = [0.0; 6];
        for (component, field) in components.iter_mut().zip(fields) {
            *component = f64::from_le_bytes(field);
        }
        Self { tick, components }
    }
}

/// Publishes samples from the cycle.
pub type AccelerometerPublisher = Publisher<Acceleration>;
/// Reads samples; keeps the latest.
pub type AccelerometerReader = RecordReader<Acceleration>;
