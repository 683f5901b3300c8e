//! The same driver on the host.

use std::fs;
use std::path::Path;

use gantry_tau::model::Model;
use gantry_tau::robot_file::RobotFile;
use gantry_tau_core::endpoint::Turn;
use gantry_tau_core::message::{Capabilities, Phase};

use crate::machine::{AXES, MOTORS, Machine, Meter, Part, Parts, robots};
use crate::reading::OF_OWNER;
use crate::recording::{self, Sink, Source, Watch};
use crate::traffic;

/// What a recording leads to.
pub(crate) struct Played {
    /// The output.
    pub(crate) output: Vec<u8>,
    /// The phase after every tick.
    pub(crate) phases: Phases,
}

/// The phase after every tick.
#[derive(Default)]
pub(crate) struct Phases(pub(crate) Vec<Phase>);

/// Plays a recording.
pub(crate) fn play(recording: &[u8]) -> Played {
    let mut source = Bytes(recording);
    let nominal = recording::start(&mut source).unwrap();
    let mut machine = Machine::new(Parts::new(Capabilities::NONE, nominal).unwrap());
    let mut output = Vec::new();
    let mut phases = Phases::default();
    let room = &mut [0; OF_OWNER];
    let played = recording::play(&mut machine, room, &mut source, &mut output, &mut phases);
    assert!(
        played.is_some() && source.0.is_empty(),
        "the recording is whole"
    );
    Played { output, phases }
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

impl Meter for Phases {
    fn begin(&mut self) {}
    fn end(&mut self, _: Part) {}
}

impl Watch for Phases {
    fn wait(&mut self) {}
    fn turned(&mut self, turn: &Turn<AXES, MOTORS>) {
        self.0.push(turn.output.state.phase);
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
