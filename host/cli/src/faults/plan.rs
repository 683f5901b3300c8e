//! Faults to inject: probabilities per frame, and a script in TOML.

use std::num::NonZeroU64;
use std::path::Path;
use std::str::FromStr;
use std::time::Duration;

use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_system::lines::{TextError, read_text};
use serde::Deserialize;

use super::{Direction, Fault};

/// One or both directions of a connection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Directions {
    /// From the client to the server.
    Up,
    /// From the server to the client.
    Down,
    /// Both.
    #[default]
    Both,
}

impl Directions {
    /// True if `direction` is one of these.
    #[must_use]
    pub const fn include(self, direction: Direction) -> bool {
        match self {
            Self::Up => matches!(direction, Direction::Up),
            Self::Down => matches!(direction, Direction::Down),
            Self::Both => true,
        }
    }

    fn overlap(self, other: Self) -> bool {
        self == other || self == Self::Both || other == Self::Both
    }
}

impl FromStr for Directions {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "up" => Ok(Self::Up),
            "down" => Ok(Self::Down),
            "both" => Ok(Self::Both),
            _ => Err("expected up, down or both"),
        }
    }
}

/// Probability of a fault. As text: `P` or `P:PARAMETER`, for instance `0.01` or `0.001:50`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultRate {
    /// Probability per frame, 0 to 1.
    pub per_frame: f64,
    /// Parameter of the fault; its default, or drawn, if `None`.
    pub parameter: Option<u32>,
}

impl FromStr for FaultRate {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (rate, parameter) = match text.split_once(':') {
            Some((rate, parameter)) => (rate, Some(parameter)),
            None => (text, None),
        };
        let per_frame: f64 = rate.parse().map_err(|_| "P is not a number")?;
        if !(0.0..=1.0).contains(&per_frame) {
            return Err("P must be from 0 to 1");
        }
        let parameter = parameter.map(str::parse).transpose();
        Ok(Self {
            per_frame,
            parameter: parameter.map_err(|_| "N is not a whole number")?,
        })
    }
}

/// Moment of a scripted fault, counted in each connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    /// This frame of its direction; the first is 1.
    Frame(u64),
    /// The first frame at this time since the connection began, or later.
    Since(Duration),
}

/// A fault at a stated moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScriptedFault {
    /// Moment.
    pub when: When,
    /// Directions in which it acts, in each of them once.
    pub direction: Directions,
    /// Kind.
    pub fault: Fault,
    /// Parameter of the fault; its default, or drawn, if `None`.
    pub parameter: Option<u32>,
}

/// Faults to inject.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FaultPlan {
    /// Seed of every draw; connections and directions draw independently.
    pub seed: u64,
    /// Delay of every frame.
    pub delay: Duration,
    /// Largest additional delay, drawn for each frame; the order stays.
    pub jitter: Duration,
    /// Probability of each fault.
    pub rates: Vec<(Fault, FaultRate)>,
    /// Directions to which delay, jitter and rates apply.
    pub direction: Directions,
    /// Scripted faults, beside the rates.
    pub script: Vec<ScriptedFault>,
}

/// Reason why a plan cannot be carried out on a transport.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// One of the faults would always occur.
    #[error("the probabilities of all faults add up to {sum}, more than 1")]
    Probabilities {
        /// Sum of the probabilities.
        sum: f64,
    },
    /// The fault needs datagrams.
    #[error("{fault}: a stream keeps its order; --udp only")]
    NotOnStreams {
        /// The fault.
        fault: Fault,
    },
    /// The fault needs a connection.
    #[error("{fault}: a datagram has no connection; not with --udp")]
    NotOnDatagrams {
        /// The fault.
        fault: Fault,
    },
    /// A parameter that its fault does not take.
    #[error("{fault} takes no parameter")]
    Parameter {
        /// The fault.
        fault: Fault,
    },
}

impl FaultPlan {
    /// Checks that the plan can be carried out on this transport.
    ///
    /// # Errors
    /// [`PlanError`], of the first fault that is wrong.
    pub fn check(&self, transport: Transport) -> Result<(), PlanError> {
        let sum: f64 = self.rates.iter().map(|(_, rate)| rate.per_frame).sum();
        if sum > 1.0 {
            return Err(PlanError::Probabilities { sum });
        }
        let drawn = self
            .rates
            .iter()
            .map(|(fault, rate)| (*fault, rate.parameter));
        let scripted = self
            .script
            .iter()
            .map(|entry| (entry.fault, entry.parameter));
        for (fault, parameter) in drawn.chain(scripted) {
            if !fault.suits(transport) {
                return Err(match transport {
                    Transport::Stream => PlanError::NotOnStreams { fault },
                    Transport::Datagram => PlanError::NotOnDatagrams { fault },
                });
            }
            if parameter.is_some() && !fault.has_parameter() {
                return Err(PlanError::Parameter { fault });
            }
        }
        Ok(())
    }
}

/// A script as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Script {
    #[serde(default)]
    fault: Vec<ScriptEntry>,
}

/// One `[[fault]]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ScriptEntry {
    at_frame: Option<NonZeroU64>,
    at_ms: Option<u64>,
    direction: Directions,
    kind: Fault,
    parameter: Option<u32>,
}

/// Longest script that is read, bytes.
const MAX_SCRIPT: u64 = 1 << 20;

/// Reason why a script cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ScriptError {
    /// Its file cannot be read, or is too long.
    #[error(transparent)]
    File(#[from] TextError),
    /// It is not TOML, or has other keys.
    #[error("line {line}, `{text}`: {reason}")]
    Syntax {
        /// Number of the line, from 1.
        line: usize,
        /// The line.
        text: String,
        /// The reader's reason.
        reason: String,
    },
    /// A fault is wrong.
    #[error("fault {number}: {reason}")]
    Fault {
        /// Number of the fault, from 1.
        number: usize,
        /// The reason.
        #[source]
        reason: ScriptedFaultError,
    },
}

/// Reason why a fault of a script is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScriptedFaultError {
    /// It has no moment, or two.
    #[error("needs either `at_frame` or `at_ms`")]
    Moment,
    /// A parameter that the fault does not take.
    #[error("`parameter`: {fault} takes none")]
    Parameter {
        /// The fault.
        fault: Fault,
    },
    /// Another fault has its frame.
    #[error("`at_frame`: this frame already has a fault")]
    FrameIsTaken,
}

/// Reads the file of a script.
///
/// # Errors
/// [`ScriptError`].
pub fn read_script(path: &Path) -> Result<Vec<ScriptedFault>, ScriptError> {
    parse_script(&read_text(path, MAX_SCRIPT)?)
}

/// Parses a script: a list of `[[fault]]` with `at_frame` or `at_ms`, `direction`, `kind` and,
/// where the kind takes one, `parameter`.
///
/// # Errors
/// [`ScriptError`], which names the line or the entry, and its key.
pub fn parse_script(text: &str) -> Result<Vec<ScriptedFault>, ScriptError> {
    let written: Script = toml::from_str(text).map_err(|error| syntax(text, &error))?;
    let mut script: Vec<ScriptedFault> = Vec::new();
    for (number, entry) in (1..).zip(written.fault) {
        let fault = entry
            .fault()
            .and_then(|fault| fault.with_frame_of_its_own(&script))
            .map_err(|reason| ScriptError::Fault { number, reason })?;
        script.push(fault);
    }
    Ok(script)
}

impl ScriptEntry {
    fn fault(&self) -> Result<ScriptedFault, ScriptedFaultError> {
        let when = match (self.at_frame, self.at_ms) {
            (Some(frame), None) => When::Frame(frame.get()),
            (None, Some(ms)) => When::Since(Duration::from_millis(ms)),
            _ => return Err(ScriptedFaultError::Moment),
        };
        if self.parameter.is_some() && !self.kind.has_parameter() {
            return Err(ScriptedFaultError::Parameter { fault: self.kind });
        }
        Ok(ScriptedFault {
            when,
            direction: self.direction,
            fault: self.kind,
            parameter: self.parameter,
        })
    }
}

impl ScriptedFault {
    /// Checks that no other fault of a script has its frame.
    fn with_frame_of_its_own(self, script: &[Self]) -> Result<Self, ScriptedFaultError> {
        let is_taken = script.iter().any(|other| {
            matches!(self.when, When::Frame(_))
                && other.when == self.when
                && other.direction.overlap(self.direction)
        });
        if is_taken {
            return Err(ScriptedFaultError::FrameIsTaken);
        }
        Ok(self)
    }
}

/// The TOML reader's reason, with number and text of the line.
fn syntax(text: &str, error: &toml::de::Error) -> ScriptError {
    let start = error.span().map_or(0, |span| span.start);
    let number = text.get(..start).unwrap_or(text).matches('\n').count();
    let line = text.lines().nth(number).unwrap_or_default().trim();
    ScriptError::Syntax {
        line: number + 1,
        text: line.to_owned(),
        reason: error.message().replace('\n', "; "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_script_is_read_entry_by_entry() {
        let text = "# a rehearsal
            fault = [
                { at_frame = 100, direction = 'up', kind = 'corrupt', parameter = 17 }, # bit
                { at_ms = 2_500, direction = 'both', kind = 'stall' },
            ]";
        let corrupt = ScriptedFault {
            when: When::Frame(100),
            direction: Directions::Up,
            fault: Fault::Corrupt,
            parameter: Some(17),
        };
        let stall = ScriptedFault {
            when: When::Since(Duration::from_millis(2_500)),
            direction: Directions::Both,
            fault: Fault::Stall,
            parameter: None,
        };
        assert_eq!(parse_script(text).unwrap(), [corrupt, stall]);
        assert_eq!(parse_script("").unwrap(), []);
        for fault in Fault::ALL {
            let text = format!("[[fault]]\nat_ms = 1\ndirection = 'down'\nkind = '{fault}'");
            assert_eq!(parse_script(&text).unwrap()[0].fault, fault);
        }
    }

    #[test]
    fn a_script_error_names_place_key_and_reason() {
        let missing = "direction = 'up'\nkind = 'drop'\n";
        let complete = "at_frame = 7\ndirection = 'up'\nkind = 'drop'\n";
        let again = format!("[[fault]]\n{complete}");
        for (before, entry, place, reason) in [
            ("", "x = 1", "line 2, `x = 1`: ", "unknown field"),
            ("", "frame 1", "line 2, `frame 1`: ", ""),
            ("", "at_frame = -1", "line 2, `at_frame = -1`: ", "-1"),
            ("", "at_frame = 0", "line 2, `at_frame = 0`: ", "nonzero"),
            ("", "at_ms = 1", "line 1, `[[fault]]`: ", "`direction`"),
            ("", "direction = 1", "line 2, `direction = 1`: ", "string"),
            ("", "direction = ''", "line 2, `direction = ''`: ", "`both`"),
            ("", "kind = 'x'", "line 2, `kind = 'x'`: ", "`half-open`"),
            ("", "parameter = 'x'", "line 2, `parameter = 'x'`: ", "u32"),
            (missing, "", "fault 1: ", "either `at_frame` or `at_ms`"),
            (complete, "at_ms = 1", "fault 1: ", "either"),
            (complete, "parameter = 3", "fault 1: `parameter`: ", "none"),
            (complete, &again, "fault 2: `at_frame`: ", "already"),
        ] {
            let text = format!("[[fault]]\n{before}{entry}");
            let said = parse_script(&text).unwrap_err().to_string();
            assert!(said.starts_with(place) && said.contains(reason), "{said}");
            assert!(!said.contains('\n'), "{said}");
        }
        let other_way = complete.replace("up", "down");
        let both = format!("[[fault]]\n{complete}[[fault]]\n{other_way}");
        assert_eq!(parse_script(&both).unwrap().len(), 2);
    }

    #[test]
    fn rates_and_plans_are_checked() {
        let rate: FaultRate = "0.5:20".parse().unwrap();
        assert_eq!((rate.per_frame, rate.parameter), (0.5, Some(20)));
        for text in ["", "x", "1.01", "-0.1", "NaN", "0.1:", "0.1:-1"] {
            assert!(text.parse::<FaultRate>().is_err(), "{text}");
        }
        let half = (Fault::Drop, "0.5");
        assert!(plan(&[half, half]).check(Transport::Stream).is_ok());
        for (rates, transport, words) in [
            (&[half, half, half][..], Transport::Stream, "more than 1"),
            (&[(Fault::Reorder, "0")], Transport::Stream, "--udp only"),
            (&[(Fault::Reset, "0")], Transport::Datagram, "no connection"),
            (&[(Fault::Drop, "0.1:3")], Transport::Stream, "no parameter"),
        ] {
            let said = plan(rates).check(transport).unwrap_err().to_string();
            assert!(said.contains(words), "{said}");
        }
    }

    fn plan(rates: &[(Fault, &str)]) -> FaultPlan {
        FaultPlan {
            rates: rates
                .iter()
                .map(|(fault, rate)| (*fault, rate.parse().unwrap()))
                .collect(),
            ..FaultPlan::default()
        }
    }
}
