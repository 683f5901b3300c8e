//! The pacer, T32: one tick and one target, beside a server's channel that has taken all so far.

use gantry_tau_core::control::pacer::{Paced, PacedAxis, Pacer, Target};
use gantry_tau_core::units::Tick;

/// T32: what a tick asks for is what a channel with the same limits reaches without being limited, and
/// the pacer goes on from there.
pub fn asks_what_a_server_grants<const N: usize, const WAITING: usize>(
    mut pacer: Pacer<N, WAITING>,
    now: Tick,
) {
    let servers = *pacer.axes();
    let Paced::Targets(targets) = pacer.tick(now) else {
        return;
    };
    for ((server, target), axis) in servers.iter().zip(targets).zip(pacer.axes()) {
        let granted = server.channel.follow(target, &server.limits);
        assert!(granted.value() == target, "T32: the server limits nothing");
        assert!(
            granted == axis.channel,
            "T32: the server is where the pacer believes"
        );
        assert!(
            axis.channel.is_valid(&axis.limits),
            "T32: the invariant is kept"
        );
    }
}

/// T32: silence grows with every tick, holds what is asked for, and ends in giving up.
pub fn silence_ends<const N: usize, const WAITING: usize>(mut pacer: Pacer<N, WAITING>, now: Tick) {
    let (before, asked_before) = (pacer.silent_ticks(), *pacer.axes());
    let asked = pacer.tick(now);
    let (silent, settings) = (pacer.silent_ticks(), *pacer.settings());
    assert!(
        silent > before || silent == u32::MAX,
        "T32: silence grows with every tick"
    );
    assert!(
        (asked == Paced::GiveUp) == (silent > settings.give_up_ticks),
        "T32: given up exactly after that silence"
    );
    if silent > settings.hold_ticks {
        let stands = |(axis, before): (&PacedAxis, &PacedAxis)| {
            axis.channel.value() == before.channel.value()
        };
        assert!(
            pacer.axes().iter().zip(&asked_before).all(stands),
            "T32: a silent program moves nothing"
        );
    }
}

/// T32: a target that is refused changes nothing; one that is taken ends the silence, and moves
/// nothing by itself.
pub fn target_is_taken_or_refused<const N: usize, const WAITING: usize>(
    pacer: &Pacer<N, WAITING>,
    target: Target<N>,
) {
    let mut after = pacer.clone();
    if after.push(target).is_err() {
        assert!(after == *pacer, "T32: a refused target changes nothing");
        return;
    }
    assert!(
        after.silent_ticks() == 0,
        "T32: a target that is taken ends the silence"
    );
    assert!(
        after.axes() == pacer.axes(),
        "T32: a target moves nothing by itself"
    );
}
