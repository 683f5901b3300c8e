//! `host/systemd`: the unit is valid and hardened, and the server does its work under the
//! restrictions that it names.
//!
//! Where systemd is not the first process, its restrictions are imitated: another user, a read-only
//! file system with one folder to write in, limits of resources, no capabilities, and the unit's
//! system calls, which are compared with those that the server makes. A trial whose tool is missing
//! is reported as ignored, with its name; with `GANTRY_TAU_REQUIRE_SERVICE=1` it fails instead.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

mod sandbox;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use libtest_mimic::{Failed, Trial};

use crate::capi::tools::run;
use crate::firmware::program;
use crate::needing;
use sandbox::{DISK, Sandbox};

/// Most exposure that `systemd-analyze security` may find, in tenths: 0 is none, 100 all. What is
/// left is the network, which the server is for, and real-time scheduling.
const MAX_EXPOSURE: u32 = 14;
/// The same with the drop-in for EtherCAT: one capability and two families of addresses more.
const MAX_EXPOSURE_ON_A_BUS: u32 = 20;

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    let analyze = missing("systemd-analyze", &["--version"]);
    let sandbox = missing("setpriv", &["--version"])
        .or_else(|| missing("prlimit", &["--version"]))
        .or_else(|| {
            (!succeeds(Command::new("unshare").args(["-m", "true"])))
                .then(|| "mount namespaces not permitted".to_owned())
        });
    let limited = sandbox.clone().or_else(|| {
        let raised = succeeds(
            Command::new("prlimit")
                .args(sandbox::limits(&unit()))
                .arg("true"),
        );
        (!raised)
            .then(|| "CAP_SYS_RESOURCE missing: the limits of the unit cannot be set".to_owned())
    });
    let traced = sandbox
        .clone()
        .or_else(|| analyze.clone())
        .or_else(|| missing("strace", &["--version"]));
    let namespace = (!succeeds(Command::new("unshare").args(["-r", "true"])))
        .then(|| "user namespaces not permitted".to_owned())
        .or_else(|| missing("prlimit", &["--version"]));
    let freezing = sandbox
        .clone()
        .or_else(|| missing("mkfs.ext4", &["-V"]))
        .or_else(|| {
            let script =
                Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tools/service/freezes.sh");
            (!succeeds(&mut Command::new(script)))
                .then(|| "freezing of a loop device not permitted".to_owned())
        });
    vec![
        trial(
            "a_disk_that_hangs_holds_up_no_ramp_and_loses_no_stop",
            freezing,
            hangs,
        ),
        trial("the_unit_is_valid", analyze.clone(), is_valid),
        trial("the_unit_is_hardened", analyze, is_hardened),
        trial(
            "a_disk_that_fills_up_ends_the_recording_alone",
            sandbox.clone(),
            fills_a_disk,
        ),
        trial(
            "the_server_keeps_its_stop_under_the_units_restrictions",
            sandbox,
            keeps_its_stop,
        ),
        trial(
            "the_server_has_real_time_by_the_units_limits",
            limited,
            has_real_time,
        ),
        trial(
            "the_server_makes_no_other_system_calls_than_the_unit_allows",
            traced,
            makes_allowed_calls,
        ),
        trial(
            "uid_0_of_a_namespace_is_not_the_superuser",
            namespace,
            is_limited_in_a_namespace,
        ),
    ]
}

fn trial(name: &str, missing: Option<String>, body: fn() -> Result<(), Failed>) -> Trial {
    needing::trial(
        format!("service::{name}"),
        missing,
        "GANTRY_TAU_REQUIRE_SERVICE",
        body,
    )
}

fn succeeds(command: &mut Command) -> bool {
    command
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// Says that a tool is missing.
fn missing(tool: &str, arguments: &[&str]) -> Option<String> {
    (!succeeds(Command::new(tool).args(arguments))).then(|| format!("{tool} missing"))
}

/// `host/systemd`.
fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../host/systemd")
}

/// `gantry-tau`, built once.
fn gantry_tau() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(program::build)
}

/// Text of the unit.
fn unit() -> String {
    fs::read_to_string(folder().join("gantry-tau.service")).unwrap()
}

/// Values of a key of the unit.
fn values(unit: &str, key: &str) -> Vec<String> {
    unit.lines()
        .filter_map(|line| line.strip_prefix(key)?.strip_prefix('=').map(str::to_owned))
        .collect()
}

/// A folder with the units, whose program exists; `dropped_in` with the drop-in for EtherCAT.
fn installed(name: &str, dropped_in: bool) -> PathBuf {
    let place = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&place);
    let drop_ins = place.join("gantry-tau.service.d");
    fs::create_dir_all(&drop_ins).unwrap();
    let program = gantry_tau().display().to_string();
    fs::write(
        place.join("gantry-tau.service"),
        unit().replace("/usr/local/bin/gantry-tau", &program),
    )
    .unwrap();
    fs::copy(
        folder().join("gantry-tau.socket"),
        place.join("gantry-tau.socket"),
    )
    .unwrap();
    if dropped_in {
        fs::copy(
            folder().join("ethercat.conf"),
            drop_ins.join("ethercat.conf"),
        )
        .unwrap();
    }
    place
}

/// `systemd-analyze` on the units of a folder, and on those only.
fn analyze(place: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new("systemd-analyze");
    command.args(arguments).current_dir(place);
    // Ends with an empty entry: the system's units, which these name, are found as well.
    command.env("SYSTEMD_UNIT_PATH", format!("{}:", place.display()));
    command
}

/// Nothing in the units is unknown, misspelt or of another section.
fn is_valid() -> Result<(), Failed> {
    for dropped_in in [false, true] {
        let place = installed("units-verified", dropped_in);
        let output = analyze(
            &place,
            &[
                "verify",
                "--man=no",
                "./gantry-tau.service",
                "./gantry-tau.socket",
            ],
        )
        .output()?;
        let said = String::from_utf8_lossy(&output.stderr);
        let ours: Vec<&str> = said
            .lines()
            .filter(|line| line.contains("gantry-tau"))
            .collect();
        assert_eq!(ours, Vec::<&str>::new(), "{said}");
        assert!(output.status.success(), "{said}");
    }
    Ok(())
}

fn is_hardened() -> Result<(), Failed> {
    for (dropped_in, threshold) in [(false, MAX_EXPOSURE), (true, MAX_EXPOSURE_ON_A_BUS)] {
        let place = installed("units-judged", dropped_in);
        let threshold = format!("--threshold={threshold}");
        run(&mut analyze(
            &place,
            &[
                "security",
                "--no-pager",
                "--offline=true",
                &threshold,
                "./gantry-tau.service",
            ],
        ))?;
    }
    Ok(())
}

/// A stop outlives the service: listen, obtain, stop, end by SIGTERM, start, and it starts in
/// Fault; nothing else can be written.
fn keeps_its_stop() -> Result<(), Failed> {
    let sandbox = Sandbox::new("service-stop", Vec::new());
    let mut server = sandbox.start("first", "lockstep", &[]);
    server.await_words("listening on ");
    let client = server.client();
    server.await_words("Submit -> Obtain");
    server.say("stop\n");
    server.await_words("-> Fault");
    let code = server.terminate();
    assert_eq!(code, Some(0), "{}", server.log());
    drop(client);
    let mut again = sandbox.start("again", "lockstep", &[]);
    again.await_words("starts in Fault");
    again.await_words("Listening -> Fault");
    again.say("rearm\n");
    again.await_words("Fault -> Listening");
    assert_eq!(again.terminate(), Some(0), "{}", again.log());
    let mut third = sandbox.start("third", "lockstep", &["--record", "/usr/serve.csv"]);
    assert_ne!(
        third.end(),
        Some(0),
        "the rest is read-only: {}",
        third.log()
    );
    assert!(third.log().contains("/usr/serve.csv"), "{}", third.log());
    Ok(())
}

/// Words of a recording that ends while its disk of 16 MiB has 2 % left, and of one that fails on
/// a full disk.
const DISK_IS_NEARLY_FULL: &str = "and 335544 stay free; it ends here";
const DISK_IS_FULL: &str = "No space left on device";

/// A disk of 16 MiB under a recording: it ends while 2 % are left, or, where another program takes
/// all of them at once, when the disk is full. The session goes on, to its whole ramp.
fn fills_a_disk() -> Result<(), Failed> {
    let log = records_onto_a_small_disk(false)?;
    assert!(log.contains(DISK_IS_NEARLY_FULL), "{log}");
    // A look at the free space can come before the first write that fails.
    for _ in 0..20 {
        if records_onto_a_small_disk(true)?.contains(DISK_IS_FULL) {
            return Ok(());
        }
    }
    Err("20 recordings ended before a write failed".into())
}

/// Fills a disk of 16 MiB by a recording, and by another program if `is_taken_by_others`. Returns
/// what the server printed.
fn records_onto_a_small_disk(is_taken_by_others: bool) -> Result<String, Failed> {
    let sandbox = Sandbox::new("service-disk", Vec::new());
    let recording = format!("{DISK}/run.csv");
    let mut server = sandbox.start("server", "lockstep", &["--record", &recording]);
    server.await_words("listening on ");
    let client = server.client();
    server.await_words("Submit -> Obtain");
    if is_taken_by_others {
        let filler =
            fs::write(server.file(&format!("{DISK}/filler")), vec![0; 32 << 20]).unwrap_err();
        assert_eq!(filler.kind(), std::io::ErrorKind::StorageFull);
    }
    server.await_any(&[DISK_IS_NEARLY_FULL, DISK_IS_FULL]);
    let kept = fs::read(server.file(&recording))?;
    assert!(
        is_taken_by_others || kept.len() > 15 << 20,
        "{} bytes",
        kept.len()
    );
    assert!(kept.ends_with(b"\n"), "it ends with a whole row");
    // Offsets grow and shrink as before.
    server.say("stop\n");
    server.await_words("Obtain -> Fault");
    let code = server.terminate();
    let log = server.log();
    assert_eq!(code, Some(1), "{log}");
    assert!(
        log.contains("all offsets are zero; ended") && log.contains(" rows to "),
        "{log}"
    );
    drop(client);
    Ok(log)
}

/// A disk that has everything, and on which every write hangs from some moment in Obtain on: the
/// ramp is done, and the stop is in the latch when the disk goes on, unless the server was ended
/// before and said that it is not.
fn hangs() -> Result<(), Failed> {
    for ends_frozen in [false, true] {
        let sandbox = Sandbox::with_disk("service-frozen");
        let state = [
            "--epoch-file".to_owned(),
            format!("{DISK}/epoch"),
            "--record".to_owned(),
            format!("{DISK}/run.csv"),
        ];
        let options: Vec<String> = state
            .into_iter()
            .chain(["--black-box".to_owned(), format!("{DISK}/boxes")])
            .collect();
        let options: Vec<&str> = options.iter().map(String::as_str).collect();
        let mut server = sandbox.start("server", "lockstep", &options);
        server.await_words("listening on ");
        let client = server.client();
        server.await_words("Submit -> Obtain");
        let frozen = server.freeze();
        server.say("stop\n");
        server.await_words("Obtain -> Fault");
        server.await_words("the stop latch cannot be written: do not restart");
        if ends_frozen {
            server.tell_to_end();
            server.await_words("all offsets are zero; the stop latch cannot be written");
            server.await_words("run-2.csv: its disk or reader takes nothing");
            drop(frozen);
            assert_eq!(server.end(), Some(4), "{}", server.log());
            assert!(
                server
                    .log()
                    .contains("the next start would not know of a stop"),
                "{}",
                server.log()
            );
        } else {
            drop(frozen);
            server.await_words("the stop latch is written again");
            assert_eq!(server.terminate(), Some(0), "{}", server.log());
            assert!(server.log().contains(" rows to "), "{}", server.log());
            let mut again = sandbox.start(
                "again",
                "lockstep",
                &["--epoch-file", &format!("{DISK}/epoch")],
            );
            again.await_words("starts in Fault");
            assert_eq!(again.terminate(), Some(0), "{}", again.log());
        }
        drop(client);
    }
    Ok(())
}

/// The limits of the unit are enough for both privileges of real time, without a capability.
fn has_real_time() -> Result<(), Failed> {
    let sandbox = Sandbox::new("service-limits", sandbox::limits(&unit()));
    let mut server = sandbox.start("server", "real", &[]);
    server.await_words("listening on ");
    assert_eq!(server.terminate(), Some(0), "{}", server.log());
    // The log is written beside the server: only now it is whole.
    let log = server.log();
    for missing in ["no real-time priority", "no locked memory"] {
        assert!(!log.contains(missing), "{log}");
    }
    Ok(())
}

/// Calls of a server in real time, and of a whole session in lock-step.
fn makes_allowed_calls() -> Result<(), Failed> {
    let unit = unit();
    let sandbox = Sandbox::new("service-calls", Vec::new());
    let mut server = sandbox.start_traced("real", "real");
    server.await_words("listening on ");
    assert_eq!(server.terminate(), Some(0), "{}", server.log());
    let mut made = sandbox.calls();
    let mut server = sandbox.start_traced("session", "lockstep");
    server.await_words("listening on ");
    let client = server.client();
    server.await_words("Submit -> Obtain");
    assert_eq!(server.terminate(), Some(0), "{}", server.log());
    drop(client);
    let allowed = allowed_calls(&values(&unit, "SystemCallFilter"))?;
    made.extend(sandbox.calls());
    assert!(made.contains("sched_setscheduler"), "{made:?}");
    let refused: Vec<&String> = made.difference(&allowed).collect();
    assert!(refused.is_empty(), "{refused:?}");
    Ok(())
}

/// The calls that filters allow, as `systemd-analyze syscall-filter` has its sets.
fn allowed_calls(filters: &[String]) -> Result<BTreeSet<String>, Failed> {
    // Always allowed, by any filter.
    let mut allowed = calls_of("@default")?;
    for filter in filters {
        let (is_removed, names) = filter
            .strip_prefix('~')
            .map_or((false, filter.as_str()), |names| (true, names));
        for name in names.split_whitespace() {
            for call in calls_of(name)? {
                if is_removed {
                    allowed.remove(&call);
                } else {
                    allowed.insert(call);
                }
            }
        }
    }
    allowed.extend(calls_of("@default")?);
    Ok(allowed)
}

/// The calls of a set and of those that it names, or a call.
fn calls_of(name: &str) -> Result<BTreeSet<String>, Failed> {
    if !name.starts_with('@') {
        return Ok(BTreeSet::from([name.to_owned()]));
    }
    let listed = run(Command::new("systemd-analyze").args(["--no-pager", "syscall-filter", name]))?;
    let mut calls = BTreeSet::new();
    // The first line is the set's own name.
    for line in listed
        .lines()
        .skip(1)
        .map(str::trim)
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
    {
        calls.extend(calls_of(line)?);
    }
    Ok(calls)
}

/// The superuser of a user namespace may not lift a limit: the memory is not locked, which the log
/// says, and the server runs.
fn is_limited_in_a_namespace() -> Result<(), Failed> {
    let sandbox = Sandbox::new("service-namespace", Vec::new());
    let mut server = sandbox.start_as_root_of_a_namespace("server");
    // The log is written beside the server.
    server.await_words("no locked memory (mlockall): it is limited to 8192 KiB");
    server.await_words("listening on ");
    assert_eq!(server.terminate(), Some(0), "{}", server.log());
    Ok(())
}
