//! Kani harnesses: any valid channel, any limits that validation accepts, any target.

use gantry_tau_core::control::channel::{Channel, Limits};

use crate::channel::{ChannelOp, ramp_is_exact, step_is_bounded};

/// Any channel that is valid under the limits.
fn any_channel(limits: &Limits) -> Channel {
    let channel = Channel::from_parts(kani::any(), kani::any(), limits);
    kani::assume(channel.is_some());
    kani::cover!(true, "some channels are valid");
    channel.unwrap_or(Channel::ZERO)
}

#[kani::proof]
#[kani::solver(minisat)]
fn channel_hold_is_bounded() {
    let limits: Limits = kani::any();
    step_is_bounded(any_channel(&limits), ChannelOp::Hold, &limits);
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::solver(minisat)]
fn channel_follow_is_bounded() {
    let limits: Limits = kani::any();
    step_is_bounded(
        any_channel(&limits),
        ChannelOp::Follow(kani::any()),
        &limits,
    );
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::solver(minisat)]
fn channel_ramp_is_bounded() {
    let limits: Limits = kani::any();
    step_is_bounded(any_channel(&limits), ChannelOp::Ramp, &limits);
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::solver(minisat)]
fn channel_ramp_is_exact() {
    let limits: Limits = kani::any();
    ramp_is_exact(any_channel(&limits), &limits);
    kani::cover!(true, "the end is reached");
}
