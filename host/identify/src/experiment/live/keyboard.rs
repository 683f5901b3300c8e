//! Lines that the operator of a campaign types.

use std::io::BufRead;
use std::sync::mpsc::SyncSender;

use gantry_tau_system::lines::{Line, read_line};

/// Longest line that is read, bytes: readings of every gauge are shorter.
const MAX_LINE_LEN: usize = 4_096;

/// Sends each line, until the input ends or the campaign does. One that is too long costs a
/// sentence in the log.
pub fn listen(mut input: impl BufRead, lines: &SyncSender<String>) {
    let mut line = Vec::new();
    loop {
        match read_line(&mut input, &mut line, MAX_LINE_LEN) {
            Ok(Line::Complete) => {
                if lines
                    .send(String::from_utf8_lossy(&line).trim().to_owned())
                    .is_err()
                {
                    return;
                }
            }
            Ok(Line::TooLong) => {
                tracing::warn!("a line of more than {MAX_LINE_LEN} bytes is not read")
            }
            Ok(Line::End) => return,
            Err(error) => {
                return tracing::warn!("lines can no longer be typed ({error}); Ctrl-C leaves");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::sync_channel;

    use super::*;

    #[test]
    fn the_end_of_a_line_that_is_too_long_is_no_command() {
        let (lines, typed) = sync_channel(8);
        let input = [&b"again\r\n"[..], &[b'x'; MAX_LINE_LEN], b"quit\n\n 7.5 \n"].concat();
        listen(input.as_slice(), &lines);
        drop(lines);
        assert_eq!(typed.iter().collect::<Vec<_>>(), ["again", "", "7.5"]);
    }
}
