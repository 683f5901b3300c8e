//! Privileges of a running server. As the superuser, where these tests say most, and as any other
//! user.

use std::path::PathBuf;

use crate::process::{Folder, Running};

/// `CAP_DAC_OVERRIDE` as a set.
const DAC_OVERRIDE: u64 = 1 << 1;

/// Starts a server in real time, which asks for real-time priority.
fn serve(folder: &Folder, further: &[&str]) -> Running {
    let mut arguments = vec!["serve", "--listen", "127.0.0.1:0"];
    arguments.extend(further);
    let mut server = folder.start("serve", &arguments);
    server.await_words("Ctrl-C");
    server
}

/// Name of each thread of a process, with its entry of /proc.
fn threads(server: &Running) -> Vec<(String, PathBuf)> {
    let tasks = std::fs::read_dir(format!("/proc/{}/task", server.id())).unwrap();
    // One that has ended meanwhile has no name any more.
    let named = tasks.filter_map(|task| {
        let place = task.unwrap().path();
        let name = std::fs::read_to_string(place.join("comm")).ok()?;
        Some((name.trim().to_owned(), place))
    });
    named.collect()
}

/// A set of capabilities of a thread, by its name in `status`; `None` of a thread that has ended.
fn set(thread: &std::path::Path, name: &str) -> Option<u64> {
    let status = std::fs::read_to_string(thread.join("status")).ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))
        .unwrap();
    Some(u64::from_str_radix(line.trim(), 16).unwrap())
}

/// The scheduling policy of a thread: 1 is SCHED_FIFO.
fn policy(thread: &std::path::Path) -> u32 {
    let stat = std::fs::read_to_string(thread.join("stat")).unwrap();
    // The name, in parentheses, is the second field, the state the third.
    let after_name = stat.rsplit_once(") ").unwrap().1;
    after_name.split(' ').nth(41 - 3).unwrap().parse().unwrap()
}

#[test]
fn a_server_that_listens_has_no_privileges() {
    let folder = Folder::new("privileges");
    let server = serve(&folder, &["--record", "serve.csv", "--black-box", "boxes"]);
    let threads = threads(&server);
    for (name, thread) in &threads {
        for sets in ["CapEff", "CapPrm", "CapInh", "CapAmb"] {
            assert!(
                set(thread, sets).is_none_or(|set| set == 0),
                "{sets} of {name}"
            );
        }
        assert!(
            set(thread, "NoNewPrivs").is_none_or(|set| set == 1),
            "{name}"
        );
    }
    // Its priority came first.
    let (_, cycle) = threads.iter().find(|(name, _)| name == "cycle").unwrap();
    let (_, writer) = threads
        .iter()
        .find(|(name, _)| name == "latch writer")
        .unwrap();
    assert_eq!(policy(writer), policy(cycle), "the cycle waits for it");
    let is_prior = policy(cycle) == 1;
    let ended = server.stop();
    assert!(
        is_prior || ended.stderr.contains("no real-time priority"),
        "{}",
        ended.stderr
    );
    assert!(
        !ended.stderr.contains("privileges cannot"),
        "{}",
        ended.stderr
    );
    ended.success();
}

/// The bus is open, and its lengths are published to a network.
#[test]
#[cfg(feature = "ethercat")]
fn gauges_that_are_published_have_no_privileges() {
    let folder = Folder::new("privileges-gauges");
    folder.write("gauges.toml", &crate::gauges::file(&["x"]));
    let options = ["--record", "run.csv"];
    let (mut gauges, _) = crate::gauges::start(&folder, "gauges", &options);
    gauges.await_that("a row", |_| folder.path("run.csv").exists());
    let threads = threads(&gauges);
    assert!(threads.iter().any(|(name, _)| name == "gauges table"));
    for (name, thread) in &threads {
        assert!(set(thread, "CapEff").is_none_or(|set| set == 0), "{name}");
        let no_new = set(thread, "NoNewPrivs");
        assert!(no_new.is_none_or(|set| set == 1), "{name}");
    }
    gauges.stop().success();
}

/// The superuser may write into a folder of another user, and so does the server: that one
/// capability is left, and the log says why.
#[test]
fn a_folder_of_another_user_costs_one_capability() {
    let folder = Folder::new("privileges-folder");
    std::fs::create_dir(folder.path("boxes")).unwrap();
    if std::os::unix::fs::chown(folder.path("boxes"), Some(61_234), Some(61_234)).is_err() {
        eprintln!("not the superuser: no folder of another user");
        return;
    }
    let server = serve(&folder, &["--black-box", "boxes"]);
    for (name, thread) in threads(&server) {
        // Threads that write to what is open, or to nothing, keep none.
        let left = match name.as_str() {
            "cycle" | "log" | "standard output" | "signals" | "stop latch" | "latch writer" => 0,
            _ => DAC_OVERRIDE,
        };
        let set = set(&thread, "CapEff");
        assert!(set.is_none_or(|set| set == left), "{name}: {set:?}");
    }
    let ended = server.stop();
    let kept = "CAP_DAC_OVERRIDE is kept, to write boxes, which belongs to another user";
    assert!(ended.stderr.contains(kept), "{}", ended.stderr);
    ended.success();
}
