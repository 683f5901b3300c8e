//! Privileges of the process: what a server gives up once its ports, its bus and its scheduling are
//! set up.
//!
//! Linux keeps capabilities by thread, and a new thread has those of the one that starts it. So
//! each thread gives up its own: the thread of the cycles when it has its priority, and the main
//! thread before it starts any other.

use std::io;
use std::path::{Path, PathBuf};

/// Gives up every capability of the calling thread, and the ways back to them: bounding set,
/// ambient set, and privileges of programs that it would start. The superuser is then an ordinary
/// user who owns the superuser's files.
///
/// `files` are to be written later. If one of them belongs to another user, the superuser's
/// capability to write there (`CAP_DAC_OVERRIDE`) is kept, and the file returned.
///
/// # Errors
/// The system's; some capabilities may be left then.
pub fn give_up(files: &[PathBuf]) -> io::Result<Option<&Path>> {
    system::give_up(files)
}

#[cfg(target_os = "linux")]
mod system {
    use std::io;
    use std::path::{Path, PathBuf};

    use rustix::fs::{Access, AtFlags, CWD, accessat};
    use rustix::io::Errno;
    use rustix::thread::{
        CapabilitySet, CapabilitySets, capabilities, clear_ambient_capability_set,
        remove_capability_from_bounding_set, set_capabilities, set_no_new_privs,
    };

    pub(super) fn give_up(files: &[PathBuf]) -> io::Result<Option<&Path>> {
        set_no_new_privs(true)?;
        let held = capabilities(None)?;
        if (held.effective | held.permitted | held.inheritable).is_empty() {
            // A sandbox may forbid the call that sets them.
            return Ok(None);
        }
        if held.effective.contains(CapabilitySet::SETPCAP) {
            for (_, capability) in CapabilitySet::all().iter_names() {
                // An older kernel does not know each of them.
                let _unknown = remove_capability_from_bounding_set(capability);
            }
        }
        clear_ambient_capability_set()?;
        let over_files = held.permitted & CapabilitySet::DAC_OVERRIDE;
        // Not in effect while the files are looked at.
        set(CapabilitySet::empty(), over_files)?;
        let others = if over_files.is_empty() {
            None
        } else {
            files.iter().find(|file| !is_writable(file))
        };
        let kept = if others.is_some() {
            over_files
        } else {
            CapabilitySet::empty()
        };
        set(kept, kept)?;
        Ok(others.map(PathBuf::as_path))
    }

    fn set(effective: CapabilitySet, permitted: CapabilitySet) -> io::Result<()> {
        Ok(set_capabilities(
            None,
            CapabilitySets {
                effective,
                permitted,
                inheritable: CapabilitySet::empty(),
            },
        )?)
    }

    /// True if a file can be written where it is, and replaced.
    fn is_writable(file: &Path) -> bool {
        fn may(path: &Path, access: Access) -> Result<(), Errno> {
            accessat(CWD, path, access, AtFlags::EACCESS)
        }
        let folder = match file.parent() {
            Some(parent) if parent.as_os_str().is_empty() => Path::new("."),
            Some(parent) => parent,
            None => file,
        };
        let whole_folder = Access::WRITE_OK | Access::EXEC_OK;
        let itself = may(
            file,
            if file.is_dir() {
                whole_folder
            } else {
                Access::WRITE_OK
            },
        );
        let beside = file.is_dir() || may(folder, whole_folder).is_ok();
        matches!(itself, Ok(()) | Err(Errno::NOENT)) && beside
    }
}

#[cfg(not(target_os = "linux"))]
mod system {
    use std::io;
    use std::path::{Path, PathBuf};

    pub(super) fn give_up(_: &[PathBuf]) -> io::Result<Option<&Path>> {
        Ok(None)
    }
}
