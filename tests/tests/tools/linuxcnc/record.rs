//! The sampler's record: one row per servo period.

use gantry_tau_core::control::message::Phase;

/// Phases, as on the pin.
pub(super) const LISTENING: u8 = Phase::Listening.code();
pub(super) const HANDSHAKE: u8 = Phase::Handshake.code();
pub(super) const SUBMIT: u8 = Phase::Submit.code();
pub(super) const OBTAIN: u8 = Phase::Obtain.code();
pub(super) const SAFE_DISCONNECT: u8 = Phase::SafeDisconnect.code();
pub(super) const FAULT: u8 = Phase::Fault.code();

/// One servo period.
#[derive(Debug)]
pub(super) struct Row {
    /// `joint.N.motor-pos-cmd`, mm and degrees.
    pub(super) joints: Vec<f64>,
    /// `axis.L.pos-cmd`, mm and degrees.
    pub(super) axes: Vec<f64>,
    /// `motion.motion-enabled`.
    pub(super) is_on: bool,
    /// `motion.coord-mode`: a program moves the tool.
    pub(super) is_world: bool,
    /// `gantrytaukins.refused`.
    pub(super) refused: f64,
    /// `gantrytaukins.residual`, m.
    pub(super) residual_m: f64,
}

/// All rows of a run; none is missing.
pub(super) struct Record(pub(super) Vec<Row>);

impl Record {
    /// Parses the output of `halsampler -t`.
    pub(super) fn parse(text: &str) -> Self {
        Self(samples(text).iter().map(|fields| row(fields)).collect())
    }
}

/// Numbers of each line of `halsampler -t`, without its own. Fails if a period is missing. The last
/// line may be cut.
pub(super) fn samples(text: &str) -> Vec<Vec<f64>> {
    let whole = text.rfind('\n').map_or("", |end| &text[..end]);
    let samples = whole.lines().enumerate().map(|(number, line)| {
        let (own, fields) = line
            .trim_start()
            .split_once(char::is_whitespace)
            .unwrap_or_else(|| panic!("line {number}: {line}"));
        assert_eq!(own.parse(), Ok(number), "a period is missing: {line}");
        let fields = fields.split_whitespace();
        fields
            .map(|field| {
                field
                    .parse()
                    .unwrap_or_else(|_| panic!("line {number}: {line}"))
            })
            .collect()
    });
    samples.collect()
}

fn row(fields: &[f64]) -> Row {
    let [positions @ .., residual, is_on, is_world, refused] = fields else {
        panic!("{fields:?}")
    };
    let (joints, axes) = positions.split_at(positions.len() / 2);
    Row {
        joints: joints.to_vec(),
        axes: axes.to_vec(),
        is_on: *is_on != 0.0,
        is_world: *is_world != 0.0,
        refused: *refused,
        residual_m: *residual,
    }
}
