//! One connection of a browser, in a thread of its own: a request, its answer, the end.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::{Duration, Instant};

use super::hub::{Hub, Shared, StatusAnswer};
use super::page::{FIELDS, page};
use super::request::{MAX_HEAD, Refusal, Resource, resource};

/// Longest time that a request takes to come.
const REQUEST: Duration = Duration::from_secs(2);
/// Longest time that a reader takes for one picture.
const PATIENCE: Duration = Duration::from_secs(2);
/// Longest time, and most bytes, that are read after a refusal, so that the peer sees it.
const REST: Duration = Duration::from_millis(500);
const MAX_REST: usize = 1 << 18;
/// Bytes that the system keeps for a reader: some pictures, so that what a slow reader sees is not
/// old.
const SEND_BUFFER: usize = 32 * 1024;

/// Answers one request.
pub(super) fn serve(mut stream: TcpStream, hub: &Hub) {
    let asked = match request(&mut stream) {
        Ok(asked) => asked,
        // The peer has gone.
        Err(_) => return,
    };
    // A peer that has gone, or does not read, is not an error of ours.
    let _ = match asked {
        Ok(Resource::Page) => {
            let (policy, page) = page();
            answer(
                &mut stream,
                "200 OK",
                "text/html; charset=utf-8",
                &policy,
                &page,
            )
        }
        Ok(Resource::Status) => send_status(&mut stream, hub),
        Ok(Resource::Live) => live(&mut stream, hub),
        Err(refusal) => refuse(&mut stream, refusal),
    };
}

/// Sends the object of `monitor --status`.
fn send_status(stream: &mut TcpStream, hub: &Hub) -> io::Result<()> {
    let status = hub.latest().status.clone();
    match status {
        StatusAnswer::Object(status) => {
            answer(stream, "200 OK", "application/json", "", &(status + "\n"))
        }
        StatusAnswer::Trouble(trouble) => refuse(stream, ("503 Service Unavailable", &trouble)),
    }
}

/// Reads the head of a request.
fn request(stream: &mut TcpStream) -> io::Result<Result<Resource, Refusal>> {
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    let local = stream.local_addr()?;
    let until = Instant::now() + REQUEST;
    let mut head = Vec::new();
    loop {
        let mut chunk = [0; 1_024];
        let room = MAX_HEAD.saturating_sub(head.len()).min(chunk.len());
        match read_until(stream, chunk.get_mut(..room).unwrap_or_default(), until) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => head.extend_from_slice(chunk.get(..count).unwrap_or_default()),
            Err(error) if error.kind() == ErrorKind::TimedOut => {
                return Ok(Err((
                    "408 Request Timeout",
                    "the request did not come within two seconds",
                )));
            }
            Err(error) => return Err(error),
        }
        match resource(&head, local) {
            Ok(None) => {}
            Ok(Some(asked)) => return Ok(Ok(asked)),
            Err(refusal) => return Ok(Err(refusal)),
        }
    }
}

/// Reads some bytes; `TimedOut` after `until`.
fn read_until(stream: &mut TcpStream, bytes: &mut [u8], until: Instant) -> io::Result<usize> {
    loop {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        stream.set_read_timeout(Some(left))?;
        match stream.read(bytes) {
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) => {}
            done => return done,
        }
    }
}

/// Writes all bytes; `TimedOut` for a reader that takes too long.
fn write_all(stream: &mut TcpStream, mut bytes: &[u8]) -> io::Result<()> {
    let until = Instant::now() + PATIENCE;
    while !bytes.is_empty() {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        stream.set_write_timeout(Some(left))?;
        match stream.write(bytes) {
            Ok(0) => return Err(ErrorKind::WriteZero.into()),
            Ok(count) => bytes = bytes.get(count..).unwrap_or_default(),
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

fn answer(
    stream: &mut TcpStream,
    status: &str,
    kind: &str,
    fields: &str,
    body: &str,
) -> io::Result<()> {
    let length = body.len();
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\n{FIELDS}{fields}\r\n"
    );
    write_all(stream, head.as_bytes())?;
    write_all(stream, body.as_bytes())
}

/// Refuses, and reads on for a moment: a connection closed with unread bytes is reset, and the
/// answer lost.
fn refuse(stream: &mut TcpStream, (status, reason): (&str, &str)) -> io::Result<()> {
    let allow = if status.starts_with("405") {
        "Allow: GET\r\n"
    } else {
        ""
    };
    answer(
        stream,
        status,
        "text/plain; charset=utf-8",
        allow,
        &format!("{reason}\n"),
    )?;
    stream.shutdown(Shutdown::Write)?;
    let until = Instant::now() + REST;
    let mut left = MAX_REST;
    let mut rest = [0; 4_096];
    while left > 0 {
        match read_until(stream, &mut rest, until)? {
            0 => break,
            count => left = left.saturating_sub(count),
        }
    }
    Ok(())
}

/// Sends pictures until the reader is gone or too slow, or the monitor ends.
fn live(stream: &mut TcpStream, hub: &Hub) -> io::Result<()> {
    socket2::SockRef::from(&*stream).set_send_buffer_size(SEND_BUFFER)?;
    let head = format!("HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\n{FIELDS}\r\n");
    write_all(stream, head.as_bytes())?;
    // A browser comes back after half a second.
    write_all(stream, b"retry: 500\n\n")?;
    write_all(stream, &hub.history())?;
    let mut machine = 0;
    let mut number = 0;
    let mut entry = 0;
    loop {
        let mut next: Vec<Shared> = Vec::new();
        {
            let latest = hub.after(number);
            if latest.has_ended {
                return Ok(());
            }
            if latest.machine_number != machine {
                machine = latest.machine_number;
                next.push(Shared::clone(&latest.machine));
            }
            if latest.last_entry != entry {
                entry = latest.last_entry;
                next.push(Shared::clone(&latest.events));
            }
            if latest.number != number {
                number = latest.number;
                next.push(Shared::clone(&latest.picture));
            }
        }
        for event in next {
            if let Err(error) = write_all(stream, &event) {
                if error.kind() == ErrorKind::TimedOut {
                    tracing::warn!(
                        "a reader of the page was dropped: it took no picture for two seconds"
                    );
                }
                return Err(error);
            }
        }
    }
}
