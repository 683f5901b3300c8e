//! What a client makes of the frames that answer its Hello: `data/client/cases.json`, which both
//! clients are run against.

use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener};
use std::thread::JoinHandle;

use gantry_tau_core::control::wire::PROTOCOL_VERSION;
use serde::Deserialize;

use crate::DEADLINE;
use crate::client::crc32;
use crate::server_fixture::LOOPBACK;

/// The list.
#[derive(Debug, Deserialize)]
pub struct Cases {
    /// Length of the client's cycle, µs.
    pub cycle_us: u32,
    /// Checksum of the client's kinematic parameters.
    pub checksum: u32,
    kinds: Named<u8>,
    bodies: Named<String>,
    /// The cases.
    pub cases: Vec<Case>,
}

#[derive(Debug, Deserialize)]
struct Named<T> {
    welcome: T,
    state: T,
    refusal: T,
}

impl<T> Named<T> {
    fn get(&self, name: &str) -> &T {
        match name {
            "welcome" => &self.welcome,
            "state" => &self.state,
            "refusal" => &self.refusal,
            other => panic!("no frame {other}"),
        }
    }
}

/// Frames that answer a Hello, and the exit code of the client that reads them.
#[derive(Debug, Deserialize)]
pub struct Case {
    /// Speciality of the case.
    pub name: String,
    frames: Vec<CaseFrame>,
    /// Exit code.
    pub exit_code: u8,
}

/// A frame, by its differences from a good one.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CaseFrame {
    of: String,
    #[serde(default)]
    set: Vec<(usize, String)>,
    #[serde(default)]
    cut: usize,
    #[serde(default)]
    add: String,
    kind: Option<u8>,
    magic: Option<String>,
    version: Option<u8>,
    length: Option<u16>,
    suite: Option<u16>,
    /// Reason and detail of a notice, which is sent in place of the frame.
    notice: Option<[u8; 2]>,
    #[serde(default)]
    broken: bool,
}

/// Exit code of a client whose server vanishes: here, once it has answered.
const VANISHED: u8 = 7;
/// Bytes of a Hello, and below of a Command for three axes.
const HELLO: usize = 16;
const COMMAND: usize = 70;

impl Cases {
    /// Reads the list.
    #[must_use]
    pub fn read() -> Self {
        serde_json::from_str(include_str!("../data/client/cases.json")).unwrap()
    }

    fn bytes(&self, case: &Case) -> Vec<u8> {
        case.frames
            .iter()
            .flat_map(|frame| self.frame(frame))
            .collect()
    }

    fn frame(&self, frame: &CaseFrame) -> Vec<u8> {
        if let Some([reason, detail]) = frame.notice {
            let front = [b'G', b'T', 1, 7, 8, 0, reason, detail, 0, 0, 0, 0, 0, 0];
            return [&front[..], &crc32(&front).to_le_bytes()].concat();
        }
        let mut body = unhex(self.bodies.get(&frame.of));
        for (offset, bytes) in &frame.set {
            let bytes = unhex(bytes);
            body[*offset..][..bytes.len()].copy_from_slice(&bytes);
        }
        body.truncate(body.len() - frame.cut);
        body.extend(unhex(&frame.add));
        let mut bytes = frame.magic.as_deref().map_or_else(|| b"GT".to_vec(), unhex);
        bytes.push(frame.version.unwrap_or(PROTOCOL_VERSION));
        bytes.push(frame.kind.unwrap_or(*self.kinds.get(&frame.of)));
        bytes.extend(
            frame
                .length
                .unwrap_or(u16::try_from(body.len()).unwrap())
                .to_le_bytes(),
        );
        bytes.extend(frame.suite.unwrap_or(0).to_le_bytes());
        bytes.extend(body);
        let checksum = crc32(&bytes) ^ u32::from(frame.broken);
        bytes.extend(checksum.to_le_bytes());
        bytes
    }

    /// A server that answers one Hello as a case says. Joined, it returns what the client sent
    /// then.
    #[must_use]
    pub fn serve(&self, case: &Case) -> (SocketAddr, JoinHandle<Vec<u8>>) {
        let listener = TcpListener::bind(LOOPBACK).unwrap();
        let address = listener.local_addr().unwrap();
        let answer = self.bytes(case);
        let answers = case.exit_code == VANISHED;
        let serving = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            stream.set_read_timeout(Some(DEADLINE)).unwrap();
            stream.read_exact(&mut [0; HELLO]).unwrap();
            stream.write_all(&answer).unwrap();
            let mut said = Vec::new();
            if answers {
                said.resize(COMMAND, 0);
                stream.read_exact(&mut said).unwrap();
            }
            // A client that refuses does not hear that the server closes: it is the one to close.
            if answers {
                let _ = stream.shutdown(Shutdown::Write);
            }
            let _ = stream.read_to_end(&mut said);
            said
        });
        (address, serving)
    }

    /// Checks how the client of a case has ended, and what it has sent.
    ///
    /// # Panics
    /// Unless both are as the case says.
    pub fn check(case: &Case, exit_code: u8, sentence: &str, sent: &[u8]) {
        let Case {
            name,
            exit_code: expected,
            ..
        } = case;
        assert_eq!(exit_code, *expected, "{name}: {sentence}");
        assert_eq!(sentence.trim_end().lines().count(), 1, "{name}: {sentence}");
        let commands = sent
            .windows(4)
            .filter(|bytes| *bytes == [b'G', b'T', PROTOCOL_VERSION, 3])
            .count();
        if exit_code == VANISHED {
            assert_eq!(commands, 1, "{name}: {sentence}");
        } else {
            // A client that refuses has answered no more than the States before.
            let before = case
                .frames
                .split_last()
                .map_or(&[][..], |(_, before)| before);
            let states = before.iter().filter(|frame| frame.of == "state").count();
            assert!(
                commands <= states,
                "{name}: {commands} Commands; {sentence}"
            );
        }
    }
}

fn unhex(text: &str) -> Vec<u8> {
    (0..text.len())
        .step_by(2)
        .map(|place| u8::from_str_radix(&text[place..place + 2], 16).unwrap())
        .collect()
}
