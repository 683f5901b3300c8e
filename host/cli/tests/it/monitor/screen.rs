//! The screen of `monitor` on terminals of two sizes.

use std::fs::File;
use std::io::Read;

use std::time::{Duration, Instant};

use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_test_support::labcomm_port::{Double, Scene};
use rustix::termios::{Winsize, tcsetwinsize};

use crate::outputs_fail::terminal;
use crate::process::{BINARY, Folder, Streams, command};

const PATIENCE: Duration = Duration::from_secs(60);
/// Begin and end of a frame: no line is continued on the next.
const BEGIN: &str = "\x1b[H\x1b[?7l";
const END: &str = "\x1b[?7h";

/// Lines of the first frame with these words that a terminal of a size is sent.
fn frame(columns: u16, rows: u16, words: &str) -> Vec<String> {
    let folder = Folder::new("monitor_terminal");
    let double = Double::of(Scene {
        offset_nm: -189_000,
        ..Scene::of(Phase::Obtain, Cause::Goodbye)
    });
    let (user, program) = terminal();
    let size = Winsize {
        ws_row: rows,
        ws_col: columns,
        ws_xpixel: 0,
        ws_ypixel: 0,
    };
    tcsetwinsize(&program, size).unwrap();
    let _monitor = folder.start_by(
        &mut command(BINARY),
        "monitor",
        &["monitor", &double.address.to_string()],
        Streams {
            output: Some(program.into()),
            ..Streams::default()
        },
    );
    let mut screen = File::from(user);
    let mut bytes = Vec::new();
    let began = Instant::now();
    loop {
        let mut chunk = [0; 4_096];
        let count = screen.read(&mut chunk).unwrap();
        bytes.extend_from_slice(&chunk[..count]);
        let text = String::from_utf8_lossy(&bytes);
        let whole = text
            .split(BEGIN)
            .skip(1)
            .filter_map(|frame| frame.split_once(END));
        for (frame, _) in whole {
            if frame.contains(words) {
                let lines = frame.replace("\x1b[K", "").replace("\x1b[J", "");
                // The terminal adds another carriage return.
                let lines = lines.replace('\r', "");
                return lines.trim_end().lines().map(str::to_owned).collect();
            }
        }
        assert!(began.elapsed() < PATIENCE, "{text}");
    }
}

/// Found from outside: at 80 columns every line of the axes was broken, and the screen scrolled.
#[test]
fn the_screen_fits_a_small_terminal_and_uses_a_large_one() {
    for (columns, rows, axis) in [
        (
            80,
            24,
            "2   -696.400 000   -378.000          -  -696.778 004      0.0    -0.003     -1.2",
        ),
        (
            132,
            43,
            "2       -696.400 000     -378.000            -     -696.778 004      0.0     -0.003      -1.2  position limited",
        ),
    ] {
        // The lag is known from the second tick on.
        let lines = frame(columns, rows, "      0.0 ");
        let text = lines.join("\n");
        assert!(lines.len() <= usize::from(rows), "{text}");
        for line in &lines {
            assert!(line.chars().count() <= usize::from(columns), "{line}");
            assert!(!line.contains('\x1b'), "{line:?}");
        }
        assert!(lines.iter().any(|line| line == axis), "{text}");
        for words in [
            "connected to",
            "obtain          epoch 7",
            "strangers 8",
            "position limited",
            "drives operating, ready, quick stop",
            "force   300.2    -0.5   -18.0 N     0.05  -0.10   0.02 N m",
            "gauges   190.0    36.0    24.0 µm",
            "session granted (epoch 7)",
        ] {
            assert!(text.contains(words), "{words}\n{text}");
        }
    }
}
