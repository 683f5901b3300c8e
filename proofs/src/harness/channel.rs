//! Any valid channel, any limits that validation accepts, any target.

use gantry_tau_core::control::channel::{Channel, Limits};
use gantry_tau_core::units::OffsetNm;

use super::kani;
use crate::channel::{ChannelOp, Position, ramp_is_exact, step_is_bounded};

/// Any channel that is valid under the limits.
fn any_channel(limits: &Limits<OffsetNm>) -> Position {
    let channel = Channel::from_parts(kani::any(), kani::any(), limits);
    assume!(channel.is_some(), true, "some channels are valid");
    channel.unwrap_or(Channel::ZERO)
}

fn any_step_is_bounded(op: ChannelOp) {
    let limits: Limits<OffsetNm> = kani::any();
    step_is_bounded(any_channel(&limits), op, &limits);
}

harnesses! {
    channel_hold_is_bounded [minisat] { any_step_is_bounded(ChannelOp::Hold); }
    channel_follow_is_bounded [minisat] { any_step_is_bounded(ChannelOp::Follow(kani::any())); }
    channel_ramp_is_bounded [minisat] { any_step_is_bounded(ChannelOp::Ramp); }
    channel_ramp_is_exact [minisat] {
        let limits: Limits<OffsetNm> = kani::any();
        ramp_is_exact(any_channel(&limits), &limits);
    }
}
