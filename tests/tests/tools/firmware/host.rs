//! The same driver on the host.

use std::fs;
use std::path::Path;

use gantry_tau::model::MachineKind;
use gantry_tau::robot_file::RobotFile;
use gantry_tau_core::control::endpoint::Turn;
use gantry_tau_core::control::message::{Capabilities, Phase};

use super::machine::{AXES, Answer, MOTORS, Machine, Meter, Part, Parts, robots};
use super::reading::OF_OWNER;
use super::recording::{self, Sink, Source, Watch};
use super::traffic;

/// What a recording leads to.
pub(crate) struct Played {
    /// The output.
    pub(crate) output: Vec<u8>,
    /// What every tick showed.
    pub(crate) seen: Seen,
}

/// What every tick showed.
#[derive(Default)]
pub(crate) struct Seen {
    /// The phase after it.
    pub(crate) phases: Vec<Phase>,
    /// Its floats.
    pub(crate) floats: Vec<Floats>,
}

/// Whose kinematics a tick had.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Floats {
    /// The L2's.
    L2,
    /// The F1's, without an answer.
    F1Refused,
    /// The F1's, answered.
    F1 {
        /// The farthest that a plate is turned, radians.
        turned_rad: f64,
    },
}

/// Plays a recording.
pub(crate) fn play(recording: &[u8]) -> Played {
    let mut source = Bytes(recording);
    let nominal = recording::start(&mut source).unwrap();
    let mut machine = Machine::new(Parts::new(Capabilities::NONE, nominal).unwrap());
    let mut output = Vec::new();
    let mut seen = Seen::default();
    let room = &mut [0; OF_OWNER];
    let played = recording::play(&mut machine, room, &mut source, &mut output, &mut seen);
    assert!(
        played.is_some() && source.0.is_empty(),
        "the recording is whole"
    );
    Played { output, seen }
}

struct Bytes<'a>(&'a [u8]);

impl Source for Bytes<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> bool {
        let Some((first, rest)) = self.0.split_at_checked(bytes.len()) else {
            return false;
        };
        bytes.copy_from_slice(first);
        self.0 = rest;
        true
    }
}

impl Sink for Vec<u8> {
    fn write(&mut self, bytes: &[u8]) {
        self.extend_from_slice(bytes);
    }
}

impl Meter for Seen {
    fn begin(&mut self) {}
    fn end(&mut self, _: Part) {}
}

impl Watch for Seen {
    fn wait(&mut self) {}
    fn answered(&mut self, answer: &Answer<'_>) {
        self.floats.push(match answer {
            Answer::L2(_) => Floats::L2,
            Answer::F1(Err(_)) => Floats::F1Refused,
            Answer::F1(Ok(answer)) => {
                let [.., q4, q5, q6] = answer.q.value;
                let turned_rad = q4.abs().max(q5.abs()).max(q6.abs());
                Floats::F1 { turned_rad }
            }
        });
    }
    fn turned(&mut self, turn: &Turn<AXES, MOTORS>) {
        self.phases.push(turn.output.state.phase);
    }
}

/// What was recorded live is what is played: the format loses nothing.
pub(crate) fn recordings_replay() {
    for recording in traffic::all() {
        assert!(
            play(&recording.bytes).output == recording.output,
            "{}: played otherwise than recorded",
            recording.name
        );
    }
}

/// A tick in which more arrives than is let in is no recording, on host and target.
pub(crate) fn what_is_too_much_is_refused() {
    let whole = &traffic::calm().bytes;
    let (start, ticks) = whole.split_at(AXES * 8 + 4);
    // The first tick: a stream is opened, a Hello of 14 bytes arrives; elapsed, stop, rearm, epoch, arrival, motion, pose and load.
    let (happened, rest) = ticks.split_at(2 + 7 + (7 + 14));
    let moment = &rest[..4 + 2 + 8 + 2 + 1 + 12 * 8];
    let plays = |more: &[&[u8]]| {
        let mut bytes = start[..AXES * 8].to_vec();
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend((2 + u16::try_from(more.len()).unwrap()).to_le_bytes());
        bytes.extend(&happened[2..]);
        bytes.extend(more.concat());
        bytes.extend(moment);
        let mut source = Bytes(&bytes);
        let nominal = recording::start(&mut source).unwrap();
        let mut machine = Machine::new(Parts::new(Capabilities::NONE, nominal).unwrap());
        let (room, seen) = (&mut [0; OF_OWNER], &mut Seen::default());
        recording::play(&mut machine, room, &mut source, &mut Vec::new(), seen).is_some()
    };
    let bytes_of_a_stranger = |count: u8| {
        let head = [3, 0, 0, 0, 0, count, 0];
        [head.to_vec(), vec![0; count.into()]].concat()
    };
    assert!(plays(&[]));
    assert!(plays(&[&bytes_of_a_stranger(128 - 14)]));
    assert!(!plays(&[&bytes_of_a_stranger(128 - 13)]));
    assert!(!plays(&[&[0, 1, 0, 0, 0, 0, 0]]), "a second connection");
}

/// A target reads no files; its constants are those of the files.
pub(crate) fn machines_are_those_of_the_files() {
    let (f1, springs) = robots::f1().unwrap();
    let file = RobotFile::builtin_f1().unwrap();
    assert_eq!(f1.kinematics_checksum(), file.model.checksum());
    assert_eq!(Some(springs), file.compliances);
    let parameters = robots::parameters(0, Capabilities::NONE).unwrap();
    for (ours, theirs) in parameters.axes.iter().zip(&file.limits) {
        let ours = [
            ours.limits.position,
            ours.limits.velocity,
            ours.limits.torque,
        ];
        for (ours, theirs) in ours
            .iter()
            .zip([theirs.position, theirs.velocity, theirs.torque])
        {
            assert_eq!(i64::from(ours.ramp()), i64::from(theirs.ramp));
            let theirs = [theirs.max, theirs.step, theirs.accel].map(i64::from);
            let ours = [ours.max(), ours.step(), ours.accel()].map(i64::from);
            assert_eq!(ours, theirs);
        }
    }
    let (l2, springs) = robots::l2().unwrap();
    let file = RobotFile::builtin_l2().unwrap();
    assert_eq!(l2.kinematics_checksum(), file.model.checksum());
    assert_eq!(Some(springs), file.compliances);
}

/// Bit-equality stands on equal arithmetic: the lock files of host and firmware name the same versions of what computes.
pub(crate) fn same_mathematics() {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    let [host, firmware] = [
        tests.join("../Cargo.lock"),
        tests.join("firmware/Cargo.lock"),
    ]
    .map(|path| {
        fs::read_to_string(path)
            .unwrap()
            .parse::<toml::Table>()
            .unwrap()
    });
    for name in ["libm", "nalgebra", "simba", "crc32fast", "heapless"] {
        let [host, firmware] = [&host, &firmware].map(|lock| {
            let packages = lock["package"].as_array().unwrap().iter();
            let versions = packages.filter(|package| package["name"].as_str() == Some(name));
            versions
                .map(|package| package["version"].to_string())
                .collect::<Vec<_>>()
        });
        assert!(
            !host.is_empty() && host == firmware,
            "{name}: {host:?} and {firmware:?}"
        );
    }
}
