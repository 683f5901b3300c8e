//! Commands of the operator of a server.

use std::io::BufRead;
use std::sync::atomic::Ordering;

use gantry_tau_system::lines::{Line, read_line};

use super::Controls;

/// Longest line that is read, in bytes.
const MAX_COMMAND: usize = 256;

/// Reads `stop`, `rearm` and `quit` until the input ends, which is not a quit. Any other line costs
/// one sentence in the log.
pub fn listen(mut input: impl BufRead, controls: &Controls) {
    let mut line = Vec::new();
    loop {
        match read_line(&mut input, &mut line, MAX_COMMAND) {
            Ok(Line::Complete) => act_on(String::from_utf8_lossy(&line).trim(), controls),
            Ok(Line::TooLong) => tracing::warn!(
                "a command of more than {MAX_COMMAND} bytes: expected stop, rearm or quit"
            ),
            Ok(Line::End) => return,
            Err(error) => {
                return tracing::warn!(
                    "commands can no longer be typed ({error}); Ctrl-C ramps to zero and ends"
                );
            }
        }
    }
}

fn act_on(command: &str, controls: &Controls) {
    match command {
        "stop" => controls.press_stop(),
        "rearm" => controls.release_and_rearm(),
        "quit" => controls.quit.store(true, Ordering::Relaxed),
        "" => {}
        other => tracing::warn!("unknown command {other:?}: expected stop, rearm or quit"),
    }
}

#[cfg(test)]
mod tests {
    use gantry_tau_core::control::message::Phase;

    use super::*;

    /// Found by reading: bytes that are not a text ended the keyboard, and a later stop was not heard.
    #[test]
    fn a_stop_is_heard_after_anything() {
        let input = [&b"\xff\xfe\n\nStop\n"[..], &[b'x'; 10_000], b"\n stop \r\n"].concat();
        let controls = Controls::default();
        listen(input.as_slice(), &controls);
        assert!(controls.take_stop() && controls.take_stop(), "held");
        listen(&b"rearm\nquit"[..], &controls);
        assert!(!controls.take_stop() && controls.quit.load(Ordering::Relaxed));
        assert!(!controls.take_rearm(Phase::Fault) && controls.take_rearm(Phase::Fault));
    }
}
