//! One direction of a link, without sockets and clock: frames in at a logical time, bytes out when they are due.

use std::collections::BTreeMap;
use std::time::Duration;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::plan::{Act, Cue, Odds, Plan, When};
use super::{Direction, Fault, Medium, Tally};

/// Bytes under way beyond which nothing more should be read.
const FULL: usize = 1 << 18;

/// One direction of one connection. Times count from the connection's beginning and never go back.
#[derive(Clone, Debug)]
pub struct Mangle {
    medium: Medium,
    delay: Duration,
    jitter: Duration,
    odds: Vec<(Fault, Odds)>,
    /// What is still to come of the script.
    cues: Vec<Cue>,
    random: ChaCha8Rng,
    /// What is under way, in the order in which it will come.
    under_way: BTreeMap<(Duration, u64), Vec<u8>>,
    bytes: usize,
    pieces: u64,
    last_due: Duration,
    held_until: Duration,
    deaf_until: Duration,
    silent: bool,
    reset: bool,
    tally: Tally,
}

impl Mangle {
    /// The given direction of the connection of this number.
    #[must_use]
    pub fn new(plan: &Plan, medium: Medium, connection: u64, direction: Direction) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(plan.seed);
        // Every direction draws from a stream of its own: what happens on one changes nothing on another.
        random.set_stream(2 * connection + u64::from(direction == Direction::Down));
        let applies = plan.direction.is_none_or(|only| only == direction);
        let cues = plan.script.iter().filter(|cue| cue.concerns(direction));
        Self {
            medium,
            delay: if applies { plan.delay } else { Duration::ZERO },
            jitter: if applies { plan.jitter } else { Duration::ZERO },
            odds: if applies {
                plan.odds.clone()
            } else {
                Vec::new()
            },
            cues: cues.copied().collect(),
            random,
            under_way: BTreeMap::new(),
            bytes: 0,
            pieces: 0,
            last_due: Duration::ZERO,
            held_until: Duration::ZERO,
            deaf_until: Duration::ZERO,
            silent: false,
            reset: false,
            tally: Tally::default(),
        }
    }

    /// A frame comes in.
    pub fn push(&mut self, now: Duration, frame: &[u8]) {
        if self.silent || self.reset {
            return;
        }
        self.tally.frames += 1;
        // Drawn for every frame, so that a cue changes nothing behind it.
        let drawn = self.draw();
        let later = self.jitter.mul_f64(self.random.random());
        let act = self.cue(now).or(drawn);
        let due = now + self.delay + later;
        let Some(act) = act else {
            return self.send(due, frame.to_vec());
        };
        self.tally.note(act.fault, now);
        self.suffer(act, now, due, frame.to_vec());
    }

    /// What has become due, a piece at a time.
    pub fn pop(&mut self, now: Duration) -> Option<Vec<u8>> {
        let first = self.under_way.first_entry()?;
        if first.key().0 > now {
            return None;
        }
        let piece = first.remove();
        self.bytes -= piece.len();
        Some(piece)
    }

    /// When the next piece is due.
    #[must_use]
    pub fn next_due(&self) -> Option<Duration> {
        self.under_way.first_key_value().map(|(key, _)| key.0)
    }

    /// Whether a stream should not be read now: it is stalled, or too much is under way.
    #[must_use]
    pub const fn is_deaf(&self, now: Duration) -> bool {
        now.as_nanos() < self.deaf_until.as_nanos() || self.bytes > FULL
    }

    /// Goes half-open: what is under way and not yet due is lost, and so is everything that comes.
    pub fn silence(&mut self, now: Duration) {
        self.silent = true;
        let lost = self.under_way.split_off(&(now, u64::MAX));
        self.bytes -= lost.values().map(Vec::len).sum::<usize>();
    }

    /// Whether it is half-open: neither bytes nor a close are passed on.
    #[must_use]
    pub const fn is_silent(&self) -> bool {
        self.silent
    }

    /// Whether both ends of the connection are to be reset.
    #[must_use]
    pub const fn is_reset(&self) -> bool {
        self.reset
    }

    /// What was done so far.
    #[must_use]
    pub const fn tally(&self) -> &Tally {
        &self.tally
    }

    /// The line of the script whose moment this is.
    fn cue(&mut self, now: Duration) -> Option<Act> {
        let this_frame = When::Frame(self.tally.frames);
        let on_frame = self.cues.iter().position(|cue| cue.when == this_frame);
        let is_due = |cue: &Cue| matches!(cue.when, When::Since(since) if since <= now);
        let index = on_frame.or_else(|| self.cues.iter().position(is_due))?;
        Some(self.cues.remove(index).act)
    }

    fn draw(&mut self) -> Option<Act> {
        let mut left: f64 = self.random.random();
        for (fault, odds) in &self.odds {
            left -= odds.per_frame;
            if left < 0.0 {
                return Some(Act {
                    fault: *fault,
                    parameter: odds.parameter,
                });
            }
        }
        None
    }

    fn suffer(&mut self, act: Act, now: Duration, due: Duration, mut frame: Vec<u8>) {
        let ms = |usual| Duration::from_millis(act.parameter.unwrap_or(usual).into());
        match act.fault {
            Fault::Drop => {}
            Fault::Duplicate => {
                for _ in 0..act.parameter.unwrap_or(1) {
                    self.send(due, frame.clone());
                }
                self.send(due, frame);
            }
            // Put where it will come, beside the order of the others.
            Fault::Reorder => self.put(due.max(self.held_until) + ms(2), frame),
            Fault::Corrupt => {
                let bit = self.place(act.parameter, 8 * frame.len());
                if let Some(byte) = frame.get_mut(bit / 8) {
                    *byte ^= 1 << (bit % 8);
                }
                self.send(due, frame);
            }
            Fault::Truncate => {
                frame.truncate(self.place(act.parameter, frame.len()));
                self.send(due, frame);
            }
            Fault::Split => {
                let first = self.place(act.parameter, frame.len());
                let rest = frame.split_off(first);
                self.send(due, frame);
                self.send(due, rest);
            }
            Fault::Burst => {
                self.held_until = self.held_until.max(now + ms(10));
                self.send(due, frame);
            }
            Fault::Stall => {
                self.held_until = self.held_until.max(now + ms(10));
                self.deaf_until = self.held_until;
                self.send(due, frame);
            }
            Fault::HalfOpen => self.silence(now),
            Fault::Reset => {
                self.reset = true;
                self.under_way.clear();
                self.bytes = 0;
            }
        }
    }

    /// The stated place, counted round where the frame is shorter, or a drawn one.
    fn place(&mut self, stated: Option<u32>, end: usize) -> usize {
        let end = end.max(1);
        match stated.map(usize::try_from) {
            Some(Ok(stated)) => stated % end,
            _ => self.random.random_range(0..end),
        }
    }

    /// Behind everything that was sent before.
    fn send(&mut self, due: Duration, piece: Vec<u8>) {
        let due = due.max(self.held_until).max(self.last_due);
        self.last_due = due;
        self.put(due, piece);
    }

    fn put(&mut self, due: Duration, piece: Vec<u8>) {
        // A datagram may be empty; of a stream nothing is nothing.
        if piece.is_empty() && self.medium == Medium::Stream {
            return;
        }
        self.bytes += piece.len();
        self.under_way.insert((due, self.pieces), piece);
        self.pieces += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::plan::parse_script;

    const MS: Duration = Duration::from_millis(1);

    fn scripted(script: &str, medium: Medium) -> Mangle {
        let plan = Plan {
            script: parse_script(script).unwrap(),
            ..Plan::default()
        };
        Mangle::new(&plan, medium, 0, Direction::Up)
    }

    /// Everything that comes of ten frames `[n; 4]`, one per ms: (ms, bytes).
    fn played(mut link: Mangle) -> Vec<(u32, Vec<u8>)> {
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

    fn undisturbed() -> Vec<(u32, Vec<u8>)> {
        (1..=10).map(|ms: u8| (ms.into(), vec![ms; 4])).collect()
    }

    #[test]
    fn a_harmless_link_only_forwards() {
        let link = Mangle::new(&Plan::harmless(), Medium::Stream, 0, Direction::Down);
        assert_eq!(played(link), undisturbed());
        let other_way = scripted("frame 3 down drop", Medium::Stream);
        assert_eq!(played(other_way), undisturbed());
    }

    #[test]
    fn each_fault_does_what_it_says_and_nothing_else() {
        let play = |script, medium| played(scripted(script, medium));
        let stream = |script| play(script, Medium::Stream);
        let mut expected = undisturbed();
        expected.remove(2);
        assert_eq!(stream("frame 3 up drop"), expected);

        let mut expected = undisturbed();
        for _ in 0..2 {
            expected.insert(2, (3, vec![3; 4]));
        }
        assert_eq!(stream("ms 3 both duplicate 2"), expected);

        let mut expected = undisturbed();
        expected[2].1[2] = 3 ^ 2;
        assert_eq!(stream("frame 3 up corrupt 17"), expected);
        assert_eq!(stream("frame 3 up corrupt 49"), expected, "counted round");

        let mut expected = undisturbed();
        expected[2].1.pop();
        assert_eq!(stream("frame 3 up truncate 3"), expected);

        let mut expected = undisturbed();
        expected[2].1.pop();
        expected.insert(3, (3, vec![3]));
        assert_eq!(stream("frame 3 up split 3"), expected);

        let mut expected = undisturbed();
        let late = expected.remove(2);
        expected.insert(5, (6, late.1));
        let reordered = play("frame 3 up reorder 3", Medium::Datagrams);
        // At the same moment the one that was held back is second or first; it was put first.
        expected.swap(4, 5);
        assert_eq!(reordered, expected);

        let mut expected = undisturbed();
        for (ms, _) in &mut expected[2..=5] {
            *ms = 7;
        }
        assert_eq!(stream("frame 3 up burst 4"), expected);

        // Not read while it lasts, so 4, 5 and 6 never came in.
        let mut expected = undisturbed();
        expected.drain(3..=5);
        expected[2].0 = 7;
        assert_eq!(stream("frame 3 up stall 4"), expected);

        assert_eq!(stream("frame 3 up half-open"), undisturbed()[..2]);
        let mut link = scripted("frame 1 up reset", Medium::Stream);
        link.push(MS, b"x");
        assert!(link.is_reset() && !link.is_silent());
        assert_eq!(played(link), []);
    }

    #[test]
    fn delay_and_jitter_keep_the_order() {
        let plan = Plan {
            delay: 5 * MS,
            jitter: 7 * MS,
            seed: 3,
            ..Plan::default()
        };
        let seen = played(Mangle::new(&plan, Medium::Datagrams, 0, Direction::Up));
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

    #[test]
    fn the_seed_decides_and_the_odds_are_kept() {
        let odds = [(Fault::Drop, "0.1"), (Fault::Corrupt, "0.2")];
        let plan = |seed| Plan {
            seed,
            odds: odds
                .map(|(fault, odds)| (fault, odds.parse().unwrap()))
                .to_vec(),
            ..Plan::default()
        };
        let run = |seed, connection| {
            let mut link = Mangle::new(&plan(seed), Medium::Stream, connection, Direction::Up);
            let mut out = Vec::new();
            for _ in 0..10_000 {
                link.push(MS, &[0; 8]);
                out.extend(link.pop(MS));
            }
            (out, link.tally().clone())
        };
        assert_eq!(run(1, 0), run(1, 0));
        assert_ne!(run(1, 0).0, run(2, 0).0);
        assert_ne!(run(1, 0).0, run(1, 1).0);
        let (out, tally) = run(1, 0);
        let times = |fault| tally.acted[&fault].times;
        // Five standard deviations of 10 000 draws: 150 and 200.
        assert!(times(Fault::Drop).abs_diff(1_000) < 150);
        assert!(times(Fault::Corrupt).abs_diff(2_000) < 200);
        let lost = 10_000 - times(Fault::Drop);
        assert_eq!(u64::try_from(out.len()).unwrap(), lost);
        let flipped =
            |bytes: &&Vec<u8>| bytes.iter().map(|byte| byte.count_ones()).sum::<u32>() == 1;
        let corrupt = u64::try_from(out.iter().filter(flipped).count()).unwrap();
        assert_eq!(corrupt, times(Fault::Corrupt));
    }
}
