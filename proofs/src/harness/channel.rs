//! Any valid channel, any limits that validation accepts, any target.

use gantry_tau_core::control::channel::{Channel, Limits};
use gantry_tau_core::units::OffsetNm;

use super::kani;
use crate::properties::channel::{
    Position, change_is_bounded, ramp_is_exact, ramp_lowers_any_bound,
};

/// Any channel that is valid under the limits.
fn any_channel(limits: &Limits<OffsetNm>) -> Position {
    let channel = Channel::from_parts(kani::any(), kani::any(), limits);
    assume!(channel.is_some(), true, "some channels are valid");
    channel.unwrap_or(Channel::ZERO)
}

fn any_step_is_bounded(step: impl Fn(Position, &Limits<OffsetNm>) -> Position) {
    let limits: Limits<OffsetNm> = kani::any();
    let before = any_channel(&limits);
    change_is_bounded(before, step(before, &limits), &limits);
}

harnesses! {
    channel_hold_is_bounded [minisat] { any_step_is_bounded(|before, _| before.hold()); }
    channel_follow_is_bounded [minisat] { any_step_is_bounded(|before, limits| before.follow(kani::any(), limits)); }
    channel_ramp_is_bounded [minisat] { any_step_is_bounded(|before, limits| before.ramp(limits)); }
    channel_ramp_is_exact [minisat] {
        let limits: Limits<OffsetNm> = kani::any();
        ramp_is_exact(any_channel(&limits), &limits);
    }
    channel_ramp_lowers_any_bound [minisat] {
        let limits: Limits<OffsetNm> = kani::any();
        ramp_lowers_any_bound(any_channel(&limits), kani::any(), &limits);
    }
}
