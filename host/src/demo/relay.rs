//! A cable that can be pulled: forwards between client and server until it is cut, then keeps both sockets open and says nothing.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// How long a thread waits before it looks at its switches again.
const LOOK: Duration = Duration::from_millis(5);

#[derive(Debug, Default)]
struct Switches {
    cut: AtomicBool,
    quit: AtomicBool,
}

/// A relay for one client. Dropping it closes both sockets.
#[derive(Debug)]
pub struct Relay {
    /// Where the client connects.
    pub address: SocketAddr,
    switches: Arc<Switches>,
    thread: Option<JoinHandle<()>>,
}

impl Relay {
    /// Listens on a free loopback port and forwards to `server`.
    ///
    /// # Errors
    /// When there is no port or no thread.
    pub fn spawn(server: SocketAddr) -> io::Result<Self> {
        let listener = TcpListener::bind(("127.0.0.1", 0))?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let switches = Arc::new(Switches::default());
        let shared = Arc::clone(&switches);
        let thread = std::thread::Builder::new()
            .name("relay".to_owned())
            .spawn(move || {
                // Both sockets live as long as this thread, whatever is forwarded.
                let _open = serve(&listener, server, &shared);
                while !shared.quit.load(Ordering::Relaxed) {
                    std::thread::sleep(LOOK);
                }
            })?;
        Ok(Self {
            address,
            switches,
            thread: Some(thread),
        })
    }

    /// Pulls the cable.
    pub fn cut(&self) {
        self.switches.cut.store(true, Ordering::Relaxed);
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.switches.cut.store(true, Ordering::Relaxed);
        self.switches.quit.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panicking relay has already said so on stderr.
            let _ = thread.join();
        }
    }
}

/// Waits for the client, connects to the server, forwards both ways until cut; returns the sockets, still open.
fn serve(
    listener: &TcpListener,
    server: SocketAddr,
    switches: &Arc<Switches>,
) -> io::Result<(TcpStream, TcpStream)> {
    let client = loop {
        match listener.accept() {
            Ok((client, _)) => break client,
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            Err(error) => return Err(error),
        }
        if switches.quit.load(Ordering::Relaxed) {
            return Err(ErrorKind::Interrupted.into());
        }
        std::thread::sleep(LOOK);
    };
    let server = TcpStream::connect(server)?;
    for stream in [&client, &server] {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(LOOK))?;
    }
    let (from, to) = (client.try_clone()?, server.try_clone()?);
    let shared = Arc::clone(switches);
    let up = std::thread::Builder::new()
        .name("relay up".to_owned())
        .spawn(move || forward(from, to, &shared))?;
    forward(server.try_clone()?, client.try_clone()?, switches);
    let _ = up.join();
    Ok((client, server))
}

fn forward(mut from: TcpStream, mut to: TcpStream, switches: &Switches) {
    // Without the privilege the link is a little slower; the demo measures whether that matters.
    let _ = crate::realtime::raise_priority();
    let mut buffer = [0; 4_096];
    while !switches.cut.load(Ordering::Relaxed) {
        match from.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => {
                let bytes = buffer.get(..count).unwrap_or_default();
                if switches.cut.load(Ordering::Relaxed) || to.write_all(bytes).is_err() {
                    break;
                }
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => break,
        }
    }
    // A side that ended by itself ends the other; a cut cable ends nothing.
    if !switches.cut.load(Ordering::Relaxed) {
        let _ = to.shutdown(std::net::Shutdown::Both);
    }
}
