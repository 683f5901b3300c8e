//! LinuxCNC as a process: headless, unprivileged, in namespaces of its own, so that runs share
//! neither memory, ports nor modules.

use std::fs::Permissions;
use std::os::unix::fs::{PermissionsExt, chown};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{PoisonError, RwLock};

use gantry_tau::header::{HeaderOptions, Prefix, run as write_header};
use gantry_tau_machine::robot_file::AnyRobotFile;
use gantry_tau_system::output::{Kind, Output};
use libtest_mimic::Failed;
use tempfile::TempDir;

use super::record::{Record, Row};
use crate::capi::tools::{has, library, run, target};

/// Folder that LinuxCNC loads modules from; the path is compiled in.
const MODULES: &str = "/usr/lib/linuxcnc/modules";
const MAKEFILE: &str = "/usr/share/linuxcnc/Makefile.modinc";
/// User without rights: as root LinuxCNC loads no module.
const USER: u32 = 65534;
/// Namespaces of a run: mounts, memory between processes, network, processes.
const NAMESPACES: [&str; 7] = [
    "-m",
    "-i",
    "-n",
    "-p",
    "--fork",
    "--kill-child",
    "--mount-proc",
];

/// One run at a time, which two would make late on a small computer; runs in lock-step do not mind,
/// and share it.
pub(super) static ONE: RwLock<()> = RwLock::new(());

/// Names of all that is missing for a run.
pub(super) fn missing() -> Vec<&'static str> {
    let mut missing = Vec::new();
    if !Path::new("/usr/bin/linuxcnc").exists() {
        missing.push("linuxcnc-uspace");
    }
    if !Path::new(MAKEFILE).exists() {
        missing.push("linuxcnc-uspace-dev");
    }
    missing.extend(
        ["gcc", "make", "nm", "setpriv", "timeout", "unshare"]
            .into_iter()
            .filter(|tool| !has(tool)),
    );
    if missing.is_empty() {
        missing.extend(forbidden());
    }
    missing
}

/// Name of the first thing that the sandbox of this test does not permit: namespaces, mounts in
/// them, another user.
fn forbidden() -> Option<&'static str> {
    let mount = format!("mount --bind {MODULES} {MODULES}");
    let user = format!("{mount} && setpriv --reuid={USER} --regid={USER} --clear-groups true");
    let steps = [
        ("true", "unshare-as-root"),
        (&mount, "mount-as-root"),
        (&user, "setpriv-as-root"),
    ];
    let refused = steps.into_iter().find(|(script, _)| {
        let output = Command::new("unshare")
            .args(NAMESPACES)
            .args(["sh", "-c", script])
            .output();
        !output.is_ok_and(|output| output.status.success())
    });
    refused.map(|(_, name)| name)
}

/// `host/linuxcnc`.
pub(super) fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../host/linuxcnc")
}

/// Builds the modules for a machine in `build`. `header` changes the text of `machine.h`.
pub(super) fn make(
    robot: &str,
    build: &Path,
    header: impl Fn(String) -> String,
) -> Result<(), Failed> {
    std::fs::create_dir_all(build)?;
    let machine = build.join("machine.h");
    let output = Output::new(&*machine, Kind::Header);
    let robot_file = AnyRobotFile::named(robot).unwrap();
    write_header(&HeaderOptions {
        robot: robot_file,
        prefix: Prefix::default(),
        output,
    })?;
    std::fs::write(&machine, header(std::fs::read_to_string(&machine)?))?;
    let mut make = Command::new("make");
    make.current_dir(folder())
        .env_remove("MAKEFLAGS")
        .arg(format!("ROBOT={robot}"));
    make.arg(format!("BUILD={}", build.display()))
        .arg(format!("ARCHIVE={}", library().display()));
    // The header is there; `gantry-tau header` has tests of its own.
    run(make.arg("GANTRY_TAU=true")).map(drop)
}

/// A configuration of `host/linuxcnc/config` in a folder of its own.
pub(super) struct Machine {
    pub(super) name: &'static str,
    folder: TempDir,
}

/// Outcome of a run.
pub(super) struct Ended {
    /// Output of LinuxCNC and of the screen.
    pub(super) said: String,
    /// Record of the sampler; empty if the machine was not loaded.
    pub(super) record: Record,
}

impl Machine {
    /// Builds the modules of a machine, and copies its configuration.
    pub(super) fn new(
        name: &'static str,
        test: &str,
        header: impl Fn(String) -> String,
    ) -> Result<Self, Failed> {
        let machine = Self::built(name, test, header)?;
        machine.after_drives("sampler.tcl")?;
        Ok(machine)
    }

    fn built(
        name: &'static str,
        test: &str,
        header: impl Fn(String) -> String,
    ) -> Result<Self, Failed> {
        let place = tempfile::Builder::new()
            .prefix(&format!("gantry-tau-linuxcnc-{name}-{test}-"))
            .tempdir()?;
        let modules = place.path().join("modules");
        copy(Path::new(MODULES), &modules)?;
        copy(&folder().join("config"), &place.path().join("config"))?;
        let build = target().join(format!("linuxcnc-{name}-{test}"));
        make(name, &build, header)?;
        for module in ["gantrytaukins.so", "gantry_tau.so"] {
            std::fs::copy(build.join(module), modules.join(module))?;
        }
        Ok(Self {
            name,
            folder: place,
        })
    }

    /// As [`Self::new`], with the screen that obeys, and `parameters` of the server.
    pub(super) fn obeying(
        name: &'static str,
        test: &str,
        parameters: &str,
    ) -> Result<Self, Failed> {
        let machine = Self::built(name, test, |header| header)?;
        machine.after_drives("judged.tcl")?;
        std::fs::set_permissions(machine.bring("screen.py")?, Permissions::from_mode(0o755))?;
        machine.edit("DISPLAY = ../run.py", "DISPLAY = ./screen.py")?;
        machine.edit(
            "PARAMETERS = epoch_file=epochs",
            &format!("PARAMETERS = epoch_file=epochs {parameters}"),
        )?;
        Ok(machine)
    }

    /// Loads a file of the tests after the drives.
    fn after_drives(&self, name: &str) -> Result<(), Failed> {
        self.bring(name)?;
        let drives = "HALFILE = ../drives.tcl";
        self.edit(drives, &format!("{drives}\nHALFILE = {name}"))
    }

    /// Replaces a text of the INI file, which has it once.
    pub(super) fn edit(&self, from: &str, to: &str) -> Result<(), Failed> {
        replace(&self.file(&format!("{}.ini", self.name)), from, to)
    }

    /// Replaces a text of `drives.tcl`, which has it once.
    pub(super) fn edit_drives(&self, from: &str, to: &str) -> Result<(), Failed> {
        replace(&self.file("../drives.tcl"), from, to)
    }

    /// Takes a module from somewhere else.
    pub(super) fn module(&self, path: &Path) -> Result<(), Failed> {
        Ok(std::fs::copy(
            path,
            self.folder
                .path()
                .join("modules")
                .join(path.file_name().unwrap()),
        )
        .map(drop)?)
    }

    /// True if the thread waits for the client.
    pub(super) fn is_lockstep(&self) -> bool {
        std::fs::read_to_string(self.file(&format!("{}.ini", self.name)))
            .unwrap()
            .contains("lockstep=1")
    }

    /// Epochs that are used up.
    pub(super) fn epochs(&self) -> u64 {
        std::fs::read_to_string(self.file("epochs"))
            .unwrap()
            .trim()
            .parse()
            .unwrap()
    }

    /// Copies a file of these tests to where LinuxCNC sees it. Returns its path.
    pub(super) fn bring(&self, name: &str) -> Result<PathBuf, Failed> {
        let path = self.file(name);
        Ok(std::fs::copy(own(name), &path).map(|_| path)?)
    }

    /// Path of a file of the configuration.
    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join("config").join(self.name).join(name)
    }

    /// Replaces the part program.
    pub(super) fn program(&self, text: &str) -> Result<(), Failed> {
        Ok(std::fs::write(self.file("part.ngc"), text)?)
    }

    /// Runs LinuxCNC until its screen ends.
    pub(super) fn run(&self) -> Result<Ended, Failed> {
        let said = self.unprivileged(&self.linuxcnc()?)?;
        let record = std::fs::read_to_string(self.file("record.txt")).unwrap_or_default();
        Ok(Ended {
            record: Record::parse(&record),
            said,
        })
    }

    /// The command that runs LinuxCNC until its screen ends.
    pub(super) fn linuxcnc(&self) -> Result<String, Failed> {
        std::fs::write(self.file("sim.var"), "")?;
        Ok(format!(
            "linuxcnc {}",
            self.file(&format!("{}.ini", self.name)).display()
        ))
    }

    /// Runs a command as the user who may load modules, in the configuration's folder; returns all
    /// output.
    pub(super) fn unprivileged(&self, command: &str) -> Result<String, Failed> {
        let _one = ONE.write().unwrap_or_else(PoisonError::into_inner);
        let output = self.command(command)?.output()?;
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }

    /// The process for [`Self::unprivileged`].
    pub(super) fn command(&self, command: &str) -> Result<Command, Failed> {
        give(self.folder.path())?;
        // A /tmp of its own: LinuxCNC's lock is there.
        let script = format!(
            "mount --bind {place} /mnt && mount -t tmpfs tmp /tmp && chmod 1777 /tmp && mkdir -p {place} && mount --bind /mnt {place} && \
             mount --bind {place}/modules {MODULES} && ip link set lo up && cd {home} && exec setpriv --reuid={USER} --regid={USER} --clear-groups \
             env -i HOME={home} PATH=/usr/bin:/bin RUNTESTS=1 {command} 2>&1",
            place = self.folder.path().display(),
            home = self.file("").display(),
        );
        let mut limited = Command::new("timeout");
        limited
            .args(["150", "unshare"])
            .args(NAMESPACES)
            .args(["sh", "-c", &script]);
        Ok(limited)
    }
}

impl Ended {
    /// Lines of the screen that begin with a word.
    pub(super) fn lines(&self, word: &str) -> Vec<&str> {
        let start = format!("gantry-tau {word} ");
        self.said
            .lines()
            .filter_map(|line| line.strip_prefix(start.as_str()))
            .collect()
    }

    /// The numbers of a line of the screen, without the letters of axes.
    pub(super) fn numbers(&self, word: &str) -> Vec<f64> {
        let lines = self.lines(word);
        let [line] = lines.as_slice() else {
            panic!("{word}: {}", self.said)
        };
        line.split(' ')
            .map(|number| {
                number
                    .trim_start_matches(char::is_alphabetic)
                    .parse()
                    .unwrap()
            })
            .collect()
    }

    /// Rows of the part program: from the first one in world mode to the last one with the machine
    /// on.
    pub(super) fn motion(&self) -> &[Row] {
        let rows = &self.record.0;
        let from = rows
            .iter()
            .position(|row| row.is_on && row.is_world)
            .unwrap_or_else(|| panic!("{}", self.said));
        let after = rows
            .iter()
            .rposition(|row| row.is_on && row.is_world)
            .unwrap();
        &rows[from..=after]
    }
}

/// Replaces a text of a file, which has it once.
fn replace(file: &Path, from: &str, to: &str) -> Result<(), Failed> {
    let text = std::fs::read_to_string(file)?;
    assert_eq!(text.matches(from).count(), 1, "{from}: {text}");
    Ok(std::fs::write(file, text.replace(from, to))?)
}

/// A file of these tests. LinuxCNC does not see it where the clone is in `/tmp`:
/// [`Machine::bring`].
fn own(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/tools/linuxcnc")
        .join(name)
}

/// Copies a folder with its folders.
pub(super) fn copy(from: &Path, to: &Path) -> Result<(), Failed> {
    std::fs::create_dir_all(to)?;
    for entry in std::fs::read_dir(from)? {
        let (source, to) = (entry.as_ref().unwrap().path(), to.join(entry?.file_name()));
        if source.is_dir() {
            copy(&source, &to)?
        } else {
            std::fs::copy(&source, to).map(drop)?
        }
    }
    Ok(())
}

/// Gives a folder to the user who runs LinuxCNC.
fn give(path: &Path) -> Result<(), Failed> {
    chown(path, Some(USER), Some(USER))?;
    if path.is_dir() {
        for entry in std::fs::read_dir(path)? {
            give(&entry?.path())?;
        }
    }
    Ok(())
}
