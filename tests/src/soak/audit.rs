//! Invariants of every tick of every server, judged by its output.
//!
//! The counters' relation, for every session and every tick of it:
//! `received = accepted + late + duplicate + stale + malformed` while it runs, where `accepted` is
//! how often the accepted sequence rose. From its end on there are also its farewells (Goodbyes and
//! Stops), which only count as received, and at most one command that was fresh in the tick of the
//! end and came to nothing. Every deadline is either met by an accepted command or missed.

use gantry_tau_core::control::axis::{Offsets, Reference};
use gantry_tau_core::control::message::{AxisLimits, Cause, Counters, Phase, State};
use gantry_tau_core::control::monitor::Monitor;
use gantry_tau_core::control::session::config::Travel;
use gantry_tau_server::record::COUNTERS;

use super::Summary;

/// One tick, as the server gives it out.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a, const N: usize> {
    /// The State.
    pub state: &'a State<N>,
    /// References of the drives.
    pub references: &'a [Reference; N],
    /// A session was granted.
    pub welcomed: bool,
    /// A session ended, or the server stopped.
    pub ended: Option<Cause>,
    /// Cycles since the last tick.
    pub elapsed: u32,
}

/// Looks at every tick; panics where one does not keep what it must.
#[derive(Clone, Debug)]
pub struct Audit<const N: usize> {
    monitor: Monitor<N>,
    last: Option<(State<N>, [Reference; N])>,
    accepted: u64,
    /// Farewells, and perhaps one command without effect, of a session that is over.
    beyond: u64,
    /// Numbers of ticks and sessions, and largest changes, so far.
    pub summary: Summary,
}

impl<const N: usize> Audit<N> {
    /// For a server with these limits that starts with all offsets at zero.
    #[must_use]
    pub fn new(limits: [AxisLimits; N], travel: [Travel; N]) -> Self {
        let steps = limits.map(|axis| axis.position.step().unsigned_abs());
        let external_limit_nm = steps.into_iter().max().unwrap_or(0).into();
        let summary = Summary {
            external_limit_nm,
            ..Summary::default()
        };
        Self {
            monitor: Monitor::new(limits, Some(travel)),
            last: None,
            accepted: 0,
            beyond: 0,
            summary,
        }
    }

    /// Received frames of the current or last session that are neither accepted nor counted as
    /// anything else: zero while it runs, then its farewells and perhaps one command without
    /// effect.
    #[must_use]
    pub const fn beyond(&self) -> u64 {
        self.beyond
    }

    /// One tick. Returns the cause that ended a session in it.
    pub fn see(&mut self, seen: &Seen<'_, N>) -> Option<Cause> {
        let state = seen.state;
        let before = self.last.map_or(Phase::Listening, |(state, _)| state.phase);
        self.summary.ticks += 1;
        self.summary.sessions += u64::from(seen.welcomed);
        self.summary.obtained += u64::from(state.phase == Phase::Obtain && before == Phase::Submit);
        let checked = self.monitor.check_tick(state, seen.references);
        assert_eq!(checked, Ok(()), "{state:?}");
        if seen.welcomed {
            let zero = state.axes.iter().all(|axis| axis.offsets == Offsets::ZERO);
            assert!(zero, "granted during a ramp");
        }
        if let Some((before, references)) = self.last {
            let cycles = u64::from(seen.elapsed.max(1));
            assert_eq!(state.tick.0, before.tick.0 + cycles, "a tick is missing");
            self.measure_references(&before, &references, seen);
            self.check_counters(&before, seen);
            check_deadlines(&before, seen);
        }
        self.last = Some((*state, *seen.references));
        seen.ended.filter(|_| is_live(before))
    }

    /// Largest changes of the references.
    fn measure_references(
        &mut self,
        before: &State<N>,
        references: &[Reference; N],
        seen: &Seen<'_, N>,
    ) {
        for (axis, (old_reference, new_reference)) in
            references.iter().zip(seen.references).enumerate()
        {
            let (old, new) = (&before.axes[axis], &seen.state.axes[axis]);
            let nominal = old.nominal.0.abs_diff(new.nominal.0);
            let change = old_reference.position.0.abs_diff(new_reference.position.0);
            let external = change.saturating_sub(nominal);
            let summary = &mut self.summary;
            summary.largest_change_nm = summary.largest_change_nm.max(change);
            summary.largest_external_change_nm = summary.largest_external_change_nm.max(external);
        }
    }

    fn check_counters(&mut self, before: &State<N>, seen: &Seen<'_, N>) {
        let (state, now) = (seen.state, &seen.state.counters);
        if seen.welcomed {
            self.accepted = 0;
            self.beyond = 0;
            assert_eq!(
                (state.accepted.0, *now),
                (0, Counters::default()),
                "a session begins at zero"
            );
            return;
        }
        assert!(grown(&before.counters, now), "a counter went back");
        assert!(now.out_of_range <= now.malformed);
        assert!(state.accepted >= before.accepted);
        self.accepted += u64::from(state.accepted > before.accepted);
        let counted = self.accepted
            + [now.late, now.duplicate, now.stale, now.malformed]
                .map(u64::from)
                .iter()
                .sum::<u64>();
        let beyond = u64::from(now.received).checked_sub(counted);
        let beyond = beyond.expect("more is counted than was received");
        if is_live(state.phase) {
            assert_eq!(beyond, 0, "received and not counted: {state:?}");
            assert!(
                now.longest_miss_run <= 1,
                "two misses in a row and still running"
            );
        }
        assert!(beyond >= self.beyond);
        self.beyond = beyond;
    }
}

/// While commands are due, each deadline is met or missed; a session that ends for another reason
/// has none in that tick.
fn check_deadlines<const N: usize>(before: &State<N>, seen: &Seen<'_, N>) {
    let state = seen.state;
    let late = [
        Cause::ClientLate,
        Cause::NetworkLate,
        Cause::ServerLate,
        Cause::Budget,
    ];
    let due = matches!(before.phase, Phase::Submit | Phase::Obtain)
        && seen.ended.is_none_or(|cause| late.contains(&cause));
    let missed = state.counters.missed - before.counters.missed * u32::from(!seen.welcomed);
    let skipped = seen.elapsed.max(1) - 1;
    if !due {
        assert_eq!(missed, 0, "a miss with nothing due: {state:?}");
    } else if seen.ended.is_none() {
        let met = u32::from(state.accepted > before.accepted);
        assert_eq!(met + missed, 1 + skipped, "{state:?}");
    } else {
        // A session that the server's own lateness ends accepts nothing that comes later.
        assert!((skipped..=1 + skipped).contains(&missed), "{state:?}");
    }
}

fn grown(before: &Counters, now: &Counters) -> bool {
    COUNTERS
        .iter()
        .all(|(_, value)| value(before) <= value(now))
}

/// True if a session is running.
#[must_use]
pub const fn is_live(phase: Phase) -> bool {
    matches!(phase, Phase::Handshake | Phase::Submit | Phase::Obtain)
}
