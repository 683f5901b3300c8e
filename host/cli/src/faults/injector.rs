//! One direction of a connection, without sockets and clock: frames in at a logical time, bytes out
//! when they are due.

use std::collections::BTreeMap;
use std::time::Duration;

use gantry_tau_core::control::endpoint::Transport;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::plan::{FaultPlan, When};
use super::{Direction, Fault, FaultStats};

/// Bytes in transit above which a stream is not read.
const STREAM_FULL: usize = 1 << 18;
/// Bytes in transit above which a datagram is lost.
const DATAGRAMS_FULL: usize = 1 << 26;

/// Fault injector for one direction of one connection. Times count from the beginning of the
/// connection and never go back.
#[derive(Clone, Debug)]
pub struct FaultInjector {
    transport: Transport,
    /// Of this direction; of the script, the faults still to come.
    plan: FaultPlan,
    random: ChaCha8Rng,
    /// Pieces in transit by due time, then by order of insertion.
    in_transit: BTreeMap<(Duration, u64), Vec<u8>>,
    bytes: usize,
    pieces: u64,
    last_due: Duration,
    held_until: Duration,
    deaf_until: Duration,
    silent: bool,
    reset: bool,
    stats: FaultStats,
}

impl FaultInjector {
    /// The given direction of the connection with this number.
    #[must_use]
    pub fn new(
        plan: &FaultPlan,
        transport: Transport,
        connection: u64,
        direction: Direction,
    ) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(plan.seed);
        // Each direction draws from its own stream: what happens on one changes nothing on another.
        random.set_stream(2 * connection + u64::from(direction == Direction::Down));
        let mut plan = plan.clone();
        plan.script
            .retain(|entry| entry.direction.include(direction));
        if !plan.direction.include(direction) {
            plan = FaultPlan {
                script: plan.script,
                ..FaultPlan::default()
            };
        }
        Self {
            transport,
            plan,
            random,
            in_transit: BTreeMap::new(),
            bytes: 0,
            pieces: 0,
            last_due: Duration::ZERO,
            held_until: Duration::ZERO,
            deaf_until: Duration::ZERO,
            silent: false,
            reset: false,
            stats: FaultStats::default(),
        }
    }

    /// Adds a frame.
    pub fn push(&mut self, now: Duration, frame: &[u8]) {
        if self.silent || self.reset {
            return;
        }
        self.stats.frames += 1;
        // Drawn for every frame, so that a scripted fault does not change later draws.
        let drawn = self.draw();
        let later = self.plan.jitter.mul_f64(self.random.random());
        let due = now + self.plan.delay + later;
        match self.scripted(now).or(drawn) {
            None => self.send(due, frame.to_vec()),
            Some((fault, parameter)) => {
                self.stats.count(fault, now);
                self.inject(fault, parameter, now, due, frame.to_vec());
            }
        }
    }

    /// The next piece that is due.
    pub fn pop(&mut self, now: Duration) -> Option<Vec<u8>> {
        let first = self.in_transit.first_entry()?;
        if first.key().0 > now {
            return None;
        }
        let piece = first.remove();
        self.bytes -= piece.len();
        Some(piece)
    }

    /// Due time of the next piece.
    #[must_use]
    pub fn next_due(&self) -> Option<Duration> {
        self.in_transit.first_key_value().map(|(key, _)| key.0)
    }

    /// True if a stream must not be read now: it is stalled, or too much is in transit.
    #[must_use]
    pub fn is_deaf(&self, now: Duration) -> bool {
        now < self.deaf_until || self.bytes > STREAM_FULL
    }

    /// Makes this direction half-open: pieces not yet due and all later frames are lost.
    pub fn silence(&mut self, now: Duration) {
        self.silent = true;
        let lost = self.in_transit.split_off(&(now, u64::MAX));
        self.bytes -= lost.values().map(Vec::len).sum::<usize>();
    }

    /// True if this direction is half-open: it passes neither bytes nor a close.
    #[must_use]
    pub const fn is_silent(&self) -> bool {
        self.silent
    }

    /// True if both ends of the connection must be reset.
    #[must_use]
    pub const fn is_reset(&self) -> bool {
        self.reset
    }

    /// Frames and faults so far.
    #[must_use]
    pub const fn stats(&self) -> &FaultStats {
        &self.stats
    }

    /// The scripted fault whose moment has come; a fault of exactly this frame goes first.
    fn scripted(&mut self, now: Duration) -> Option<(Fault, Option<u32>)> {
        let this_frame = When::Frame(self.stats.frames);
        let script = &mut self.plan.script;
        let on_frame = script.iter().position(|entry| entry.when == this_frame);
        let index = on_frame.or_else(|| {
            let mut moments = script.iter().map(|entry| entry.when);
            moments.position(|when| matches!(when, When::Since(since) if since <= now))
        })?;
        let entry = script.remove(index);
        Some((entry.fault, entry.parameter))
    }

    fn draw(&mut self) -> Option<(Fault, Option<u32>)> {
        let mut left: f64 = self.random.random();
        let drawn = self.plan.rates.iter().find(|(_, rate)| {
            left -= rate.per_frame;
            left < 0.0
        });
        drawn.map(|(fault, rate)| (*fault, rate.parameter))
    }

    fn inject(
        &mut self,
        fault: Fault,
        parameter: Option<u32>,
        now: Duration,
        due: Duration,
        mut frame: Vec<u8>,
    ) {
        match fault {
            Fault::Drop => {}
            Fault::Duplicate => {
                for _ in 0..parameter.unwrap_or(1) {
                    self.send(due, frame.clone());
                }
                self.send(due, frame);
            }
            // Does not move `last_due`, so that later frames overtake it.
            Fault::Reorder => self.put(due.max(self.held_until) + duration(parameter, 2), frame),
            Fault::Corrupt => {
                let bit = self.index(parameter, 8 * frame.len());
                if let Some(byte) = frame.get_mut(bit / 8) {
                    *byte ^= 1 << (bit % 8);
                }
                self.send(due, frame);
            }
            Fault::Truncate => {
                frame.truncate(self.index(parameter, frame.len()));
                self.send(due, frame);
            }
            Fault::Split => {
                let first = self.index(parameter, frame.len());
                let rest = frame.split_off(first);
                self.send(due, frame);
                self.send(due, rest);
            }
            Fault::Burst | Fault::Stall => {
                self.held_until = self.held_until.max(now + duration(parameter, 10));
                if fault == Fault::Stall {
                    self.deaf_until = self.held_until;
                }
                self.send(due, frame);
            }
            Fault::HalfOpen => self.silence(now),
            Fault::Reset => {
                self.reset = true;
                self.in_transit.clear();
                self.bytes = 0;
            }
        }
    }

    /// The stated index, modulo the length of the frame, or a drawn one.
    fn index(&mut self, stated: Option<u32>, end: usize) -> usize {
        let end = end.max(1);
        match stated {
            Some(stated) => stated as usize % end,
            None => self.random.random_range(0..end),
        }
    }

    /// Adds a piece after all pieces sent before.
    fn send(&mut self, due: Duration, piece: Vec<u8>) {
        let due = due.max(self.held_until).max(self.last_due);
        self.last_due = due;
        self.put(due, piece);
    }

    fn put(&mut self, due: Duration, piece: Vec<u8>) {
        // A datagram may be empty.
        let skipped = match self.transport {
            Transport::Stream => piece.is_empty(),
            Transport::Datagram => self.bytes > DATAGRAMS_FULL,
        };
        if skipped {
            return;
        }
        self.bytes += piece.len();
        self.in_transit.insert((due, self.pieces), piece);
        self.pieces += 1;
    }
}

/// Duration of a parameter, ms, or a default.
fn duration(parameter: Option<u32>, default_ms: u32) -> Duration {
    Duration::from_millis(parameter.unwrap_or(default_ms).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::plan::{Directions, ScriptedFault};

    const MS: Duration = Duration::from_millis(1);

    fn injector(plan: &FaultPlan, transport: Transport) -> FaultInjector {
        FaultInjector::new(plan, transport, 0, Direction::Up)
    }

    fn scripted(
        when: When,
        direction: Directions,
        fault: Fault,
        parameter: Option<u32>,
    ) -> FaultPlan {
        let script = vec![ScriptedFault {
            when,
            direction,
            fault,
            parameter,
        }];
        FaultPlan {
            script,
            ..FaultPlan::default()
        }
    }

    /// A fault of frame 3, its parameter, and what it changes.
    type Case = (Fault, Option<u32>, fn(&mut Arrivals));

    /// Pieces as they came out, with their times in ms.
    type Arrivals = Vec<(u32, Vec<u8>)>;

    /// Output for ten frames `[n; 4]`, one per ms.
    fn played(mut link: FaultInjector) -> Arrivals {
        let mut seen = Vec::new();
        for ms in 1..40_u8 {
            if ms <= 10 && !link.is_deaf(MS * ms.into()) {
                link.push(MS * ms.into(), &[ms; 4]);
            }
            while let Some(piece) = link.pop(MS * ms.into()) {
                seen.push((ms.into(), piece));
            }
        }
        assert_eq!(link.next_due(), None);
        seen
    }

    fn undisturbed() -> Arrivals {
        (1..=10).map(|ms: u8| (ms.into(), vec![ms; 4])).collect()
    }

    #[test]
    fn a_harmless_link_only_forwards() {
        let plan = FaultPlan::default();
        assert_eq!(played(injector(&plan, Transport::Stream)), undisturbed());
        let other_way = scripted(When::Frame(3), Directions::Down, Fault::Drop, None);
        assert_eq!(
            played(injector(&other_way, Transport::Stream)),
            undisturbed()
        );
    }

    #[test]
    fn each_fault_has_its_effect_and_no_other() {
        let cases: [Case; 11] = [
            (Fault::Drop, None, |seen| drop(seen.remove(2))),
            (Fault::Duplicate, Some(2), |seen| {
                let third = seen[2].clone();
                seen.splice(2..2, [third.clone(), third]);
            }),
            (Fault::Corrupt, Some(17), |seen| seen[2].1[2] ^= 2),
            // Modulo the length.
            (Fault::Corrupt, Some(49), |seen| seen[2].1[2] ^= 2),
            (Fault::Truncate, Some(3), |seen| seen[2].1.truncate(3)),
            (Fault::Split, Some(3), |seen| {
                seen[2].1.truncate(3);
                seen.insert(3, (3, vec![3]));
            }),
            // Held back until 6 ms, where it is first: it was put there before frame 6.
            (Fault::Reorder, Some(3), |seen| {
                let late = seen.remove(2);
                seen.insert(4, (6, late.1));
            }),
            (Fault::Burst, Some(4), |seen| {
                seen[2..=5].iter_mut().for_each(|(ms, _)| *ms = 7)
            }),
            // Not read while it lasts, so 4, 5 and 6 never came in.
            (Fault::Stall, Some(4), |seen| {
                seen.drain(3..=5);
                seen[2].0 = 7;
            }),
            (Fault::HalfOpen, None, |seen| seen.truncate(2)),
            (Fault::Reset, None, |seen| seen.truncate(2)),
        ];
        for (fault, parameter, change) in cases {
            let transport = if fault == Fault::Reorder {
                Transport::Datagram
            } else {
                Transport::Stream
            };
            let mut expected = undisturbed();
            change(&mut expected);
            for (when, direction) in [
                (When::Frame(3), Directions::Up),
                (When::Since(3 * MS), Directions::Both),
            ] {
                let plan = scripted(when, direction, fault, parameter);
                assert_eq!(
                    played(injector(&plan, transport)),
                    expected,
                    "{fault} {parameter:?} {when:?}"
                );
            }
        }
    }

    #[test]
    fn a_reset_loses_what_is_in_transit() {
        let plan = scripted(When::Frame(3), Directions::Up, Fault::Reset, None);
        let mut link = injector(&plan, Transport::Stream);
        for _ in 0..3 {
            link.push(MS, b"x");
        }
        assert!(link.is_reset() && !link.is_silent());
        assert_eq!(played(link), []);
    }

    #[test]
    fn bytes_in_transit_are_bounded() {
        let plan = FaultPlan {
            delay: MS,
            ..FaultPlan::default()
        };
        let mut stream = injector(&plan, Transport::Stream);
        let mut datagrams = injector(&plan, Transport::Datagram);
        let largest = vec![0; 65_535];
        for _ in 0..1_100 {
            datagrams.push(MS, &largest);
            if !stream.is_deaf(MS) {
                stream.push(MS, &largest);
            }
        }
        assert!(stream.bytes <= STREAM_FULL + largest.len());
        assert!(datagrams.bytes <= DATAGRAMS_FULL + largest.len());
        assert!(datagrams.pop(2 * MS).is_some());
    }

    #[test]
    fn delay_and_jitter_keep_the_order() {
        let plan = FaultPlan {
            delay: 5 * MS,
            jitter: 7 * MS,
            seed: 3,
            ..FaultPlan::default()
        };
        let seen = played(injector(&plan, Transport::Datagram));
        let frames: Vec<_> = seen.iter().map(|(_, bytes)| bytes.clone()).collect();
        let sent: Vec<_> = undisturbed().into_iter().map(|(_, bytes)| bytes).collect();
        assert_eq!(frames, sent);
        let lateness: Vec<_> = (1..).zip(&seen).map(|(ms, (at, _))| at - ms).collect();
        assert!(
            lateness.iter().all(|ms| (5..=13).contains(ms)),
            "{lateness:?}"
        );
        assert!(lateness.iter().any(|ms| *ms != lateness[0]), "{lateness:?}");
    }

    /// Pieces of ten thousand frames of which a tenth is dropped and a fifth corrupted.
    fn run(seed: u64, connection: u64) -> (Vec<Vec<u8>>, FaultStats) {
        let rates = [(Fault::Drop, "0.1"), (Fault::Corrupt, "0.2")];
        let plan = FaultPlan {
            seed,
            rates: rates
                .map(|(fault, rate)| (fault, rate.parse().unwrap()))
                .to_vec(),
            ..FaultPlan::default()
        };
        let mut link = FaultInjector::new(&plan, Transport::Stream, connection, Direction::Up);
        let mut out = Vec::new();
        for _ in 0..10_000 {
            link.push(MS, &[0; 8]);
            out.extend(link.pop(MS));
        }
        (out, link.stats().clone())
    }

    #[test]
    fn the_seed_decides_and_the_rates_are_kept() {
        assert_eq!(run(1, 0), run(1, 0));
        assert_ne!(run(1, 0).0, run(2, 0).0);
        assert_ne!(run(1, 0).0, run(1, 1).0);
        let (out, stats) = run(1, 0);
        let [dropped, corrupted] =
            [Fault::Drop, Fault::Corrupt].map(|fault| stats.faults[&fault].times);
        // Five standard deviations of 10 000 draws: 150 and 200.
        assert!(dropped.abs_diff(1_000) < 150);
        assert!(corrupted.abs_diff(2_000) < 200);
        let lost = 10_000 - dropped;
        assert_eq!(u64::try_from(out.len()).unwrap(), lost);
        let flipped = out
            .iter()
            .filter(|bytes| bytes.iter().map(|byte| byte.count_ones()).sum::<u32>() == 1);
        assert_eq!(u64::try_from(flipped.count()).unwrap(), corrupted);
    }
}
