//! Ownership of a network interface among the programs of a computer that move drives.
//!
//! An abstract name of a Unix socket is a lock that fits: it belongs to a network namespace as the
//! interface does, is the same for every login, tells the process that has it, and is free again
//! when that process has ended, however it ended.

use std::os::fd::OwnedFd;

use nix::sys::socket::{getsockopt, sockopt::PeerCredentials};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, SocketAddrUnix, SocketFlags, SocketType, bind, connect, listen, socket_with,
};

/// Processes that can ask for the owner while it runs: their connections wait to be accepted, and
/// never are.
const MAX_ASKED: i32 = 4_096;

/// An owned interface; given back when it is dropped.
#[derive(Debug)]
pub(crate) struct Claim {
    _socket: OwnedFd,
}

/// Reason for which an interface cannot be owned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refused {
    /// Another process owns it; `None` if that cannot be seen from here.
    Owned(Option<i32>),
    /// The system does not give the name.
    System(Errno),
}

impl Claim {
    /// Acquires the interface of this index; a claim stays valid when the interface is renamed.
    pub(crate) fn acquire(interface: usize) -> Result<Self, Refused> {
        let name = format!("gantry-tau/ethercat/interface-{interface}");
        let socket = unix_socket().map_err(Refused::System)?;
        let address =
            SocketAddrUnix::new_abstract_name(name.as_bytes()).map_err(Refused::System)?;
        match bind(&socket, &address) {
            Ok(()) => listen(&socket, MAX_ASKED).map_err(Refused::System)?,
            Err(Errno::ADDRINUSE) => return Err(Refused::Owned(owner(&address))),
            Err(error) => return Err(Refused::System(error)),
        }
        Ok(Self { _socket: socket })
    }
}

/// Returns the process that owns a name; `None` for one outside this process' namespace.
fn owner(address: &SocketAddrUnix) -> Option<i32> {
    let socket = unix_socket().ok()?;
    connect(&socket, address).ok()?;
    getsockopt(&socket, PeerCredentials)
        .ok()
        .map(|owner| owner.pid())
        .filter(|process| *process > 0)
}

fn unix_socket() -> Result<OwnedFd, Errno> {
    socket_with(
        AddressFamily::UNIX,
        SocketType::STREAM,
        SocketFlags::NONBLOCK | SocketFlags::CLOEXEC,
        None,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No interface has this index.
    const NONE: usize = 0x7FFF_0000;

    #[test]
    fn a_second_owner_is_refused_with_the_process_of_the_first() {
        let index = NONE + usize::try_from(std::process::id()).unwrap();
        let first = Claim::acquire(index).unwrap();
        let ours = i32::try_from(std::process::id()).ok();
        // However many ask.
        for _again in 0..100 {
            assert_eq!(Claim::acquire(index).err(), Some(Refused::Owned(ours)));
        }
        assert!(Claim::acquire(index + 1).is_ok(), "another interface");
        drop(first);
        assert!(Claim::acquire(index).is_ok(), "given back");
    }
}
