//! The way of log messages: to the emulator's console, as defmt encodes them. The ready-made way
//! (defmt-semihosting) links panics.

use core::cell::UnsafeCell;

use super::host::File;

/// The way.
#[defmt::global_logger]
struct Console;

/// Destination of messages, and the state of their encoding.
struct Stream {
    /// Opened by the first message.
    console: Option<File>,
    encoder: defmt::Encoder,
}

struct Shared(UnsafeCell<Stream>);

// SAFETY: one processor, and only main logs; no interrupt does.
unsafe impl Sync for Shared {}

static STREAM: Shared = Shared(UnsafeCell::new(Stream {
    console: None,
    encoder: defmt::Encoder::new(),
}));

/// Lets `step` encode; what cannot be written is lost.
fn encode(step: impl FnOnce(&mut defmt::Encoder, &mut dyn FnMut(&[u8]))) {
    // SAFETY: only main logs, and no `step` logs in turn.
    let Stream { console, encoder } = unsafe { &mut *STREAM.0.get() };
    if console.is_none() {
        *console = File::console();
    }
    step(encoder, &mut |bytes| {
        if let Some(console) = *console {
            console.write_all(bytes);
        }
    });
}

// SAFETY: acquiring needs no lock, as there is one context that logs.
unsafe impl defmt::Logger for Console {
    fn acquire() {
        encode(|encoder, write| encoder.start_frame(write));
    }

    unsafe fn flush() {}

    unsafe fn release() {
        encode(|encoder, write| encoder.end_frame(write));
    }

    unsafe fn write(bytes: &[u8]) {
        encode(|encoder, write| encoder.write(bytes, write));
    }
}
