//! What is to happen on a link, and when: odds per frame, and a script.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use super::{Direction, Fault, Medium};

/// A fault with its parameter, whose meaning is the fault's; absent it is the usual one, or drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Act {
    /// What.
    pub fault: Fault,
    /// How much.
    pub parameter: Option<u32>,
}

/// How likely a frame suffers a fault. As text: `P` or `P:PARAMETER`, for instance `0.01` or `0.001:50`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Odds {
    /// Probability per frame, 0 to 1.
    pub per_frame: f64,
    /// The fault's parameter.
    pub parameter: Option<u32>,
}

impl FromStr for Odds {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (odds, parameter) = match text.split_once(':') {
            Some((odds, parameter)) => {
                let parameter = parameter.parse().map_err(|_| "PARAMETER is no number")?;
                (odds, Some(parameter))
            }
            None => (text, None),
        };
        let per_frame: f64 = odds.parse().map_err(|_| "P is no number")?;
        if !(0.0..=1.0).contains(&per_frame) {
            return Err("P must be from 0 to 1");
        }
        Ok(Self {
            per_frame,
            parameter,
        })
    }
}

/// When a cue acts, counted anew in every connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    /// On this frame of its direction; the first is 1.
    Frame(u64),
    /// On the first frame this long after the connection began, or later.
    Since(Duration),
}

/// One line of a script.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cue {
    /// When.
    pub when: When,
    /// Which way; `None` is both.
    pub direction: Option<Direction>,
    /// What.
    pub act: Act,
}

impl Cue {
    /// Whether it concerns a direction.
    #[must_use]
    pub fn concerns(&self, direction: Direction) -> bool {
        self.direction.is_none_or(|own| own == direction)
    }
}

/// What is to happen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// Where every draw comes from; connections and directions draw apart from each other.
    pub seed: u64,
    /// How late every frame is.
    pub delay: Duration,
    /// How much later still at most, drawn for each frame; the order stays.
    pub jitter: Duration,
    /// How likely each fault is.
    pub odds: Vec<(Fault, Odds)>,
    /// Which way delay, jitter and odds apply; `None` is both.
    pub direction: Option<Direction>,
    /// What happens at stated moments, beside the odds.
    pub script: Vec<Cue>,
}

impl Plan {
    /// A link that only forwards.
    #[must_use]
    pub fn harmless() -> Self {
        Self::default()
    }

    /// Checks that it can be carried out on such a link.
    ///
    /// # Errors
    /// The first thing found wrong.
    pub fn check(&self, medium: Medium) -> Result<(), PlanError> {
        let sum: f64 = self.odds.iter().map(|(_, odds)| odds.per_frame).sum();
        if sum > 1.0 {
            return Err(PlanError::Sum { sum });
        }
        let drawn = self
            .odds
            .iter()
            .map(|(fault, odds)| (*fault, odds.parameter));
        let scripted = self
            .script
            .iter()
            .map(|cue| (cue.act.fault, cue.act.parameter));
        for (fault, parameter) in drawn.chain(scripted) {
            if !fault.suits(medium) {
                return Err(PlanError::Unsuited { fault, medium });
            }
            if parameter.is_some() && !fault.has_parameter() {
                return Err(PlanError::Parameter { fault });
            }
        }
        Ok(())
    }
}

/// Why a plan cannot be carried out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlanError {
    /// A frame suffers at most one fault, so the odds must not exceed 1 together.
    Sum {
        /// What they are.
        sum: f64,
    },
    /// The fault has no meaning there.
    Unsuited {
        /// The fault.
        fault: Fault,
        /// Where.
        medium: Medium,
    },
    /// The fault has no parameter.
    Parameter {
        /// The fault.
        fault: Fault,
    },
}

impl fmt::Display for PlanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sum { sum } => write!(f, "the odds are {sum} together, more than 1"),
            Self::Unsuited {
                fault,
                medium: Medium::Stream,
            } => write!(f, "{fault}: a stream keeps its order; --udp only"),
            Self::Unsuited {
                fault,
                medium: Medium::Datagrams,
            } => write!(f, "{fault}: a datagram has no connection; not with --udp"),
            Self::Parameter { fault } => write!(f, "{fault} has no parameter"),
        }
    }
}

impl std::error::Error for PlanError {}

/// Reads a script: one cue per line, `frame N` or `ms N`, then `up`, `down` or `both`, then a fault and perhaps its parameter.
/// `#` begins a comment.
///
/// # Errors
/// The first line that is no cue, and which word of it.
pub fn parse_script(text: &str) -> Result<Vec<Cue>, ScriptError> {
    let mut script: Vec<Cue> = Vec::new();
    for (line, text) in (1..).zip(text.lines()) {
        let fail = |reason: Reason, word: &str| ScriptError {
            line,
            word: word.to_owned(),
            reason,
        };
        let text = text.split('#').next().unwrap_or_default();
        let mut words = text.split_whitespace();
        let Some(unit) = words.next() else { continue };
        let mut next = |reason| words.next().ok_or(fail(reason, "the end of the line"));
        let number = next(Reason::Number)?;
        let count = number.parse().map_err(|_| fail(Reason::Number, number))?;
        let when = match unit {
            "frame" if count > 0 => When::Frame(count),
            "frame" => return Err(fail(Reason::FrameZero, number)),
            "ms" => When::Since(Duration::from_millis(count)),
            _ => return Err(fail(Reason::Unit, unit)),
        };
        let direction = match next(Reason::Direction)? {
            "up" => Some(Direction::Up),
            "down" => Some(Direction::Down),
            "both" => None,
            word => return Err(fail(Reason::Direction, word)),
        };
        let word = next(Reason::Fault)?;
        let fault = Fault::ALL.into_iter().find(|fault| fault.name() == word);
        let fault = fault.ok_or_else(|| fail(Reason::Fault, word))?;
        let parameter = match words.next() {
            None => None,
            Some(word) if !fault.has_parameter() => {
                return Err(fail(Reason::NoParameter, word));
            }
            Some(word) => Some(word.parse().map_err(|_| fail(Reason::Parameter, word))?),
        };
        if let Some(word) = words.next() {
            return Err(fail(Reason::Surplus, word));
        }
        let meets = |other: &Cue| {
            let apart = other.direction.zip(direction);
            matches!(when, When::Frame(_))
                && other.when == when
                && apart.is_none_or(|(one, other)| one == other)
        };
        if script.iter().any(meets) {
            return Err(fail(Reason::Twice, number));
        }
        let act = Act { fault, parameter };
        script.push(Cue {
            when,
            direction,
            act,
        });
    }
    Ok(script)
}

/// What is wrong with a word of a script.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reason {
    Unit,
    Number,
    FrameZero,
    Direction,
    Fault,
    Parameter,
    NoParameter,
    Surplus,
    Twice,
}

/// A line of a script that is no cue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScriptError {
    line: usize,
    word: String,
    reason: Reason,
}

impl fmt::Display for ScriptError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { line, word, reason } = self;
        write!(f, "line {line}, {word:?}: ")?;
        match reason {
            Reason::Unit => f.write_str("a line begins with `frame` or `ms`"),
            Reason::Number => f.write_str("a whole number is due here"),
            Reason::FrameZero => f.write_str("the first frame is 1"),
            Reason::Direction => f.write_str("`up`, `down` or `both` is due here"),
            Reason::Fault => {
                f.write_str("a fault is due here:")?;
                Fault::ALL
                    .iter()
                    .try_for_each(|fault| write!(f, " {fault}"))
            }
            Reason::Parameter => f.write_str("the parameter is no whole number"),
            Reason::NoParameter => f.write_str("this fault has no parameter"),
            Reason::Surplus => f.write_str("nothing is due here"),
            Reason::Twice => f.write_str("this frame has a fault already"),
        }
    }
}

impl std::error::Error for ScriptError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_script_is_read_line_by_line() {
        let text = "# a rehearsal\n\nframe 100 up corrupt 17\nms 2500 down stall 300 # a while\n  ms 3000 both half-open\n";
        let cue = |when, direction, fault, parameter| Cue {
            when,
            direction,
            act: Act { fault, parameter },
        };
        let since = |ms| When::Since(Duration::from_millis(ms));
        let expected = [
            cue(
                When::Frame(100),
                Some(Direction::Up),
                Fault::Corrupt,
                Some(17),
            ),
            cue(since(2_500), Some(Direction::Down), Fault::Stall, Some(300)),
            cue(since(3_000), None, Fault::HalfOpen, None),
        ];
        assert_eq!(parse_script(text).unwrap(), expected);
    }

    #[test]
    fn a_script_error_names_line_and_word() {
        for (text, expected) in [
            ("tick 1 up drop", "line 1, \"tick\": a line begins"),
            ("\nframe", "line 2, \"the end of the line\": a whole number"),
            ("frame -1 up drop", "line 1, \"-1\": a whole number"),
            ("frame 0 up drop", "line 1, \"0\": the first frame is 1"),
            ("ms 1 left drop", "line 1, \"left\": `up`"),
            (
                "ms 1 up explode",
                "line 1, \"explode\": a fault is due here: drop",
            ),
            (
                "ms 1 up drop 3",
                "line 1, \"3\": this fault has no parameter",
            ),
            ("ms 1 up split x", "line 1, \"x\": the parameter"),
            ("ms 1 up split 3 4", "line 1, \"4\": nothing is due"),
            (
                "frame 7 up drop\nframe 7 both split",
                "line 2, \"7\": this frame has",
            ),
        ] {
            let said = parse_script(text).unwrap_err().to_string();
            assert!(said.starts_with(expected), "{said}");
        }
        assert_eq!(
            parse_script("frame 7 up drop\nframe 7 down drop")
                .unwrap()
                .len(),
            2
        );
    }

    #[test]
    fn odds_and_plans_are_checked() {
        let odds: Odds = "0.5:20".parse().unwrap();
        assert_eq!((odds.per_frame, odds.parameter), (0.5, Some(20)));
        for text in ["", "x", "1.01", "-0.1", "NaN", "0.1:", "0.1:-1"] {
            assert!(text.parse::<Odds>().is_err(), "{text}");
        }
        let plan = |all: &[(Fault, &str)]| Plan {
            odds: all
                .iter()
                .map(|(fault, odds)| (*fault, odds.parse().unwrap()))
                .collect(),
            ..Plan::default()
        };
        let half = (Fault::Drop, "0.5");
        assert!(plan(&[half, half]).check(Medium::Stream).is_ok());
        let said = |plan: Plan, medium| plan.check(medium).unwrap_err().to_string();
        assert!(said(plan(&[half, half, half]), Medium::Stream).contains("more than 1"));
        assert!(said(plan(&[(Fault::Reorder, "0")]), Medium::Stream).contains("--udp only"));
        assert!(said(plan(&[(Fault::Reset, "0")]), Medium::Datagrams).contains("no connection"));
        assert!(said(plan(&[(Fault::Drop, "0.1:3")]), Medium::Stream).contains("no parameter"));
    }
}
