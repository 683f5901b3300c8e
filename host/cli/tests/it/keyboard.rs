//! Words that are typed at a server.

use std::fs::File;
use std::process::Stdio;

use crate::process::{Folder, Running};
use crate::signals::serve_typed;

/// Starts a server whose input has this text before its first tick.
fn serve(folder: &Folder, typed: &str) -> Running {
    folder.write("typed", typed);
    let input = Stdio::from(File::open(folder.path("typed")).unwrap());
    serve_typed(folder, ["60", "5"], &["--epoch-file", "epoch"], input).0
}

/// Found by a user: the re-arm came before the first tick and was lost, and every later one with
/// it.
#[test]
fn a_rearm_that_is_piped_in_counts_from_the_first_tick_on() {
    let folder = Folder::new("rearm");
    let mut first = serve(&folder, "stop\n");
    first.await_words("-> Fault");
    first.stop().success();
    let mut second = serve(&folder, "rearm\n");
    second.await_words("it starts in Fault");
    second.await_words("Fault -> Listening");
    second.stop().success();
}
