//! Requests to the emulator (semihosting): files, and its end. The calls are made here, because a
//! crate's `write_all` links panics.

use core::ffi::CStr;

use cortex_m_semihosting::{debug, nr, syscall};

/// Ends the emulator, with exit code 0 if all went well, else 1.
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

/// An open file of the host, in the emulator's working directory.
#[derive(Clone, Copy)]
pub(crate) struct File {
    handle: usize,
}

impl File {
    /// Opens a file to read; `None` if there is none.
    pub(crate) fn open(name: &CStr) -> Option<Self> {
        Self::with_mode(name, nr::open::R_BINARY)
    }

    /// Creates a file to write; `None` if that fails.
    pub(crate) fn create(name: &CStr) -> Option<Self> {
        Self::with_mode(name, nr::open::W_TRUNC_BINARY)
    }

    /// Opens the console.
    pub(super) fn console() -> Option<Self> {
        Self::with_mode(c":tt", nr::open::W_TRUNC)
    }

    fn with_mode(name: &CStr, mode: usize) -> Option<Self> {
        // SAFETY: the call reads the name, whose length it is given.
        let handle = unsafe { syscall!(OPEN, name.as_ptr(), mode, name.count_bytes()) };
        (handle != usize::MAX).then_some(Self { handle })
    }

    /// Fills `bytes`. False if fewer are left.
    pub(crate) fn read_exact(self, bytes: &mut [u8]) -> bool {
        // SAFETY: the call writes at most that many bytes there, and nothing else has the slice.
        let missing = unsafe { syscall!(READ, self.handle, bytes.as_mut_ptr(), bytes.len()) };
        missing == 0
    }

    /// Writes. False if not all was written.
    pub(crate) fn write_all(self, bytes: &[u8]) -> bool {
        // SAFETY: the call reads that many bytes there.
        let missing = unsafe { syscall!(WRITE, self.handle, bytes.as_ptr(), bytes.len()) };
        missing == 0
    }
}
