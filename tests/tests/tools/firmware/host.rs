//! Playback on the host, by the firmware's sources.

use std::fs;
use std::mem::MaybeUninit;
use std::path::Path;

use gantry_tau_core::control::message::{Capabilities, Phase};
use gantry_tau_core::control::session::{Connection, Output};
use gantry_tau_core::model::nalgebra::Matrix3;
use gantry_tau_core::model::{f1, l2};
use gantry_tau_machine::robot_file::RobotFile;

use super::machine::{AXES, ControlCycle, CycleResult, Machine, Meter, Parts, robots};
use super::no_keys;
use super::recording::{self, MAX_RECORD, Observer, Record, Room, Sink, Source};
use super::traffic::{self, Serve};

/// Outcome of a recording.
pub(crate) struct Played {
    /// The outcome.
    pub(crate) output: Vec<u8>,
    /// Observations of every cycle.
    pub(crate) seen: Seen,
}

/// Observations of every cycle.
#[derive(Default)]
pub(crate) struct Seen {
    /// Phase after it.
    pub(crate) phases: Vec<Phase>,
    /// Its floats.
    pub(crate) floats: Vec<Floats>,
    /// Most frames of non-owners that a State counted.
    pub(crate) not_authentic: u32,
}

/// Kinematics of a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Floats {
    /// The L2's.
    L2,
    /// The F1's, with an error.
    F1Error,
    /// The F1's.
    F1 {
        /// Largest turn of a plate, rad.
        turned_rad: f64,
    },
}

/// Returns the float part of a machine. It is never freed: some kilobytes per machine.
pub(crate) fn control_cycle() -> &'static mut ControlCycle {
    ControlCycle::write(Box::leak(Box::new(MaybeUninit::uninit()))).unwrap()
}

/// Plays a recording on a server.
pub(crate) fn play(recording: &[u8], serve: Serve) -> Played {
    try_play(recording, serve).expect("the recording is valid")
}

/// Plays a recording; `None` if it is invalid.
fn try_play(recording: &[u8], serve: Serve) -> Option<Played> {
    let (mut source, mut room) = (Bytes(recording), Room::EMPTY);
    let nominal = recording::start(&mut room, &mut source)?;
    let mut machine = Machine::new(
        Parts::new(control_cycle(), Capabilities::NONE, nominal).unwrap(),
        serve,
    );
    let (mut output, mut seen) = (Vec::new(), Seen::default());
    recording::play(&mut machine, &mut room, &mut source, &mut output, &mut seen)?;
    assert!(source.0.is_empty(), "nothing follows the end");
    Some(Played { output, seen })
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

impl Meter for Seen {}

impl Observer for Seen {
    fn computed(&mut self, result: &CycleResult<'_>) {
        self.floats.push(match result {
            CycleResult::L2(_) => Floats::L2,
            CycleResult::F1(Err(_)) => Floats::F1Error,
            CycleResult::F1(Ok(result)) => {
                let [.., q4, q5, q6] = result.q.value;
                let turned_rad = q4.abs().max(q5.abs()).max(q6.abs());
                Floats::F1 { turned_rad }
            }
        });
    }

    fn ticked(&mut self, output: Option<&Output<AXES>>, _: &[Connection]) {
        let state = &output.unwrap().state;
        self.phases.push(state.phase);
        self.not_authentic = self.not_authentic.max(state.counters.non_owner);
    }
}

/// A recording leads to the outcome of the live play.
pub(crate) fn recordings_replay() {
    for recording in traffic::all().into_iter().chain(traffic::keyed()) {
        assert!(
            play(&recording.bytes, recording.serve).output == recording.output,
            "{}: played otherwise than recorded",
            recording.name
        );
    }
}

/// True if a recording is played that has `more` before its first cycle.
fn is_played(begun: &[u8], more: &[u8], cycle: &[u8]) -> bool {
    let end = traffic::encode(&Record::End);
    try_play(&[begun, more, cycle, &end].concat(), no_keys::server).is_some()
}

/// Playback refuses a cycle in which more arrives than its budget, and what is not a recording.
pub(crate) fn excess_is_refused() {
    let mut rest = traffic::calm().bytes.as_slice();
    // The start, a stream, its Hello, the first cycle.
    let records: Vec<&[u8]> = std::iter::from_fn(|| {
        let length = usize::from(u16::from_le_bytes(*rest.first_chunk()?));
        let (record, more) = rest.split_at(length + 2);
        rest = more;
        Some(record)
    })
    .take(4)
    .collect();
    let [start, open, hello, cycle] = records[..] else {
        panic!("{} records", records.len());
    };
    let begun = [start, open, hello].concat();
    assert!(is_played(&begun, &[], cycle));
    for (count, is_allowed) in [(128 - 16, true), (128 - 15, false)] {
        let bytes = traffic::encode(&Record::Bytes(Connection(0), &[0; MAX_RECORD][..count]));
        assert_eq!(
            is_played(&begun, &bytes, cycle),
            is_allowed,
            "{count} bytes"
        );
    }
    // Nor does it take a recording that is cut, or a cycle with a kind or a flag that does not
    // exist.
    for kept in 0..cycle.len() {
        assert!(
            try_play(
                &[start, open, hello, &cycle[..kept]].concat(),
                no_keys::server
            )
            .is_none(),
            "{kept} bytes of a cycle"
        );
    }
    // Numbers of stop, rearm, motion, reading and last write.
    let numbers = [2, 3, 4, 5, 6 + 6 + 18].map(|number| 3 + 8 * number);
    for at in [2].into_iter().chain(numbers) {
        let mut damaged = cycle.to_vec();
        damaged[at] = 9;
        assert!(!is_played(&begun, &damaged, cycle), "byte {at} of a cycle");
    }
    assert!(!is_played(&begun, open, cycle), "a second connection");
    assert!(
        try_play(&[start, open].concat(), no_keys::server).is_none(),
        "no end"
    );
}

/// The constants of the firmware, which reads no files, are those of the files.
pub(crate) fn machines_are_those_of_the_files() {
    let (f1, springs) = robots::f1().unwrap();
    let file = RobotFile::builtin_f1().unwrap();
    assert_eq!(
        f1::Kinematics::new(&f1).checksum(&robots::F1_METRES_PER_Q),
        file.checksum()
    );
    assert_eq!(Some(springs), file.compliances);
    let parameters = robots::parameters(0, Capabilities::NONE).unwrap();
    for (ours, theirs) in parameters.axes.iter().zip(&file.limits) {
        assert_eq!(ours.limits, theirs.limits);
    }
    let (l2, springs) = robots::l2().unwrap();
    let file = RobotFile::builtin_l2().unwrap();
    assert_eq!(
        l2::Kinematics::new(&l2, &Matrix3::identity())
            .unwrap()
            .checksum(&[1.0; l2::AXES]),
        file.checksum()
    );
    assert_eq!(Some(springs), file.compliances);
}

/// Bit-equality stands on equal arithmetic: the lock files of host and firmware name the same
/// versions of what computes.
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
    for name in ["libm", "nalgebra", "simba", "crc32fast", "heapless", "sha2"] {
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
