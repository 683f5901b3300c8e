//! Faults to inject: probabilities per frame, and a script in TOML.

use std::fmt;
use std::num::NonZeroU64;
use std::str::FromStr;
use std::time::Duration;

use gantry_tau_core::control::endpoint::Transport;
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
        [Direction::Up, Direction::Down]
            .into_iter()
            .any(|one| self.include(one) && other.include(one))
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

impl FaultPlan {
    /// Checks that the plan can be carried out on this transport.
    ///
    /// # Errors
    /// The first fault that does not exist there, a parameter that its fault does not take, or probabilities above 1 together.
    pub fn check(&self, transport: Transport) -> Result<(), PlanError> {
        let sum: f64 = self.rates.iter().map(|(_, rate)| rate.per_frame).sum();
        if sum > 1.0 {
            let reason = format!("the probabilities of all faults add up to {sum}, more than 1");
            return Err(PlanError(reason));
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
                return Err(PlanError(match transport {
                    Transport::Stream => format!("{fault}: a stream keeps its order; --udp only"),
                    Transport::Datagram => {
                        format!("{fault}: a datagram has no connection; not with --udp")
                    }
                }));
            }
            if parameter.is_some() && !fault.has_parameter() {
                return Err(PlanError(format!("{fault} takes no parameter")));
            }
        }
        Ok(())
    }
}

/// Reason why a plan or a script is refused, in one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlanError(String);

impl fmt::Display for PlanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for PlanError {}

/// A script as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Script {
    #[serde(default)]
    fault: Vec<Entry>,
}

/// One `[[fault]]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    at_frame: Option<NonZeroU64>,
    at_ms: Option<u64>,
    direction: Directions,
    kind: Fault,
    parameter: Option<u32>,
}

/// Reads a script: a list of `[[fault]]` with `at_frame` or `at_ms`, `direction`, `kind` and, where the kind takes one, `parameter`.
///
/// # Errors
/// [`PlanError`] naming the line and its key, or the entry (counted from 1) and its key.
pub fn parse_script(text: &str) -> Result<Vec<ScriptedFault>, PlanError> {
    let written: Script = toml::from_str(text).map_err(|error| syntax(text, &error))?;
    let mut script: Vec<ScriptedFault> = Vec::new();
    for (number, entry) in (1..).zip(written.fault) {
        let fail = |reason: &str| Err(PlanError(format!("fault {number}: {reason}")));
        let when = match (entry.at_frame, entry.at_ms) {
            (Some(frame), None) => When::Frame(frame.get()),
            (None, Some(ms)) => When::Since(Duration::from_millis(ms)),
            _ => return fail("needs either `at_frame` or `at_ms`"),
        };
        if entry.parameter.is_some() && !entry.kind.has_parameter() {
            return fail(&format!("`parameter`: {} takes none", entry.kind));
        }
        let same_frame = |other: &ScriptedFault| {
            matches!(when, When::Frame(_))
                && other.when == when
                && other.direction.overlap(entry.direction)
        };
        if script.iter().any(same_frame) {
            return fail("`at_frame`: this frame already has a fault");
        }
        script.push(ScriptedFault {
            when,
            direction: entry.direction,
            fault: entry.kind,
            parameter: entry.parameter,
        });
    }
    Ok(script)
}

/// The TOML reader's reason, with number and text of the line.
fn syntax(text: &str, error: &toml::de::Error) -> PlanError {
    let start = error.span().map_or(0, |span| span.start);
    let number = text.get(..start).unwrap_or(text).matches('\n').count();
    let line = text.lines().nth(number).unwrap_or_default().trim();
    let reason = error.message().replace('\n', "; ");
    PlanError(format!("line {}, `{line}`: {reason}", number + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_script_is_read_entry_by_entry() {
        let text = "# a rehearsal
            [[fault]]
            at_frame = 100
            direction = \"up\"
            kind = \"corrupt\"
            parameter = 17 # bit
            [[fault]]
            at_ms = 2_500
            direction = \"down\"
            kind = \"stall\"
            [[fault]]
            at_ms = 3000
            direction = \"both\"
            kind = \"half-open\"";
        let entry = |when, direction, fault, parameter| ScriptedFault {
            when,
            direction,
            fault,
            parameter,
        };
        let since = |ms| When::Since(Duration::from_millis(ms));
        let expected = [
            entry(When::Frame(100), Directions::Up, Fault::Corrupt, Some(17)),
            entry(since(2_500), Directions::Down, Fault::Stall, None),
            entry(since(3_000), Directions::Both, Fault::HalfOpen, None),
        ];
        assert_eq!(parse_script(text).unwrap(), expected);
        assert_eq!(parse_script("").unwrap(), []);
        for fault in Fault::ALL {
            let text = format!("[[fault]]\nat_ms = 1\ndirection = \"up\"\nkind = \"{fault}\"");
            assert_eq!(parse_script(&text).unwrap()[0].fault, fault);
        }
    }

    #[test]
    fn a_script_error_names_place_key_and_reason() {
        let up = "direction = \"up\"";
        for (text, words) in [
            ("x = 1".to_owned(), ["line 1, `x = 1`: ", "unknown field"]),
            (
                "frame 1 up drop".to_owned(),
                ["line 1, `frame 1 up drop`: ", ""],
            ),
            (
                format!("[[fault]]\nat_frame = -1\n{up}"),
                ["line 2, `at_frame = -1`: ", "-1"],
            ),
            (
                format!("[[fault]]\nat_frame = 0\n{up}"),
                ["line 2, `at_frame = 0`: ", "nonzero"],
            ),
            (
                "[[fault]]\nat_ms = 1\nkind = \"drop\"".to_owned(),
                ["line 1, `[[fault]]`: ", "`direction`"],
            ),
            (
                "[[fault]]\ndirection = \"left\"".to_owned(),
                ["line 2, `direction = \"left\"`: ", "`both`"],
            ),
            (
                format!("[[fault]]\n{up}\nkind = \"explode\""),
                ["line 3, `kind = \"explode\"`: ", "`half-open`"],
            ),
            (
                format!("[[fault]]\n{up}\nkind = \"split\"\nparameter = \"x\""),
                ["line 4, `parameter = \"x\"`: ", "u32"],
            ),
            (
                format!("[[fault]]\n{up}\nkind = \"drop\""),
                ["fault 1: ", "either `at_frame` or `at_ms`"],
            ),
            (
                format!("[[fault]]\n{up}\nkind = \"drop\"\nat_ms = 1\nat_frame = 1"),
                ["fault 1: ", "either"],
            ),
            (
                format!("[[fault]]\n{up}\nkind = \"drop\"\nat_ms = 1\nparameter = 3"),
                ["fault 1: `parameter`: ", "drop takes none"],
            ),
        ] {
            let said = parse_script(&text).unwrap_err().to_string();
            let [place, reason] = words;
            assert!(
                said.starts_with(place) && said.contains(reason) && !said.contains('\n'),
                "{said}"
            );
        }
        let both = |one: &str, other: &str| {
            let entry = |direction| {
                format!("[[fault]]\nat_frame = 7\nkind = \"drop\"\ndirection = \"{direction}\"\n")
            };
            parse_script(&[entry(one), entry(other)].concat())
        };
        assert_eq!(both("up", "down").unwrap().len(), 2);
        let said = both("up", "both").unwrap_err().to_string();
        assert_eq!(said, "fault 2: `at_frame`: this frame already has a fault");
    }

    #[test]
    fn rates_and_plans_are_checked() {
        let rate: FaultRate = "0.5:20".parse().unwrap();
        assert_eq!((rate.per_frame, rate.parameter), (0.5, Some(20)));
        for text in ["", "x", "1.01", "-0.1", "NaN", "0.1:", "0.1:-1"] {
            assert!(text.parse::<FaultRate>().is_err(), "{text}");
        }
        let plan = |all: &[(Fault, &str)]| FaultPlan {
            rates: all
                .iter()
                .map(|(fault, rate)| (*fault, rate.parse().unwrap()))
                .collect(),
            ..FaultPlan::default()
        };
        let half = (Fault::Drop, "0.5");
        assert!(plan(&[half, half]).check(Transport::Stream).is_ok());
        let said = |plan: FaultPlan, transport| plan.check(transport).unwrap_err().to_string();
        assert!(said(plan(&[half, half, half]), Transport::Stream).contains("more than 1"));
        assert!(said(plan(&[(Fault::Reorder, "0")]), Transport::Stream).contains("--udp only"));
        assert!(said(plan(&[(Fault::Reset, "0")]), Transport::Datagram).contains("no connection"));
        assert!(said(plan(&[(Fault::Drop, "0.1:3")]), Transport::Stream).contains("no parameter"));
    }
}
