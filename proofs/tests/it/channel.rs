//! The properties on stable Rust: over their whole domain, and over sequences.

use crate::any;

use gantry_tau_core::control::channel::{Channel, Limits};
use gantry_tau_core::units::OffsetNm;
use gantry_tau_proofs::channel::{ChannelOp, ramp_counts_down, ramp_is_exact, step, step_is_bounded};
use proptest::prelude::*;

/// Limits and a channel that is valid under them.
fn limits_and_channel() -> impl Strategy<Value = (Limits<OffsetNm>, Channel<OffsetNm>)> {
    any::limits().prop_flat_map(|limits| (Just(limits), any::channel(limits)))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4_000))]

    #[test]
    fn one_step_is_bounded((limits, channel) in limits_and_channel(), number: u8, target: i32) {
        step_is_bounded(channel, ChannelOp::from_number(number, OffsetNm(target)), &limits);
    }

    #[test]
    fn one_ramp_step_is_exact((limits, channel) in limits_and_channel()) {
        ramp_is_exact(channel, &limits);
        ramp_counts_down(channel, &limits);
    }

    #[test]
    fn every_step_of_a_sequence_is_bounded(limits in any::limits(), verbs: Vec<(u8, i32)>) {
        let mut channel = Channel::ZERO;
        for (number, target) in verbs {
            let verb = ChannelOp::from_number(number, OffsetNm(target));
            step_is_bounded(channel, verb, &limits);
            channel = step(channel, verb, &limits);
        }
    }
}
