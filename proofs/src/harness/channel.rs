//! Any valid channel, any limits that validation accepts, any target.

use gantry_tau_core::control::channel::{Channel, Limits};
use gantry_tau_core::control::session::config::{AxisConfig, Config};
use gantry_tau_core::units::{ChannelUnit, OffsetNm};

use super::kani;
use crate::properties::channel::{
    Position, change_is_bounded, ramp_is_exact, ramp_lowers_any_bound, value_is_its_count,
};

/// Any channel that is valid under the limits.
fn any_channel<U: ChannelUnit>(limits: &Limits<U>) -> Channel<U> {
    let channel: Channel<U> = kani::any();
    assume!(
        channel.is_valid(limits),
        !channel.is_zero(),
        "some channels are not at zero"
    );
    channel
}

/// Any channel under limits of a configuration, which knows what its unit holds.
fn check_value<U: ChannelUnit>(limits: &Limits<U>) {
    value_is_its_count(any_channel(limits));
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
    channel_value_is_its_count [minisat, unwind 3] {
        let config: Config<1> = kani::any();
        let [AxisConfig { limits, .. }] = config.parameters().axes;
        check_value(&limits.position);
        check_value(&limits.velocity);
        check_value(&limits.torque);
    }
}
