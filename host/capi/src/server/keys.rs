//! Keys of a server, and peers without a connection.

use core::ptr::null_mut;

use gantry_tau_core::control::endpoint::{Budget, Endpoint, Greeted};
use gantry_tau_core::control::keys::{KeyId, KeyTextError, Keyring, KeyringError, Role, Secret};
use gantry_tau_core::control::session::Connection;

use super::frame::gt_frame;
use crate::code::gt_code;
use crate::error::{count, gt_error};
use crate::memory::{Reply, answer, bytes, read};
use crate::padding::padded;

/// Keys of a server at most.
pub const GT_MAX_KEYS: usize = 4;
/// Bytes of a secret.
pub const GT_SECRET: usize = 32;
/// Bytes of the name of a key.
pub const GT_KEY_ID: usize = 8;
/// Bytes of an address and port: an IPv6 address, or that of IPv4 as it is mapped into IPv6, and the
/// port, big-endian.
pub const GT_PEER: usize = 18;

/// The holder may have a session.
pub const GT_ROLE_CONTROL: u8 = 1;
/// The holder may read, and gets no session.
pub const GT_ROLE_READ: u8 = 2;

/// The datagram is not answered.
pub const GT_GREETED_NOTHING: u32 = 1;
/// The frame is to be sent to the peer, of which nothing is remembered.
pub const GT_GREETED_ANSWER: u32 = 2;
/// The peer has a place: frame.connection is its connection, and there is nothing to be sent.
pub const GT_GREETED_PEER: u32 = 3;

/// A shared secret.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct gt_key {
    /// 32 random bytes.
    pub secret: [u8; GT_SECRET],
    /// GT_ROLE_CONTROL or GT_ROLE_READ.
    pub role: u8,
}

/// Keys of a server.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct gt_keys {
    /// Number of the keys, 1 to GT_MAX_KEYS.
    pub count: u32,
    /// The keys; those from `count` on are not read.
    pub keys: [gt_key; GT_MAX_KEYS],
    /// Random bytes of this start; on a target without random numbers a constant, if its epochs never
    /// repeat.
    pub start_secret: [u8; GT_SECRET],
    /// Tags that are computed per tick of datagrams from the owner's address; 0: 16.
    pub tags: u8,
    /// Hellos that are judged per tick; 0: 4.
    pub greetings: u8,
}

/// Result of gt_server_greet.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct gt_greeting {
    /// GT_GREETED_NOTHING, GT_GREETED_ANSWER or GT_GREETED_PEER.
    pub what: u32,
    /// The answer, or the number of the connection.
    pub frame: gt_frame,
}

padded! {
    gt_key { secret role }
    gt_greeting { what frame }
}

impl gt_greeting {
    pub(super) fn new(greeted: Greeted<'_>) -> Self {
        let no_connection = Connection(u64::MAX);
        let (what, frame) = match greeted {
            Greeted::Nothing => (GT_GREETED_NOTHING, gt_frame::new(no_connection, &[])),
            Greeted::Answer(frame) => (GT_GREETED_ANSWER, gt_frame::new(no_connection, frame)),
            Greeted::Peer(connection) => (GT_GREETED_PEER, gt_frame::new(connection, &[])),
        };
        Self { what, frame }
    }
}

impl gt_keys {
    /// Returns the keyring and the budget.
    pub(super) fn checked(&self) -> Reply<(Keyring, Budget)> {
        let used = usize::try_from(self.count).ok();
        let keys = used.and_then(|used| self.keys.get(..used));
        let keys = keys
            .filter(|keys| !keys.is_empty())
            .ok_or_else(|| gt_error::new(gt_code::KeyCount).value(self.count.into()))?;
        let mut keyring = Keyring::new(&self.start_secret);
        for (index, key) in keys.iter().enumerate() {
            let role = role_of(key.role).ok_or_else(|| {
                gt_error::new(gt_code::KeyRole)
                    .at(index)
                    .value(key.role.into())
            })?;
            let secret = Secret {
                role,
                bytes: key.secret,
            };
            keyring.add(secret.key()).map_err(|error| match error {
                KeyringError::Full => gt_error::new(gt_code::KeyCount).value(self.count.into()),
                KeyringError::Twice { .. } => gt_error::new(gt_code::KeyTwice).at(index),
            })?;
        }
        let Budget { tags, greetings } = Budget::default();
        let or = |given: u8, otherwise| if given == 0 { otherwise } else { given };
        let budget = Budget {
            tags: or(self.tags, tags),
            greetings: or(self.greetings, greetings),
        };
        Ok((keyring, budget))
    }
}

const fn role_of(code: u8) -> Option<Role> {
    match code {
        GT_ROLE_CONTROL => Some(Role::Control),
        GT_ROLE_READ => Some(Role::Read),
        _ => None,
    }
}

/// Reads the text of a key file, which `gantry-tau key new` makes. A reader of the file can move the
/// machine: check its permissions before.
///
/// Errors: GT_CODE_KEY_TEXT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_key_parse(
    text: *const u8,
    length: usize,
    key: *mut gt_key,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(key, error, || {
            let secret = Secret::parse(bytes(text, length)?)?;
            Ok(gt_key {
                secret: secret.bytes,
                role: match secret.role {
                    Role::Control => GT_ROLE_CONTROL,
                    Role::Read => GT_ROLE_READ,
                },
            })
        })
    }
}

/// `id` receives the GT_KEY_ID bytes of the name of a key, which says nothing of its secret.
///
/// Errors: GT_CODE_KEY_ROLE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_key_id(key: *const gt_key, id: *mut u8) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(id.cast::<[u8; GT_KEY_ID]>(), null_mut(), || {
            let gt_key { secret, role } = read(key)?;
            let role = role_of(role).ok_or(gt_code::KeyRole)?;
            let bytes = secret;
            Ok(Secret { role, bytes }.key().id().0)
        })
    }
}

/// Name of the key of the session; an error without one.
pub(super) fn granted_key<const N: usize>(endpoint: &Endpoint<N>) -> Reply<[u8; GT_KEY_ID]> {
    let KeyId(id) = endpoint.granted_key().ok_or(gt_code::Done)?;
    Ok(id)
}

/// Number of a wrong line.
impl From<KeyTextError> for gt_error {
    fn from(error: KeyTextError) -> Self {
        let line = match error {
            KeyTextError::Format => 1,
            KeyTextError::Role => 2,
            KeyTextError::Secret => 3,
            KeyTextError::End => 4,
        };
        Self::new(gt_code::KeyText).value(count(line))
    }
}
