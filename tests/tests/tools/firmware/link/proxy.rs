//! Proxy before the target: forwards every byte, and records every State before its client receives
//! it.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use gantry_tau_core::control::message::ServerMessage;
use gantry_tau_core::control::wire::{Deframer, Feed, decode_server};

use super::journal::Journal;
use super::{PATIENCE, State};

/// State of the proxy that its threads share.
#[derive(Default)]
struct Shared {
    states: Journal<State>,
    quit: AtomicBool,
    /// Both ends of every connection, to be shut at the end.
    open: Mutex<Vec<TcpStream>>,
}

/// The proxy; closes everything when dropped.
pub(super) struct Proxy {
    /// Address for clients.
    pub(super) address: SocketAddr,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Proxy {
    /// Starts a proxy before `target`.
    pub(super) fn before(target: SocketAddr) -> Self {
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let listener = TcpListener::bind(any).unwrap();
        listener.set_nonblocking(true).unwrap();
        let address = listener.local_addr().unwrap();
        let shared = Arc::new(Shared::default());
        let accepting = Arc::clone(&shared);
        let thread = std::thread::spawn(move || accept(&listener, target, &accepting));
        Self {
            address,
            shared,
            thread: Some(thread),
        }
    }

    /// Waits for the first State that fulfils the condition.
    pub(super) fn await_state(&self, what: &str, is_it: impl Fn(&State) -> bool) -> State {
        self.shared.states.find(what, is_it).unwrap()
    }

    /// Returns every State so far.
    pub(super) fn states(&self) -> Vec<State> {
        self.shared.states.entries()
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        self.shared.quit.store(true, Ordering::Relaxed);
        for stream in self.shared.open.lock().unwrap().iter() {
            let _ = stream.shutdown(Shutdown::Both);
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn accept(listener: &TcpListener, target: SocketAddr, shared: &Arc<Shared>) {
    while !shared.quit.load(Ordering::Relaxed) {
        let Ok((client, _)) = listener.accept() else {
            std::thread::sleep(Duration::from_millis(5));
            continue;
        };
        client.set_nonblocking(false).unwrap();
        let target = TcpStream::connect_timeout(&target, PATIENCE).unwrap();
        for stream in [&client, &target] {
            stream.set_nodelay(true).unwrap();
            shared
                .open
                .lock()
                .unwrap()
                .push(stream.try_clone().unwrap());
        }
        let (from, to) = (client.try_clone().unwrap(), target.try_clone().unwrap());
        std::thread::spawn(move || forward(from, to, |_| {}));
        let shared = Arc::clone(shared);
        let mut deframer = Deframer::new();
        std::thread::spawn(move || {
            forward(target, client, |bytes| shared.listen(&mut deframer, bytes));
        });
    }
}

/// Forwards one direction until its sender has closed.
fn forward(mut from: TcpStream, mut to: TcpStream, mut first: impl FnMut(&[u8])) {
    let mut buffer = [0; 4_096];
    while let Ok(count @ 1..) = from.read(&mut buffer) {
        first(&buffer[..count]);
        if to.write_all(&buffer[..count]).is_err() {
            break;
        }
    }
    let _ = to.shutdown(Shutdown::Write);
}

impl Shared {
    fn listen(&self, deframer: &mut Deframer, mut bytes: &[u8]) {
        loop {
            match deframer.feed(bytes) {
                Feed::Incomplete => return,
                Feed::Frame { frame, consumed } => {
                    if let ServerMessage::State(state) = decode_server(&frame).unwrap() {
                        self.states.push(state);
                    }
                    bytes = &bytes[consumed..];
                }
                Feed::Broken(error) => panic!("the target sent an invalid frame: {error}"),
            }
        }
    }
}
