//! Command line of the emulator.
#![allow(
    unsafe_code,
    reason = "a call of the emulator; the block says why it is sound"
)]

use cortex_m_semihosting::nr;

/// Longest command line, bytes.
const COMMAND_LINE: usize = 128;

/// The emulator's `arg=` words, separated by blanks.
pub(crate) struct CommandLine {
    bytes: [u8; COMMAND_LINE],
    length: usize,
}

/// Argument of GET_CMDLINE.
#[repr(C)]
struct Room {
    bytes: *mut u8,
    length: usize,
}

impl CommandLine {
    /// Reads it; empty if there is none, or a longer one.
    pub(crate) fn read() -> Self {
        let mut bytes = [0; COMMAND_LINE];
        let mut room = Room {
            bytes: bytes.as_mut_ptr(),
            length: COMMAND_LINE,
        };
        // SAFETY: the call writes at most `length` bytes to `bytes` and their number to `length`;
        // both live through it.
        let failed = unsafe {
            cortex_m_semihosting::syscall1(nr::GET_CMDLINE, (&raw mut room).expose_provenance())
        };
        let length = if failed == 0 { room.length } else { 0 };
        Self { bytes, length }
    }

    /// Returns its words. (Those of a `str` link a panic.)
    pub(crate) fn words(&self) -> impl Iterator<Item = &[u8]> {
        let line = self.bytes.get(..self.length).unwrap_or_default();
        line.split(|byte| *byte == b' ')
    }
}
