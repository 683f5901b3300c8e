//! Progress bars, which are drawn as the log is written.

use std::io::{self, IsTerminal};
use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle, TermLike};

use super::{is_terminal, say, write_log};

/// Width of a bar with its counts. A terminal that is narrower wraps it.
const WIDTH: u16 = 80;

/// Progress bar on stderr, if that is a terminal.
#[derive(Debug)]
pub(crate) struct Progress(ProgressBar);

impl Progress {
    /// Creates a progress bar of `count` times `unit`.
    pub(crate) fn new(count: u64, unit: &str) -> Self {
        let target = match io::stderr().is_terminal() {
            true => ProgressDrawTarget::term_like(Box::<Terminal>::default()),
            false => ProgressDrawTarget::hidden(),
        };
        let bar = ProgressBar::with_draw_target(Some(count), target);
        Self(
            match ProgressStyle::with_template(&format!(
                "[{{elapsed}}] {{bar:40}} {{pos}}/{{len}} {unit}"
            )) {
                Ok(style) => bar.with_style(style),
                Err(_) => bar,
            },
        )
    }

    /// Counts one more.
    pub(crate) fn step(&self) {
        self.0.inc(1);
    }

    /// Prints a line on the standard output, above the bar where both are on one terminal.
    pub(crate) fn say(&self, line: &str) {
        if self.0.is_hidden() || !is_terminal() {
            say(line);
        } else {
            self.0.println(line);
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// Terminal behind the log's queue.
#[derive(Debug, Default)]
struct Terminal(Mutex<String>);

impl Terminal {
    fn add(&self, text: &str) -> io::Result<()> {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push_str(text);
        Ok(())
    }
}

impl TermLike for Terminal {
    fn width(&self) -> u16 {
        WIDTH
    }

    fn move_cursor_up(&self, lines: usize) -> io::Result<()> {
        if lines == 0 {
            Ok(())
        } else {
            self.add(&format!("\x1b[{lines}A"))
        }
    }

    fn move_cursor_down(&self, lines: usize) -> io::Result<()> {
        if lines == 0 {
            Ok(())
        } else {
            self.add(&format!("\x1b[{lines}B"))
        }
    }

    fn move_cursor_right(&self, columns: usize) -> io::Result<()> {
        if columns == 0 {
            Ok(())
        } else {
            self.add(&format!("\x1b[{columns}C"))
        }
    }

    fn move_cursor_left(&self, columns: usize) -> io::Result<()> {
        if columns == 0 {
            Ok(())
        } else {
            self.add(&format!("\x1b[{columns}D"))
        }
    }

    fn write_line(&self, line: &str) -> io::Result<()> {
        self.add(line)?;
        self.add("\n")
    }

    fn write_str(&self, text: &str) -> io::Result<()> {
        self.add(text)
    }

    fn clear_line(&self) -> io::Result<()> {
        self.add("\r\x1b[2K")
    }

    fn flush(&self) -> io::Result<()> {
        let drawn = std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner));
        write_log(drawn.into_bytes());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moves_of_the_cursor_are_escape_sequences_and_none_for_nothing() {
        type Move = fn(&Terminal, usize) -> io::Result<()>;
        let moves: [(Move, char); 4] = [
            (Terminal::move_cursor_up, 'A'),
            (Terminal::move_cursor_down, 'B'),
            (Terminal::move_cursor_right, 'C'),
            (Terminal::move_cursor_left, 'D'),
        ];
        for (step, letter) in moves {
            let terminal = Terminal::default();
            for count in [0, 1, 12] {
                step(&terminal, count).unwrap();
            }
            assert_eq!(
                *terminal.0.lock().unwrap(),
                format!("\x1b[1{letter}\x1b[12{letter}")
            );
        }
    }
}
