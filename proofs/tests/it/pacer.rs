//! T32 on stable Rust: sequences of targets and ticks, beside the channels of a server that takes all.

use gantry_tau_core::control::channel::Channel;
use gantry_tau_core::control::pacer::{Paced, Pacer, Settings, Target};
use gantry_tau_core::units::{OffsetNm, Tick};
use gantry_tau_proofs::properties::pacer::{
    asks_what_a_server_grants, silence_ends, target_is_taken_or_refused,
};
use proptest::array::uniform2;
use proptest::collection::vec;
use proptest::prelude::*;

use crate::any;

const N: usize = 2;

/// Next event of a sequence.
#[derive(Clone, Debug)]
enum Next {
    /// A target, at a time after the last tick; or before it.
    Target { ahead: i64, offsets: [OffsetNm; N] },
    /// A tick, so many after the last one.
    Tick(u64),
}

fn next() -> impl Strategy<Value = Next> {
    let offset = prop_oneof![3 => -30_000..30_000, 1 => any::<i32>()].prop_map(OffsetNm);
    let ahead = prop_oneof![5 => -5..40_i64, 1 => -300..12_000_i64];
    prop_oneof![
        1 => (ahead, uniform2(offset)).prop_map(|(ahead, offsets)| Next::Target { ahead, offsets }),
        4 => prop_oneof![12 => Just(1_u64), 2 => 0..4_u64, 1 => 0..500_u64].prop_map(Next::Tick),
    ]
}

prop_compose! {
    fn settings()(
        latency_ticks in 0..50_u32, hold_ticks in 0..60_u32, more in 0..100_u32, horizon_ticks in 1..=10_000_u32,
    ) -> Settings {
        Settings { latency_ticks, hold_ticks, give_up_ticks: hold_ticks + more, horizon_ticks }
    }
}

proptest! {
    #[test]
    fn whatever_a_program_says_is_granted(
        limits in uniform2(any::limits_of(prop_oneof![4 => 0..=40_000, 1 => 0..=i32::MAX], i32::MAX)),
        settings in settings(),
        begin in prop_oneof![Just(0), 1_000..2_000_u64, Just(u64::MAX - 3)],
        steps in vec(next(), 1..300),
    ) {
        let mut now = Tick(begin);
        let mut pacer = Pacer::<N, 4>::new(limits, settings, now).unwrap();
        let mut servers = [Channel::ZERO; N];
        for step in steps {
            match step {
                Next::Target { ahead, offsets } => {
                    let target = Target { at: Tick(now.0.saturating_add_signed(ahead)), offsets };
                    target_is_taken_or_refused(&pacer, target);
                    let _ = pacer.push(target);
                }
                Next::Tick(passed) => {
                    now = Tick(now.0.saturating_add(passed));
                    asks_what_a_server_grants(pacer.clone(), now);
                    silence_ends(pacer.clone(), now);
                    let Paced::Targets(targets) = pacer.tick(now) else { continue };
                    for ((server, target), limits) in servers.iter_mut().zip(targets).zip(&limits) {
                        *server = server.follow(target, limits);
                        prop_assert_eq!(server.value(), target, "limited");
                    }
                }
            }
        }
    }
}
