//! Commands of the operator while a client runs, as of OpCom `[T 4.2.4]`.

use std::io::BufRead;
use std::str::FromStr;
use std::sync::PoisonError;
use std::sync::atomic::Ordering;

use gantry_tau_system::lines::{Line, read_line};

use super::ClientControls;

/// Longest line that is read, in bytes.
const MAX_COMMAND: usize = 256;

/// Command of the operator.
#[derive(Clone, Copy, Debug, PartialEq)]
enum OperatorCommand {
    Submit,
    Obtain,
    Gain(f64),
    Status,
    Quit,
}

/// Reads commands until the input ends, which is not a quit. `status` prints the status.
///
/// A line that is not a command costs one sentence in the log.
pub fn listen(mut input: impl BufRead, controls: &ClientControls, mut status: impl FnMut()) {
    let mut line = Vec::new();
    loop {
        let command = match read_line(&mut input, &mut line, MAX_COMMAND) {
            Ok(Line::Complete) => String::from_utf8_lossy(&line).trim().to_owned(),
            Ok(Line::TooLong) => format!("(more than {MAX_COMMAND} bytes)"),
            Ok(Line::End) | Err(_) => return,
        };
        if command.is_empty() {
            continue;
        }
        match command.parse() {
            Ok(OperatorCommand::Submit) => controls.obtain.store(false, Ordering::Relaxed),
            Ok(OperatorCommand::Obtain) => {
                controls.obtain.store(true, Ordering::Relaxed);
                if !controls.tared.load(Ordering::Relaxed) {
                    tracing::info!("obtaining as soon as the force sensor is tared");
                }
            }
            Ok(OperatorCommand::Gain(gain)) => {
                *controls.gain.lock().unwrap_or_else(PoisonError::into_inner) = Some(gain);
            }
            Ok(OperatorCommand::Status) => status(),
            Ok(OperatorCommand::Quit) => controls.quit.store(true, Ordering::Relaxed),
            Err(reason) => tracing::warn!("{reason}"),
        }
    }
}

/// A line that is not a command.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
enum CommandError {
    /// The share of the correction is out of range, or is not a number.
    #[error("gain {0:?} is not a number from 0 to 1")]
    Gain(String),
    /// The words are not those of a command.
    #[error("unknown command {0:?}: expected submit, obtain, gain X (0 to 1), status or quit")]
    Unknown(String),
}

impl FromStr for OperatorCommand {
    type Err = CommandError;

    fn from_str(line: &str) -> Result<Self, CommandError> {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["submit"] => Ok(Self::Submit),
            ["obtain"] => Ok(Self::Obtain),
            ["status"] => Ok(Self::Status),
            ["quit"] => Ok(Self::Quit),
            ["gain", number] => match number.parse() {
                Ok(gain) if (0.0..=1.0).contains(&gain) => Ok(Self::Gain(gain)),
                _ => Err(CommandError::Gain((*number).to_owned())),
            },
            _ => Err(CommandError::Unknown(line.to_owned())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_commands_and_anything_else_is_one_sentence() {
        for (line, command) in [
            ("submit", OperatorCommand::Submit),
            ("obtain", OperatorCommand::Obtain),
            ("gain  0.25", OperatorCommand::Gain(0.25)),
            ("gain 0", OperatorCommand::Gain(0.0)),
            ("gain 1", OperatorCommand::Gain(1.0)),
            ("status", OperatorCommand::Status),
            ("quit", OperatorCommand::Quit),
        ] {
            assert_eq!(line.parse(), Ok(command));
        }
        for line in ["gain NaN", "gain inf", "gain -0.1", "gain 1.01", "gain x"] {
            let reason = line.parse::<OperatorCommand>().unwrap_err().to_string();
            assert!(reason.ends_with("is not a number from 0 to 1"), "{reason}");
        }
        for line in ["gain", "gain 1 2", "Obtain", "obtain now", "stop"] {
            let reason = line.parse::<OperatorCommand>().unwrap_err().to_string();
            assert!(
                reason.contains("expected submit, obtain, gain X (0 to 1), status or quit"),
                "{reason}"
            );
        }
    }

    /// Bytes that are not a text, and a line without an end, are passed over; the end of the input is
    /// no quit.
    #[test]
    fn the_operator_is_heard_after_anything() {
        let input = [
            &b"\xff\xfe\n\ngain 0.5\n"[..],
            &[b'x'; 10_000],
            b"\nobtain\nstatus\n status \r\ngain 2",
        ]
        .concat();
        let controls = ClientControls::default();
        let mut shown = 0;
        listen(input.as_slice(), &controls, || shown += 1);
        assert_eq!((shown, *controls.gain.lock().unwrap()), (2, Some(0.5)));
        assert!(controls.obtain.load(Ordering::Relaxed) && !controls.quit.load(Ordering::Relaxed));
        listen(&b"submit\nquit"[..], &controls, || ());
        assert!(!controls.obtain.load(Ordering::Relaxed) && controls.quit.load(Ordering::Relaxed));
    }
}
