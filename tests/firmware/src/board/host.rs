//! What a program may ask of the emulator (semihosting): its command line, files, and to be ended.
//! The calls are made here, not by a crate's `write_all` and `args`, because those link panics.

use core::ffi::CStr;

use cortex_m_semihosting::{debug, nr, syscall};

/// Longest command line, bytes.
const COMMAND_LINE: usize = 128;

/// Ends the emulator: exit code 0, or 1.
pub(crate) fn exit(well: bool) -> ! {
    let status = if well {
        debug::EXIT_SUCCESS
    } else {
        debug::EXIT_FAILURE
    };
    loop {
        debug::exit(status);
    }
}

/// The emulator's `arg=` words, with blanks between them.
pub(crate) struct CommandLine {
    bytes: [u8; COMMAND_LINE],
    length: usize,
}

/// What GET_CMDLINE reads and writes.
#[repr(C)]
struct Room {
    bytes: *mut u8,
    length: usize,
}

impl CommandLine {
    /// Asks for it; empty when there is none, or a longer one.
    pub(crate) fn read() -> Self {
        let mut bytes = [0; COMMAND_LINE];
        let mut room = Room {
            bytes: bytes.as_mut_ptr(),
            length: COMMAND_LINE,
        };
        // SAFETY: the call writes at most `length` bytes to `bytes` and their number to `length`; both live through it.
        let failed = unsafe {
            cortex_m_semihosting::syscall1(nr::GET_CMDLINE, (&raw mut room).expose_provenance())
        };
        let length = if failed == 0 { room.length } else { 0 };
        Self { bytes, length }
    }

    /// Its words. (Those of a `str` link a panic.)
    pub(crate) fn words(&self) -> impl Iterator<Item = &[u8]> {
        let line = self.bytes.get(..self.length).unwrap_or_default();
        line.split(|byte| *byte == b' ')
    }
}

/// An open file of the host, in the emulator's working directory.
#[derive(Clone, Copy)]
pub(crate) struct File {
    handle: usize,
}

impl File {
    /// A file to read; `None` when there is none.
    pub(crate) fn open(name: &CStr) -> Option<Self> {
        Self::with_mode(name, nr::open::R_BINARY)
    }

    /// A new file to write; `None` when it cannot be made.
    pub(crate) fn create(name: &CStr) -> Option<Self> {
        Self::with_mode(name, nr::open::W_TRUNC_BINARY)
    }

    /// The console.
    pub(super) fn console() -> Option<Self> {
        Self::with_mode(c":tt", nr::open::W_TRUNC)
    }

    fn with_mode(name: &CStr, mode: usize) -> Option<Self> {
        // SAFETY: the call reads the name, whose length it is told.
        let handle = unsafe { syscall!(OPEN, name.as_ptr(), mode, name.count_bytes()) };
        (handle != usize::MAX).then_some(Self { handle })
    }

    /// Fills `bytes`; whether there were that many.
    pub(crate) fn read_exact(self, bytes: &mut [u8]) -> bool {
        // SAFETY: the call writes at most that many bytes there, and nobody else has the slice.
        let missing = unsafe { syscall!(READ, self.handle, bytes.as_mut_ptr(), bytes.len()) };
        missing == 0
    }

    /// Writes; whether all was written.
    pub(crate) fn write_all(self, bytes: &[u8]) -> bool {
        // SAFETY: the call reads that many bytes there.
        let missing = unsafe { syscall!(WRITE, self.handle, bytes.as_ptr(), bytes.len()) };
        missing == 0
    }
}
