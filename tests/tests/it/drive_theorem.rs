//! T21, the drive's theorem, over every machine that a server moves: what is in force at a drive
//! changes by at most S per tick, and nothing is granted or ended while it is not zero, for any
//! refused writes and failed readings. Proved of core; here it is asked of the plants.
//!
//! One more machine is one more test in [`machines`]: a plant in [`Watched`], or a [`Bench`] that
//! looks at its drives itself.

mod machines;
mod watched;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::control::message::{Mode, Phase};
use gantry_tau_core::control::session::config::Config;
use gantry_tau_core::units::EpochRange;
use gantry_tau_server::plant::Plant;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::cycle::{Cycle, OperatorInputs};
use gantry_tau_server::state::StopLatch;
use gantry_tau_tests::client::{Client, Noise};
use gantry_tau_tests::server_fixture::{LOOPBACK, await_bytes};

/// Largest offset that the client asks for, in steps of its axis, and nm.
const STEPS: i32 = 8;
const OFFSET_NM: i32 = 60_000;

/// Values in force at one motor's drive, seen at the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct AtDrive {
    axis: usize,
    /// Position reference, nm: what the drive follows.
    reference_nm: i64,
    /// The nominal reference in it, nm.
    nominal_nm: i64,
    offsets: Offsets,
}

/// Trouble of one cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    /// The references do not arrive.
    Write,
    /// The measurements do not arrive.
    Read,
}

/// The drives' side of a machine.
trait Bench<const N: usize> {
    /// Resolution of its positions, nm; offsets are exact.
    const RESOLUTION_NM: u64 = 0;

    /// Decides on the coming cycle.
    fn set(&mut self, trouble: Option<Trouble>);

    /// Returns what every motor's drive has in force.
    fn at_drives(&self) -> Vec<AtDrive>;

    /// Takes note of a tick; returns what it finds wrong.
    fn see(&mut self, row: &TickRecord<N>) -> Result<(), String> {
        let _ = row;
        Ok(())
    }
}

/// Events of a run, counted.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    /// Cycles with trouble.
    troubles: u32,
    /// Ticks in which the machine failed.
    failed: u32,
    granted: u32,
    refused: u32,
    /// Quits that ended at zero.
    quits: u32,
    /// Ticks in which an offset changed by S.
    whole_steps: u32,
    /// References of drives that were compared with core's.
    compared: u32,
}

impl Counts {
    /// Asserts that there was something of everything.
    fn assert_much(&self) {
        let least = [
            self.troubles / 200,
            self.failed / 200,
            self.granted / 10,
            self.refused / 50,
            self.quits / 2,
        ];
        assert!(
            least.iter().all(|count| *count > 0)
                && self.whole_steps > 200
                && self.compared > 10_000,
            "{self:?}"
        );
    }
}

/// A server on a machine with trouble, and its clients.
struct Run<const N: usize, const M: usize, P: Plant<N, M>, B> {
    config: Config<N>,
    cycle: Cycle<N, M, P>,
    bench: B,
    noise: Noise,
    owner: Option<Client<N>>,
    /// Clients that ask while another one has the session, or offsets are in force.
    others: Vec<Client<N>>,
    targets: [i32; N],
    quits: bool,
    rearms: bool,
    /// Cycles of trouble that are left; below zero: good ones until the next.
    trouble: i32,
    kind: Trouble,
    counts: Counts,
}

impl<const N: usize, const M: usize, P: Plant<N, M>, B: Bench<N>> Run<N, M, P, B> {
    fn new(config: Config<N>, motors: MotorMap<N, M>, plant: P, bench: B, seed: u64) -> Self {
        let cycle = Cycle::new(
            config,
            motors,
            plant,
            EpochRange::VOLATILE,
            StopLatch::volatile(),
            LOOPBACK,
        );
        let mut cycle = cycle.unwrap();
        cycle.start().unwrap();
        Self {
            config,
            cycle,
            bench,
            noise: Noise::new(seed),
            owner: None,
            others: Vec::new(),
            targets: [0; N],
            quits: false,
            rearms: false,
            trouble: -1,
            kind: Trouble::Write,
            counts: Counts::default(),
        }
    }

    /// Runs ticks. The error is the first thing that T21 does not allow.
    fn ticks(mut self, count: u32) -> Result<Counts, String> {
        for tick in 0..count {
            self.tick()
                .map_err(|error| format!("tick {tick}: {error}"))?;
        }
        Ok(self.counts)
    }

    fn tick(&mut self) -> Result<(), String> {
        self.make_trouble();
        let before = self.bench.at_drives();
        let answers = self.speak();
        self.cycle.receive();
        let operator = self.operator();
        let row = self.cycle.step(1, operator);
        let after = self.bench.at_drives();
        self.hear(&row, answers);
        self.counts.failed += u32::from(row.plant_failed);
        self.counts.refused += u32::from(row.refused);
        self.bench.see(&row)?;
        self.check(&row, &before, &after)
    }

    /// Up to four cycles in a row are bad ones, then at least one is good.
    fn make_trouble(&mut self) {
        self.trouble -= 1;
        if self.trouble < -1 && self.noise.below(40) == 0 {
            self.trouble = 1 + i32::try_from(self.noise.below(4)).unwrap();
            self.kind = if self.noise.below(2) == 0 {
                Trouble::Write
            } else {
                Trouble::Read
            };
        }
        let is_bad = self.trouble > 0;
        self.counts.troubles += u32::from(is_bad);
        self.bench.set(is_bad.then_some(self.kind));
    }

    /// The clients say something, and the owner's answer arrives. True if there was one.
    fn speak(&mut self) -> bool {
        let has_session = matches!(
            self.cycle.phase(),
            Phase::Handshake | Phase::Submit | Phase::Obtain
        );
        if self.cycle.phase() == Phase::Listening {
            if self.owner.is_none() {
                self.others.clear();
                let mut client = Client::connect(self.cycle.address().unwrap());
                client.say_hello();
                self.owner = Some(client);
            }
            return false;
        }
        if self.noise.below(30) == 0 {
            let mut other = Client::connect(self.cycle.address().unwrap());
            other.say_hello();
            self.others.push(other);
            self.others.drain(..self.others.len().saturating_sub(4));
        }
        if !has_session || self.noise.below(250) == 0 {
            self.owner = None;
        }
        let Some(owner) = &mut self.owner else {
            return false;
        };
        if self.noise.below(20) == 0 {
            for (target, axis) in self.targets.iter_mut().zip(&self.config.parameters().axes) {
                let step = axis.limits.position.step();
                let most = STEPS.min(OFFSET_NM / step);
                let steps = i32::try_from(self.noise.below(usize::try_from(2 * most + 1).unwrap()))
                    .unwrap()
                    - most;
                *target = steps * step;
            }
        }
        let mode = if self.cycle.phase() == Phase::Handshake {
            Mode::Submit
        } else {
            Mode::Obtain
        };
        let frame = owner.frame(mode, self.targets);
        owner.send_bytes(&frame);
        await_bytes(&mut self.cycle, frame.len());
        true
    }

    fn hear(&mut self, row: &TickRecord<N>, answered: bool) {
        let Some(owner) = &mut self.owner else { return };
        if row.welcomed {
            owner.welcome();
        }
        if row.welcomed || answered {
            assert_eq!(owner.state(), row.state);
        }
    }

    /// Presses: a quit now and then, until zero is in force; a re-arm some time after a stop, until
    /// the server listens.
    fn operator(&mut self) -> OperatorInputs {
        match self.cycle.phase() {
            Phase::Obtain => self.quits |= self.noise.below(150) == 0,
            Phase::Fault => self.rearms |= !self.quits && self.noise.below(50) == 0,
            _ => {}
        }
        self.rearms &= self.cycle.phase() == Phase::Fault;
        OperatorInputs {
            quit: self.quits,
            rearm: self.rearms,
            ..OperatorInputs::default()
        }
    }

    fn check(
        &mut self,
        row: &TickRecord<N>,
        before: &[AtDrive],
        after: &[AtDrive],
    ) -> Result<(), String> {
        let is_zero =
            |drives: &[AtDrive]| drives.iter().all(|drive| drive.offsets == Offsets::ZERO);
        self.counts.granted += u32::from(row.welcomed);
        if row.welcomed && !(is_zero(before) && is_zero(after)) {
            return Err(format!("granted with {before:?}"));
        }
        if self.cycle.is_at_zero() {
            if !is_zero(after) {
                return Err(format!("a quit would end with {after:?}"));
            }
            self.counts.quits += u32::from(self.quits);
            self.quits = false;
        }
        // What the drives have is what core gave out, and nothing else.
        for drive in after.iter().filter(|_| !row.plant_failed) {
            let given = row.references[drive.axis];
            let offsets = Offsets {
                position: row.state.axes[drive.axis].offsets.position,
                velocity: given.velocity_offset,
                torque: given.torque_offset,
            };
            let is_rounded = drive.reference_nm.abs_diff(given.position.0) <= B::RESOLUTION_NM;
            if !is_rounded || drive.offsets != offsets {
                return Err(format!(
                    "core gave out {given:?}, and the drive has {drive:?}"
                ));
            }
            self.counts.compared += 1;
        }
        let mut is_whole = false;
        for (before, after) in before.iter().zip(after) {
            let limits = &self.config.parameters().axes[after.axis].limits;
            let changes = [
                (
                    after.offsets.position.0.abs_diff(before.offsets.position.0),
                    limits.position.step(),
                ),
                (
                    after.offsets.velocity.0.abs_diff(before.offsets.velocity.0),
                    limits.velocity.step(),
                ),
                (
                    after
                        .offsets
                        .torque
                        .0
                        .abs_diff(before.offsets.torque.0)
                        .into(),
                    limits.torque.step(),
                ),
            ];
            let [(moved, step), ..] = changes;
            is_whole |= moved == step.unsigned_abs();
            let most =
                u64::from(step.unsigned_abs()) + after.nominal_nm.abs_diff(before.nominal_nm);
            let is_far = after.reference_nm.abs_diff(before.reference_nm) > most;
            if is_far
                || changes
                    .iter()
                    .any(|(change, step)| *change > step.unsigned_abs())
            {
                return Err(format!(
                    "from {before:?} to {after:?}, in {:?}",
                    row.state.phase
                ));
            }
        }
        self.counts.whole_steps += u32::from(is_whole);
        Ok(())
    }
}
