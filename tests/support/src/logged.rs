//! The log of a test.

use std::io::{self, Write};
use std::sync::{Arc, Mutex, Once};

use tracing_subscriber::fmt::MakeWriter;

/// Lines that were logged.
#[derive(Clone, Default)]
struct Lines(Arc<Mutex<Vec<u8>>>);

impl Write for Lines {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl MakeWriter<'_> for Lines {
    type Writer = Self;

    fn make_writer(&self) -> Self {
        self.clone()
    }
}

/// Returns what `act` returns, and the lines that it logs in this thread.
pub fn logged<T>(act: impl FnOnce() -> T) -> (T, String) {
    // As long as there is one subscriber alone, a thread without it turns off for all threads the
    // messages that it is the first to come across.
    static OF_OTHER_THREADS: Once = Once::new();
    OF_OTHER_THREADS.call_once(|| {
        let silent = tracing_subscriber::fmt().with_writer(io::sink).finish();
        // A test may have set another one.
        let _ = tracing::subscriber::set_global_default(silent);
    });
    let lines = Lines::default();
    let subscriber = tracing_subscriber::fmt()
        .with_ansi(false)
        .without_time()
        .with_writer(lines.clone())
        .finish();
    let returned = tracing::subscriber::with_default(subscriber, act);
    let text = String::from_utf8(lines.0.lock().unwrap().clone()).unwrap();
    (returned, text)
}
