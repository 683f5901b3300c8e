//! Recordings on the target.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use super::budget::{self, Measured};
use super::emulator::{self, Build};
use super::host;
use super::image;
use super::recording::Record;
use super::traffic::{self, Recording};

/// Outcome of a recording on the target.
struct Played {
    output: Vec<u8>,
    laps: Laps,
    place: PathBuf,
    image: PathBuf,
}

/// A changed bit of the last pose, some 1e-12 m, changes the outcome, on host and target in the
/// same way.
pub(crate) fn a_changed_bit_is_seen() {
    let recording = traffic::calm();
    let mut bytes = recording.bytes.clone();
    // The last record is the end, the one before ends with twelve numbers, pose and load; bit 20 of
    // the first.
    let end = traffic::encode(&Record::End).len();
    let at = bytes.len() - end - 12 * 8 + 2;
    bytes[at] ^= 1 << 4;
    let played = play(
        Build::M7,
        &emulator::images(Build::M7, &[]),
        "changed_bit",
        &bytes,
    );
    assert_eq!(played.output.len(), recording.output.len());
    let before_the_last_tick = recording.output.len() - 1_000;
    assert_eq!(
        first_difference(&played.output, &recording.output).map(|at| at > before_the_last_tick),
        Some(true),
        "the bit is seen, and where it is"
    );
    assert_eq!(
        first_difference(&played.output, &host::play(&bytes, recording.serve).output),
        None
    );
}

/// The log of the calm session is `golden.txt`.
pub(crate) fn log_tells_the_session() {
    let played = play(
        Build::M7,
        &emulator::images(Build::M7, &[]),
        "log",
        &traffic::calm().bytes,
    );
    let log = emulator::decode(&played.image, &played.place.join("console"));
    let golden = emulator::folder().join("golden.txt");
    if budget::recording() {
        fs::write(&golden, &log).unwrap();
    }
    assert_eq!(
        log,
        fs::read_to_string(&golden).unwrap(),
        "the log is not that of golden.txt"
    );
}

/// Compares every reference, every frame and every float, and judges the cost.
pub(crate) fn is_bit_equal(build: Build, recording: &Recording) {
    let measured = measure(build, &image::all(build), recording);
    budget::judge(build, recording.name, &measured);
}

/// Plays a recording on the image in a folder, and compares every byte with the host. Returns the
/// cost and a digest of the output.
pub(crate) fn measure(build: Build, images: &Path, recording: &Recording) -> Measured {
    let played = play(build, images, recording.name, &recording.bytes);
    let expected = host::play(&recording.bytes, recording.serve).output;
    if let Some(at) = first_difference(&played.output, &expected) {
        panic!(
            "{} on {}: differs from the host from byte {at} of {}",
            recording.name,
            build.name(),
            expected.len()
        );
    }
    println!(
        "{} on {}: {} bytes are equal",
        recording.name,
        build.name(),
        expected.len()
    );
    let mut measured = played.laps.measured(recording);
    measured.insert(
        "output_crc32".to_owned(),
        i64::from(gantry_tau_tests::client::crc32(&expected)),
    );
    measured
}

fn first_difference(one: &[u8], other: &[u8]) -> Option<usize> {
    let differing = one.iter().zip(other).position(|(one, other)| one != other);
    differing.or_else(|| (one.len() != other.len()).then(|| one.len().min(other.len())))
}

fn play(build: Build, images: &Path, name: &str, recording: &[u8]) -> Played {
    let image = images.join("firmware");
    let place = emulator::place(&format!("replay-{}-{name}", build.name()));
    fs::write(place.join("replay.in"), recording).unwrap();
    emulator::run(build, &image, &place);
    Played {
        output: fs::read(place.join("replay.out")).unwrap(),
        laps: Laps::read(&fs::read(place.join("replay.laps")).unwrap()),
        place,
        image,
    }
}

/// Instructions of every cycle, by part, and the stack.
struct Laps {
    ticks: Vec<[u32; 3]>,
    /// High-water marks of the stack: of the start, and of the cycles.
    stack: [u32; 2],
}

/// Name of a part of a tick, and its share of the counts.
type Part = (&'static str, fn(&[u32; 3]) -> u32);

/// Parts of a tick.
const PARTS: [Part; 4] = [
    ("tick", |parts| parts.iter().sum()),
    ("feed", |parts| parts[0]),
    ("floats", |parts| parts[1]),
    ("server", |parts| parts[2]),
];

impl Laps {
    fn read(bytes: &[u8]) -> Self {
        let numbers: Vec<u32> = bytes
            .chunks_exact(4)
            .map(|four| u32::from_le_bytes(four.try_into().unwrap()))
            .collect();
        let (cycles, stack) = numbers.split_last_chunk().unwrap();
        // A cycle of the board's clock takes 40 ns, an instruction 32 ns.
        let ticks = cycles
            .chunks_exact(3)
            .map(|parts| [parts[0], parts[1], parts[2]].map(|cycles| cycles + cycles / 4));
        Self {
            ticks: ticks.collect(),
            stack: *stack,
        }
    }

    /// Returns worst and mean of each part, for each machine. A tick that greets under a key counts by
    /// itself.
    fn measured(&self, recording: &Recording) -> Measured {
        let Recording { f1, greetings, .. } = recording;
        assert_eq!(
            (self.ticks.len(), self.ticks.len()),
            (f1.len(), greetings.len())
        );
        let mut measured = BTreeMap::from([
            ("stack_start".to_owned(), i64::from(self.stack[0])),
            ("stack_ticks".to_owned(), i64::from(self.stack[1])),
        ]);
        for (machine, is_f1) in [("l2", false), ("f1", true)] {
            let of_machine = self.ticks.iter().zip(f1.iter().zip(greetings));
            let of_machine = of_machine.filter(|(_, (f1, _))| **f1 == is_f1);
            let (greetings, ticks): (Vec<_>, Vec<_>) =
                of_machine.partition(|(_, (_, greets))| **greets);
            let ticks: Vec<[u32; 3]> = ticks.iter().map(|(parts, _)| **parts).collect();
            if ticks.is_empty() {
                continue;
            }
            if let Some(worst) = greetings
                .iter()
                .map(|(parts, _)| parts.iter().sum::<u32>())
                .max()
            {
                measured.insert(format!("{machine}_greeting_worst"), worst.into());
            }
            for (what, of) in PARTS {
                let worst = ticks.iter().map(of).max().unwrap();
                let mean = ticks.iter().map(|parts| u64::from(of(parts))).sum::<u64>()
                    / ticks.len() as u64;
                measured.insert(format!("{machine}_{what}_worst"), worst.into());
                measured.insert(format!("{machine}_{what}_mean"), mean.try_into().unwrap());
            }
        }
        measured
    }
}
