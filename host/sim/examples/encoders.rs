//! Step, force of one count and torque at rest of a drive, by the counts of its encoder.
//!
//! ```text
//! cargo run --example encoders
//! ```

use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::units::{Metres, PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_sim::drive::encoder::Encoder;
use gantry_tau_sim::drive::{Drive, RATED_FORCE_N, Settings};

/// Way of the cart per turn of the motor, m.
const METRES_PER_TURN: f64 = 0.01;
/// Positions within one count at which the drive stands.
const PLACES: u8 = 12;
/// Cycles until the limit cycle has settled, and cycles that are looked at after.
const SETTLING: u32 = 1_000;
const SEEN: u32 = 1_000;

/// One line of the table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line {
    /// Counts per turn.
    pub(crate) counts: u32,
    /// One count, nm.
    pub(crate) step_nm: f64,
    /// Force that the velocity loop asks for when one count changes, N.
    pub(crate) step_n: f64,
    /// Force at rest, root of the mean square about its mean, N.
    pub(crate) rest_n: f64,
}

/// Returns the line of an encoder; `None` if the drive cannot be reported.
pub(crate) fn line(counts: u32) -> Option<Line> {
    let encoder = Encoder::new(counts, METRES_PER_TURN);
    let settings = Settings {
        encoder: Some(encoder),
        ..Settings::IDEAL
    };
    let squares = (0..PLACES).map(|place| {
        // A reference of whole counts is a special one: the drive then stands still.
        let position_nm =
            encoder.step_m() * 1e9 * (5.0 + (f64::from(place) + 0.4) / f64::from(PLACES));
        mean_square_n2(&settings, position_nm)
    });
    let mean = squares.sum::<Option<f64>>()? / f64::from(PLACES);
    Some(Line {
        counts,
        step_nm: encoder.step_m() * 1e9,
        step_n: encoder.step_n(),
        rest_n: mean.sqrt(),
    })
}

/// Returns the mean square of the force of a drive that stands at a position, about its mean.
fn mean_square_n2(settings: &Settings, position_nm: f64) -> Option<f64> {
    let position = PositionNm::from_metres(Metres(position_nm * 1e-9)).ok()?;
    let initial_state = Reference {
        position,
        velocity_offset: VelocityUmS(0),
        torque_offset: TorquePermille(0),
    };
    let mut drive = Drive::at_rest(&initial_state, settings);
    let (mut sum, mut squares) = (0.0, 0.0);
    for cycle in 0..SETTLING + SEEN {
        drive.advance(0.0);
        if cycle >= SETTLING {
            let force_n = drive.force_n();
            sum += force_n;
            squares += force_n * force_n;
        }
    }
    let count = f64::from(SEEN);
    Some(squares / count - (sum / count) * (sum / count))
}

fn main() {
    println!(
        "encoder of a motor that moves its cart by {METRES_PER_TURN} m per turn; rated force {RATED_FORCE_N} N"
    );
    println!(
        "{:>10} {:>12} {:>12} {:>14}",
        "counts", "one count", "asks for", "at rest, rms"
    );
    for bits in [20, 17, 14] {
        match line(1 << bits) {
            Some(Line {
                counts,
                step_nm,
                step_n,
                rest_n,
            }) => {
                println!("{counts:>10} {step_nm:>9.2} nm {step_n:>10.2} N {rest_n:>12.2} N");
            }
            None => println!(
                "{:>10} the drive has left the range of positions",
                1 << bits
            ),
        }
    }
}
