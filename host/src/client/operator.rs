//! Commands of the operator while a client runs, as of OpCom `[T 4.2.4]`.

use std::io::BufRead;
use std::str::FromStr;
use std::sync::PoisonError;
use std::sync::atomic::Ordering;

use super::ClientControls;
use crate::lines::{Line, read_line};

/// Longest line that is read, in bytes.
const LONGEST: usize = 256;

/// Command of the operator.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Command {
    Submit,
    Obtain,
    Gain(f64),
    Status,
    Quit,
}

/// Reads commands until the input ends, which is no quit. `status` prints the status.
///
/// A line that is no command costs one sentence in the log.
pub fn listen(mut input: impl BufRead, controls: &ClientControls, mut status: impl FnMut()) {
    let mut line = Vec::new();
    loop {
        let command = match read_line(&mut input, &mut line, LONGEST) {
            Ok(Line::Complete) => String::from_utf8_lossy(&line).trim().to_owned(),
            Ok(Line::TooLong) => format!("(more than {LONGEST} bytes)"),
            Ok(Line::End) | Err(_) => return,
        };
        if command.is_empty() {
            continue;
        }
        match command.parse() {
            Ok(Command::Submit) => controls.obtain.store(false, Ordering::Relaxed),
            Ok(Command::Obtain) => {
                controls.obtain.store(true, Ordering::Relaxed);
                if !controls.tared.load(Ordering::Relaxed) {
                    tracing::info!("obtaining as soon as the force sensor is tared");
                }
            }
            Ok(Command::Gain(gain)) => {
                *controls.gain.lock().unwrap_or_else(PoisonError::into_inner) = Some(gain);
            }
            Ok(Command::Status) => status(),
            Ok(Command::Quit) => controls.quit.store(true, Ordering::Relaxed),
            Err(reason) => tracing::warn!("{reason}"),
        }
    }
}

impl FromStr for Command {
    type Err = String;

    fn from_str(line: &str) -> Result<Self, String> {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["submit"] => Ok(Self::Submit),
            ["obtain"] => Ok(Self::Obtain),
            ["status"] => Ok(Self::Status),
            ["quit"] => Ok(Self::Quit),
            ["gain", number] => match number.parse() {
                Ok(gain) if (0.0..=1.0).contains(&gain) => Ok(Self::Gain(gain)),
                _ => Err(format!("gain {number:?} is not a number from 0 to 1")),
            },
            _ => Err(format!("unknown command {line:?}: expected submit, obtain, gain X (0 to 1), status or quit")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_commands_and_anything_else_is_one_sentence() {
        for (line, command) in [
            ("submit", Command::Submit),
            ("obtain", Command::Obtain),
            ("gain  0.25", Command::Gain(0.25)),
            ("gain 0", Command::Gain(0.0)),
            ("gain 1", Command::Gain(1.0)),
            ("status", Command::Status),
            ("quit", Command::Quit),
        ] {
            assert_eq!(line.parse(), Ok(command));
        }
        for line in ["gain NaN", "gain inf", "gain -0.1", "gain 1.01", "gain x"] {
            let reason = line.parse::<Command>().unwrap_err();
            assert!(reason.ends_with("is not a number from 0 to 1"), "{reason}");
        }
        for line in ["gain", "gain 1 2", "Obtain", "obtain now", "stop"] {
            let reason = line.parse::<Command>().unwrap_err();
            assert!(reason.contains("expected submit, obtain, gain X (0 to 1), status or quit"), "{reason}");
        }
    }

    /// Bytes that are no text, and a line without an end, are passed over; the end of the input is no quit.
    #[test]
    fn the_operator_is_heard_after_anything() {
        let input = [&b"\xff\xfe\n\ngain 0.5\n"[..], &[b'x'; 10_000], b"\nobtain\nstatus\n status \r\ngain 2"].concat();
        let controls = ClientControls::default();
        let mut shown = 0;
        listen(input.as_slice(), &controls, || shown += 1);
        assert_eq!((shown, *controls.gain.lock().unwrap()), (2, Some(0.5)));
        assert!(controls.obtain.load(Ordering::Relaxed) && !controls.quit.load(Ordering::Relaxed));
        listen(&b"submit\nquit"[..], &controls, || ());
        assert!(!controls.obtain.load(Ordering::Relaxed) && controls.quit.load(Ordering::Relaxed));
    }
}
