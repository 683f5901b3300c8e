//! Counters and causes. They report and never decide.

use super::Parts;
use super::fsm::{Decision, EndReason, FsmInput, FsmState};
use crate::control::message::{AxisFlags, AxisState, Cause, Counters, Phase};
use crate::zip::each;

impl<const N: usize> Parts<N> {
    /// Updates counters and cause after a tick, beside the counts of [`super::ingress`].
    pub(super) fn update_diagnostics(
        &mut self,
        before: &FsmState,
        decision: &Decision,
        fsm: &FsmInput,
        late: bool,
    ) {
        if before.phase == Phase::Listening && decision.next.phase == Phase::Handshake {
            self.counters = Counters::default();
            self.late = false;
        }
        self.late |= late;
        self.count_misses(before, decision, fsm);
        match decision.end {
            Some(EndReason::Because(cause)) => self.cause = cause,
            Some(EndReason::Missed) if self.late => self.cause = Cause::NetworkLate,
            Some(EndReason::Missed) => self.cause = Cause::ClientLate,
            None => {}
        }
        if fsm.command.is_some() {
            self.late = false;
        }
    }

    /// Counts deadlines while commands are due; a session that ends for another reason has no
    /// deadline in that tick.
    fn count_misses(&mut self, before: &FsmState, decision: &Decision, fsm: &FsmInput) {
        let late = matches!(
            decision.end,
            None | Some(EndReason::Missed | EndReason::Because(Cause::ServerLate | Cause::Budget))
        );
        if !late || !matches!(before.phase, Phase::Submit | Phase::Obtain) {
            return;
        }
        let missed = u32::from(fsm.command.is_none());
        let missed = missed.saturating_add(fsm.skipped);
        let run = u32::from(before.misses).saturating_add(missed);
        let run = u16::try_from(run).unwrap_or(u16::MAX);
        let counters = &mut self.counters;
        counters.missed = counters.missed.saturating_add(missed);
        counters.longest_miss_run = counters.longest_miss_run.max(run);
    }
}

/// Counts limited channel steps and clamped references.
pub(super) fn count_flags<const N: usize>(counters: &mut Counters, axes: &[AxisState; N]) {
    let limited = count_set(axes, AxisFlags::LIMITED);
    let clamped = count_set(axes, AxisFlags::TRAVEL);
    counters.limited = counters.limited.saturating_add(limited);
    counters.clamped = counters.clamped.saturating_add(clamped);
}

/// Returns the number of set flags of `mask`, over all axes.
fn count_set<const N: usize>(axes: &[AxisState; N], mask: AxisFlags) -> u32 {
    // Sums of at most 3 N do not wrap.
    each(axes).fold(0_u32, |sum, axis| {
        sum.wrapping_add((axis.flags.0 & mask.0).count_ones())
    })
}

/// Returns the number of on-time deadlines among the latest 100.
pub(super) fn on_time_of_100(history: u128) -> u8 {
    let latest = history & ((1 << 100) - 1);
    let missed = u8::try_from(latest.count_ones()).unwrap_or(100);
    100_u8.saturating_sub(missed)
}
