use gantry_tau_core::units::Epoch;

use super::*;

/// A folder of this test's own, gone with it.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn place(&self) -> StatePlace {
        StatePlace::named(&self.path("epoch"))
    }

    fn own(&self) -> Result<MachineState, StateError> {
        MachineState::own(&self.place(), "test")
    }

    fn begin(&self, first_run: FirstRun) -> Begun {
        self.own().unwrap().begin(first_run).unwrap()
    }

    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<_> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}

#[test]
fn no_epoch_is_given_twice_across_restarts() {
    let folder = Folder::new();
    let first = folder.begin(FirstRun::Harmless).epochs;
    assert_eq!(first.first, Epoch(1));
    // The first run is killed here; it has written nothing since. So was a run before, while it
    // wrote.
    std::fs::write(folder.path("epoch.new"), "17").unwrap();
    let second = folder.begin(FirstRun::Unexpected).epochs;
    assert_eq!(second.first.0, first.last.0 + 1);
    assert_eq!(folder.names(), ["epoch", "epoch.lock", "epoch.stop"]);
    std::fs::write(folder.path("epoch"), (u64::MAX - 9).to_string()).unwrap();
    let error = folder
        .own()
        .unwrap()
        .begin(FirstRun::Unexpected)
        .unwrap_err()
        .to_string();
    assert!(error.contains("used up"), "{error}");
}

#[test]
fn a_damaged_counter_is_refused_with_a_remedy_and_not_overwritten() {
    let folder = Folder::new();
    let long = "1".repeat(100_000);
    for content in [
        "",
        "seven\n",
        "-1",
        "18446744073709551616",
        "{\"version\": 2, \"epoch\": 7}\n",
        "1 2",
        &long,
    ] {
        std::fs::write(folder.path("epoch"), content).unwrap();
        let error = folder.own().unwrap_err().to_string();
        assert!(
            error.contains("does not contain a counter") && error.contains("move the file away"),
            "{error}"
        );
        assert_eq!(
            std::fs::read_to_string(folder.path("epoch")).unwrap(),
            content
        );
    }
    std::fs::write(folder.path("epoch"), " 41 \r\n").unwrap();
    assert_eq!(
        folder
            .own()
            .unwrap()
            .begin(FirstRun::Unexpected)
            .unwrap()
            .epochs
            .first,
        Epoch(42)
    );
}

/// `--epoch-file epoch` replaces its counter by `epoch.new`, which another machine's `--epoch-file`
/// may name.
#[test]
fn a_counter_of_another_machine_is_left_alone() {
    let folder = Folder::new();
    let other = StatePlace::named(&folder.path("epoch.new"));
    drop(
        MachineState::own(&other, "other")
            .unwrap()
            .begin(FirstRun::Harmless)
            .unwrap(),
    );
    let error = folder.own().unwrap_err().to_string();
    assert!(
        error.contains("epoch.new: is the counter of another machine"),
        "{error}"
    );
    assert_eq!(
        MachineState::own(&other, "other")
            .unwrap()
            .begin(FirstRun::Harmless)
            .unwrap()
            .epochs
            .first,
        Epoch((1 << 32) + 1)
    );
}

/// `--epoch-file Cargo` has its lock in `Cargo.lock`.
#[test]
fn another_file_that_has_a_name_of_ours_is_left_alone() {
    for (name, text, kind) in [
        ("epoch.lock", "version = 4\n", "lock"),
        ("epoch.stop", "released\nx", "stop latch"),
        (
            "epoch.stop",
            "stop latch of version 2: released\n",
            "stop latch",
        ),
        ("epoch.new", "2026-11-26: 7 mm\n", "counter"),
        ("epoch.new", " ", "counter"),
    ] {
        let folder = Folder::new();
        std::fs::write(folder.path(name), text).unwrap();
        let error = folder.own().unwrap_err().to_string();
        assert!(
            error.contains(&format!(
                "{name}: is another file, not a {kind} of gantry-tau"
            )),
            "{error}"
        );
        assert_eq!(std::fs::read_to_string(folder.path(name)).unwrap(), text);
    }
}

#[test]
fn a_stop_outlives_the_process_until_it_is_released() {
    let folder = Folder::new();
    let mut begun = folder.begin(FirstRun::Harmless);
    assert!(!begun.latch.is_latched());
    begun.latch.set(true);
    drop(begun);
    let mut begun = folder.begin(FirstRun::Harmless);
    assert_eq!(begun.condition, Condition::Stopped);
    assert!(begun.latch.is_latched());
    begun.latch.set(false);
    drop(begun);
    assert!(!folder.begin(FirstRun::Unexpected).latch.is_latched());
}

/// Found from outside: a stop that a disk took late was never flushed.
#[test]
fn a_change_is_flushed_when_it_comes_and_when_it_is_written_late() {
    let folder = Folder::new();
    let begun = folder.begin(FirstRun::Harmless);
    let mut flusher = LatchFlusher::of(&begun.latch).unwrap();
    let rows = [
        (false, false),
        (true, true),
        (true, true),
        (true, false),
        (true, false),
        (false, false),
    ];
    let flushed = rows.map(|(is_latched, is_lost)| flusher.see(is_latched, is_lost));
    assert_eq!(flushed, [false, true, false, true, false, true]);
    flusher.finish();
}

#[test]
fn a_latch_that_cannot_be_understood_is_latched_and_can_be_released() {
    let folder = Folder::new();
    for content in [
        &b"released"[..],
        b"stopped\n",
        b"\xff\xff\xff\xff\xff\xff\xff\xff\n",
        b"",
        b"latch v2\n",
    ] {
        drop(folder.begin(FirstRun::Harmless));
        std::fs::write(folder.path("epoch.stop"), content).unwrap();
        let mut begun = folder.begin(FirstRun::Harmless);
        assert!(begun.latch.is_latched(), "{content:?}");
        begun.latch.set(false);
        drop(begun);
        assert!(
            !folder.begin(FirstRun::Harmless).latch.is_latched(),
            "released, after {content:?}"
        );
    }
}

/// The machine moves only if nothing can have been lost.
#[test]
fn a_missing_part_of_the_state_is_a_stop_but_in_a_first_run() {
    let [epoch, latch] = [("epoch", "7\n"), ("epoch.stop", "released\n")];
    for (files, first_run, expected) in [
        (&[][..], FirstRun::Unexpected, Ok(true)),
        (&[], FirstRun::Harmless, Ok(false)),
        (&[], FirstRun::Declared, Ok(false)),
        (&[epoch], FirstRun::Unexpected, Ok(true)),
        (&[epoch], FirstRun::Harmless, Ok(true)),
        (&[epoch], FirstRun::Declared, Err("epoch is there")),
        (&[latch], FirstRun::Unexpected, Ok(true)),
        (&[latch], FirstRun::Harmless, Ok(true)),
        (&[latch], FirstRun::Declared, Err("epoch.stop is there")),
        (&[epoch, latch], FirstRun::Unexpected, Ok(false)),
        (&[epoch, latch], FirstRun::Harmless, Ok(false)),
        (&[epoch, latch], FirstRun::Declared, Err("epoch is there")),
    ] {
        let folder = Folder::new();
        files
            .iter()
            .for_each(|(name, text)| std::fs::write(folder.path(name), text).unwrap());
        match (folder.own().unwrap().begin(first_run), expected) {
            (Ok(begun), Ok(latched)) => {
                assert_eq!(
                    begun.condition.is_latched(),
                    latched,
                    "{files:?} {first_run:?}"
                );
                assert_eq!(begun.latch.is_latched(), latched);
                if latched {
                    let said = begun.condition.to_string();
                    assert!(
                        said.contains("Fault")
                            && said.contains("`rearm`")
                            && said.contains("epoch"),
                        "{said}"
                    );
                }
            }
            (Err(error), Err(words)) => assert!(error.to_string().contains(words), "{error}"),
            (begun, _) => panic!("{files:?} {first_run:?}: {begun:?}"),
        }
    }
}

#[test]
fn a_second_owner_is_refused_with_the_name_of_the_first() {
    let folder = Folder::new();
    let begun = MachineState::own(&folder.place(), "serve, l2 on 127.0.0.1:7000")
        .unwrap()
        .begin(FirstRun::Harmless)
        .unwrap();
    let before = std::fs::read(folder.path("epoch")).unwrap();
    let error = folder.own().unwrap_err().to_string();
    let owner = format!(
        "in use by pid {} (serve, l2 on 127.0.0.1:7000)",
        std::process::id()
    );
    assert!(
        error.contains(&owner) && error.contains("--name") && error.contains("--epoch-file"),
        "{error}"
    );
    assert_eq!(std::fs::read(folder.path("epoch")).unwrap(), before);
    // The text of the owner cannot do anything to a terminal.
    std::fs::write(
        folder.path("epoch.lock"),
        "pid 1\x1b[2J\u{9b}x\nsecond line",
    )
    .unwrap();
    let error = folder.own().unwrap_err().to_string();
    assert!(
        error.contains("in use by pid 1\\u{1b}[2J\\u{9b}x;") && !error.contains('\n'),
        "{error}"
    );
    drop(begun);
    assert!(folder.own().is_ok());
}

/// Found by attack: 2 GB were read, a start hung, the target of a link was overwritten.
#[cfg(unix)]
#[test]
fn what_is_not_a_regular_file_is_refused_and_left_as_it_is() {
    fn pipe(path: &Path) {
        assert!(
            std::process::Command::new("mkfifo")
                .arg(path)
                .status()
                .unwrap()
                .success()
        );
    }
    type Make = fn(&Path);
    let makes: [(&str, Make); 5] = [
        ("folder", |path| std::fs::create_dir(path).unwrap()),
        ("symbolic link", |path| {
            std::os::unix::fs::symlink(path.with_file_name("target"), path).unwrap()
        }),
        ("symbolic link", |path| {
            std::os::unix::fs::symlink("/dev/zero", path).unwrap()
        }),
        ("pipe", pipe),
        ("socket", |path| {
            drop(std::os::unix::net::UnixListener::bind(path).unwrap())
        }),
    ];
    for (kind, make) in makes {
        for file in ["epoch", "epoch.stop", "epoch.lock"] {
            let folder = Folder::new();
            std::fs::write(folder.path("target"), "12345\n").unwrap();
            make(&folder.path(file));
            let error = folder.own().unwrap_err().to_string();
            assert!(
                error.contains(kind)
                    && error.contains(&format!("{file}: is "))
                    && error.contains("; name "),
                "{file}: {error}"
            );
            assert_eq!(folder.own().unwrap_err().to_string(), error, "again");
            assert_eq!(
                std::fs::read_to_string(folder.path("target")).unwrap(),
                "12345\n"
            );
        }
    }
    let error = MachineState::own(&StatePlace::named(Path::new("/dev/zero")), "test")
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("/dev/zero") && error.contains("device"),
        "{error}"
    );
    assert!(!Path::new("/dev/zero.lock").exists());
}

#[test]
fn a_file_of_10_gigabytes_is_read_in_part() {
    let folder = Folder::new();
    for file in ["epoch.lock", "epoch.stop", "epoch"] {
        std::fs::File::create(folder.path(file))
            .unwrap()
            .set_len(10_000_000_000)
            .unwrap();
        match folder.own() {
            Ok(_) => panic!("{file} is taken for one of gantry-tau"),
            Err(error) => {
                let reason = match file {
                    "epoch" => "does not contain a counter",
                    "epoch.stop" => "is another file, not a stop latch of gantry-tau",
                    _ => "is another file, not a lock of gantry-tau",
                };
                assert!(error.to_string().contains(reason), "{error}");
                assert_eq!(
                    std::fs::metadata(folder.path(file)).unwrap().len(),
                    10_000_000_000,
                    "left as it was"
                );
                std::fs::remove_file(folder.path(file)).unwrap();
            }
        }
    }
}

/// An environment with these folders of the user.
fn environment(state: &str, home: &str, is_root: bool) -> Environment {
    let [state_home, home] = [state, home].map(|text| (text != "unset").then(|| text.into()));
    Environment {
        state_directory: None,
        state_home,
        home,
        is_root,
    }
}

/// An environment of a service with these folders.
fn service(folders: &str) -> Environment {
    Environment {
        state_directory: Some(folders.into()),
        ..environment("/s", "/h", true)
    }
}

/// Epoch file of the machine `press-2`.
fn place(environment: &Environment, is_simulated: bool) -> Result<PathBuf, PlaceError> {
    let name: MachineName = "press-2".parse().unwrap();
    environment
        .place(&name, is_simulated)
        .map(|place| place.epoch_file)
}

/// Epoch file of `press-2` in a folder.
fn at(folder: &str) -> Result<PathBuf, PlaceError> {
    Ok(PathBuf::from(folder).join("press-2").join("epoch"))
}

#[test]
fn the_place_is_of_the_machine_or_of_the_login() {
    for (state, home, expected) in [
        ("/s", "/h", at("/s/gantry-tau")),
        ("unset", "/h", at("/h/.local/state/gantry-tau")),
        ("", "/h", at("/h/.local/state/gantry-tau")),
        ("relative/s", "/h", at("/h/.local/state/gantry-tau")),
        ("unset", "unset", Err(PlaceError)),
        ("", "", Err(PlaceError)),
        ("s", "h", Err(PlaceError)),
    ] {
        assert_eq!(
            place(&environment(state, home, false), true),
            expected,
            "{state:?} {home:?}"
        );
        // Another login, root and an environment without anything have the same place for the same
        // machine.
        if cfg!(unix) {
            assert_eq!(
                place(&environment(state, home, true), true),
                at("/var/lib/gantry-tau")
            );
            assert_eq!(
                place(&environment(state, home, false), false),
                at("/var/lib/gantry-tau")
            );
        }
    }
    assert_eq!(
        place(&service("/var/lib/private/one:/two"), false),
        at("/var/lib/private/one")
    );
    assert_eq!(place(&service(""), false), at("/var/lib/gantry-tau"));
    let said = PlaceError.to_string();
    assert!(
        said.contains("--epoch-file") && said.contains("HOME"),
        "{said}"
    );
}

#[test]
fn a_machine_has_a_name_that_is_a_folder() {
    for (address, name) in [
        ("127.0.0.1:7000", "l2-0012abcd-127.0.0.1-7000"),
        ("[fe80::1%2]:7000", "l2-0012abcd--fe80--1-2--7000"),
    ] {
        let address = address.parse().unwrap();
        assert_eq!(
            MachineName::of("l2", 0x0012_abcd, address).to_string(),
            name
        );
    }
    for good in ["a", "Press.2_b-c", &"x".repeat(64)] {
        assert_eq!(good.parse::<MachineName>().unwrap().to_string(), good);
    }
    for bad in [
        "",
        ".",
        "..",
        "-x",
        "_x",
        "a/b",
        "a b",
        "a\n",
        "ü",
        "=1",
        "\x1b[2J",
        "a\0",
        "a:b",
        "a\\b",
        &"x".repeat(65),
    ] {
        let error = bad.parse::<MachineName>().unwrap_err().to_string();
        assert!(error.contains("1 to 64"), "{bad:?}: {error}");
    }
}
