//! Any pacer with valid channels, any targets that wait, in order or not, any tick, any target.

use gantry_tau_core::control::pacer::Pacer;

use super::kani;
use crate::properties::pacer::{
    asks_what_a_server_grants, silence_ends, target_is_taken_or_refused,
};

/// Targets that wait: as few as show an order.
const WAITING: usize = 2;

/// Any pacer; its channels are anywhere.
fn any_pacer<const N: usize>() -> Pacer<N, WAITING> {
    let pacer: Pacer<N, WAITING> = kani::any();
    kani::cover!(
        pacer.axes().iter().all(|axis| !axis.channel.is_zero()),
        "no channel is at zero"
    );
    pacer
}

harnesses! {
    pacer_asks_what_a_server_grants [minisat, unwind 5] { asks_what_a_server_grants(any_pacer::<1>(), kani::any()); }
    pacer_of_3_asks_what_a_server_grants [minisat, unwind 5] { asks_what_a_server_grants(any_pacer::<3>(), kani::any()); }
    pacer_silence_ends [minisat, unwind 5] {
        let pacer = any_pacer::<1>();
        kani::cover!(pacer.silent_ticks() == pacer.settings().give_up_ticks, "the last tick before it is given up");
        silence_ends(pacer, kani::any());
    }
    pacer_target_is_taken_or_refused [minisat, unwind 5] {
        let (pacer, target) = (any_pacer::<1>(), kani::any());
        kani::cover!(pacer.clone().push(target).is_ok(), "some targets are taken");
        kani::cover!(pacer.clone().push(target).is_err(), "some are refused");
        target_is_taken_or_refused(&pacer, target);
    }
}
