//! A network interface through a raw socket of Linux.

use std::os::fd::{AsRawFd, OwnedFd};
use std::time::{Duration, Instant};

use nix::ifaddrs::getifaddrs;
use nix::net::if_::InterfaceFlags;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, Protocol, RecvFlags, SendFlags, SocketFlags, SocketType, recv, send, socket_with,
};

use crate::claim::{Claim, Refused};
use crate::wire::{Wire, WireError};

/// EtherType of EtherCAT.
const ETHERCAT: u16 = 0x88A4;

/// Longest wait for a carrier: a link of 1 Gbit/s is negotiated within 3 s.
const LINK_PATIENCE: Duration = Duration::from_secs(4);
/// Time between two looks at the link.
const LINK_REST: Duration = Duration::from_millis(20);

/// A network interface that carries nothing but EtherCAT.
#[derive(Debug)]
pub struct RawSocket {
    socket: OwnedFd,
    start: Instant,
    /// Given back after the socket.
    _claim: Claim,
}

/// Error of an interface.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RawSocketError {
    /// The user may not open raw sockets.
    #[error("raw sockets are not permitted; run as root, or give the program CAP_NET_RAW")]
    Permission,
    /// The system has no interface of this name.
    #[error("there is no network interface {0}; `ip link` lists them")]
    NoInterface(String),
    /// The interface is switched off.
    #[error("the network interface {0} is down; `ip link set {0} up`")]
    Down(String),
    /// The interface has no carrier.
    #[error(
        "the network interface {0} has no carrier: its cable is out, or the drive at the other end has no power"
    )]
    NoCarrier(String),
    /// Another program moves the drives behind the interface.
    #[error(
        "network interface {interface} is in use by {owner}; a bus has one master: end that program first"
    )]
    Owned {
        /// The interface.
        interface: String,
        /// The process.
        owner: String,
    },
    /// Another error of the system.
    #[error("{interface}: {reason}")]
    System {
        /// The interface.
        interface: String,
        /// The system's reason.
        reason: String,
    },
}

impl RawSocket {
    /// Opens an interface by its name, once it has a carrier, and owns it: no other socket of this
    /// kind opens it until this one is dropped. Nothing is sent yet. Its frames of EtherCAT are
    /// read, no others.
    ///
    /// # Errors
    /// [`RawSocketError`].
    pub fn open(interface: &str) -> Result<Self, RawSocketError> {
        let protocol = Protocol::from_raw(std::num::NonZeroU32::from(ETHERTYPE_ON_THE_WIRE));
        let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
        let socket = socket_with(
            AddressFamily::PACKET,
            SocketType::RAW,
            flags,
            Some(protocol),
        )
        .map_err(|error| {
            if matches!(error, Errno::PERM | Errno::ACCESS) {
                RawSocketError::Permission
            } else {
                system_error(interface, &error)
            }
        })?;
        await_link(interface)?;
        let mut addresses = getifaddrs().map_err(|error| system_error(interface, &error))?;
        let address = addresses.find_map(|entry| {
            let address = entry
                .address
                .filter(|_| entry.interface_name == interface)?;
            address.as_link_addr().copied()
        });
        let address = address.ok_or_else(|| RawSocketError::NoInterface(interface.to_owned()))?;
        let claim = Claim::acquire(address.ifindex()).map_err(|refused| match refused {
            Refused::Owned(process) => RawSocketError::Owned {
                interface: interface.to_owned(),
                owner: process.map_or_else(
                    || "another process".to_owned(),
                    |process| format!("pid {process}"),
                ),
            },
            Refused::System(error) => system_error(interface, &error),
        })?;
        // The address names no protocol: the socket's own stands.
        nix::sys::socket::bind(socket.as_raw_fd(), &address)
            .map_err(|error| system_error(interface, &error))?;
        Ok(Self {
            socket,
            start: Instant::now(),
            _claim: claim,
        })
    }
}

/// Error of the system at an interface.
fn system_error(interface: &str, error: &dyn std::fmt::Display) -> RawSocketError {
    RawSocketError::System {
        interface: interface.to_owned(),
        reason: error.to_string(),
    }
}

/// Checks that an interface is up and has a carrier.
///
/// # Errors
/// [`RawSocketError`]: `NoInterface`, `Down`, `NoCarrier`, or that the system does not list its
/// interfaces.
pub fn check_link(interface: &str) -> Result<(), RawSocketError> {
    let mut interfaces = getifaddrs().map_err(|error| system_error(interface, &error))?;
    match interfaces
        .find(|entry| entry.interface_name == interface)
        .map(|entry| entry.flags)
    {
        None => Err(RawSocketError::NoInterface(interface.to_owned())),
        Some(flags) if !flags.contains(InterfaceFlags::IFF_UP) => {
            Err(RawSocketError::Down(interface.to_owned()))
        }
        Some(flags) if !flags.contains(InterfaceFlags::IFF_RUNNING) => {
            Err(RawSocketError::NoCarrier(interface.to_owned()))
        }
        Some(_) => Ok(()),
    }
}

/// As [`check_link`], after some patience: an interface that has just been switched on negotiates
/// its link first.
fn await_link(interface: &str) -> Result<(), RawSocketError> {
    let start = Instant::now();
    loop {
        match check_link(interface) {
            Err(RawSocketError::NoCarrier(_)) if start.elapsed() < LINK_PATIENCE => {
                std::thread::sleep(LINK_REST)
            }
            link => return link,
        }
    }
}

/// The EtherType in network byte order, as the system wants it.
const ETHERTYPE_ON_THE_WIRE: std::num::NonZeroU16 =
    match std::num::NonZeroU16::new(ETHERCAT.to_be()) {
        Some(protocol) => protocol,
        None => std::num::NonZeroU16::MIN,
    };

impl Wire for RawSocket {
    fn now_us(&self) -> u64 {
        u64::try_from(self.start.elapsed().as_micros()).unwrap_or(u64::MAX)
    }

    fn now_ns(&self) -> u64 {
        u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), WireError> {
        match send(&self.socket, frame, SendFlags::empty()) {
            Ok(length) if length == frame.len() => Ok(()),
            _ => Err(WireError),
        }
    }

    fn receive(&mut self, buffer: &mut [u8]) -> Option<usize> {
        recv(&self.socket, buffer, RecvFlags::empty())
            .ok()
            .map(|(length, _)| length)
            .filter(|length| *length > 0)
    }

    fn wait_until(&mut self, us: u64) {
        let wait_us = us.saturating_sub(self.now_us());
        let timeout = Timespec {
            tv_sec: i64::try_from(wait_us / 1_000_000).unwrap_or(i64::MAX),
            tv_nsec: i64::try_from(wait_us % 1_000_000 * 1_000).unwrap_or(0),
        };
        // An interrupted wait is a short one: the caller looks at the clock.
        let _ready = poll(
            &mut [PollFd::new(&self.socket, PollFlags::IN)],
            Some(&timeout),
        );
    }
}
