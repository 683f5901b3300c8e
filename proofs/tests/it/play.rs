//! Sequences with two hostile clients on stable Rust: every tick is right, and is what the oracle says.

use gantry_tau_proofs::play::{
    Circumstances, Machine, Move, Play, Rates, Shares, Who, Word, endpoint_is_right,
    every_tick_is_right,
};
use proptest::array::{uniform2, uniform3};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

/// Hundredths, most of them within the limits.
fn shares() -> impl Strategy<Value = Shares> {
    let share = prop_oneof![8 => -100..=100_i8, 4 => Just(0), 1 => any::<i8>()];
    uniform2(uniform3(share))
}

fn rates() -> impl Strategy<Value = Rates> {
    let scale = prop_oneof![4 => Just(0), 1 => any::<u8>()];
    (0..5_000_u16, any::<u8>(), any::<u8>(), any::<u8>(), scale).prop_map(
        |(max, ramp, step, accel, scale)| Rates {
            max,
            ramp,
            step,
            accel,
            scale,
        },
    )
}

fn machine() -> impl Strategy<Value = Machine> {
    let budget = option::of((any::<u8>(), 0..20_u8));
    let reach = prop_oneof![0..1_000_000_u32, any::<u32>()];
    let windows = (0..3_u8, prop_oneof![0..20_u8, any::<u8>()]);
    let rates = uniform2(uniform3(rates()));
    (
        rates,
        reach,
        any::<u16>(),
        budget,
        windows,
        prop::bool::weighted(0.1),
    )
        .prop_map(
            |(rates, reach, nominal_step, budget, (echo_window, handshake_ticks), lockstep)| {
                Machine {
                    rates,
                    reach,
                    nominal_step,
                    budget,
                    echo_window,
                    handshake_ticks,
                    lockstep,
                }
            },
        )
}

/// Nought most of the time, or the session would hardly ever get anywhere.
fn off() -> impl Strategy<Value = i8> {
    prop_oneof![8 => Just(0_i8), 1 => -2..3_i8, 1 => any::<i8>()]
}

fn word() -> impl Strategy<Value = Word> {
    let hello = (
        prop_oneof![9 => Just(0), 1 => any::<u8>()],
        prop_oneof![4 => Just(1), 1 => any::<u16>()],
    )
        .prop_map(|(axes, capabilities)| Word::Hello { axes, capabilities });
    let ahead =
        prop_oneof![6 => 1..4_i32, 2 => -2..2_i32, 1 => 65_534..65_540_i32, 1 => any::<i32>()];
    let command = (off(), ahead, off(), any::<bool>(), shares()).prop_map(
        |(epoch, ahead, behind, obtain, targets)| Word::Command {
            epoch,
            ahead,
            behind,
            obtain,
            targets,
        },
    );
    prop_oneof![
        8 => hello,
        12 => command,
        2 => off().prop_map(|epoch| Word::Goodbye { epoch }),
        1 => off().prop_map(|epoch| Word::Stop { epoch }),
        1 => Just(Word::Malformed),
        1 => Just(Word::Dropped),
        1 => Just(Word::Broken),
        1 => Just(Word::Flood),
        1 => Just(Word::Closed),
    ]
}

fn circumstances() -> impl Strategy<Value = Circumstances> {
    let elapsed = prop_oneof![8 => Just(1), 4 => 0..4_u32, 1 => any::<u32>()];
    let flags = (prop::bool::weighted(0.1), any::<bool>());
    let jump = option::weighted(0.05, any::<i64>());
    (elapsed, flags, jump, off()).prop_map(|(elapsed, (stop, rearm), jump, epoch)| Circumstances {
        elapsed,
        stop,
        rearm,
        jump,
        epoch,
    })
}

fn one_move() -> impl Strategy<Value = Move> {
    let who = prop_oneof![6 => Just(Who::Owner), 1 => Just(Who::One), 1 => Just(Who::Other)];
    let answer =
        (any::<bool>(), shares(), 1..20_u8).prop_map(|(obtain, targets, times)| Move::Answer {
            obtain,
            targets,
            times,
        });
    prop_oneof![
        8 => answer,
        2 => prop_oneof![4 => Just(1_u8), 1 => 0..50_u8].prop_map(Move::Silence),
        8 => (who, word()).prop_map(|(who, word)| Move::Say(who, word)),
        6 => circumstances().prop_map(Move::Tick),
        1 => uniform2(prop_oneof![8 => -100..=100_i8, 1 => any::<i8>()]).prop_map(Move::Drift),
        1 => shares().prop_map(Move::Resume),
    ]
}

/// A play; half of them begin with a handshake.
fn play() -> impl Strategy<Value = Play> {
    let in_force = prop_oneof![4 => Just([[0; 3]; 2]), 1 => shares()];
    let moves = (vec(one_move(), 0..40), any::<bool>());
    (machine(), in_force, prop::bool::weighted(0.1), moves).prop_map(
        |(machine, in_force, late_in_life, (mut moves, greeted))| {
            if greeted {
                let hello = Word::Hello {
                    axes: 0,
                    capabilities: 1,
                };
                moves.insert(0, Move::Silence(1));
                moves.insert(0, Move::Say(Who::One, hello));
            }
            Play {
                machine,
                in_force,
                late_in_life,
                moves,
            }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn every_tick_of_a_play_is_right(play in play()) {
        every_tick_is_right(&play);
    }

    #[test]
    fn a_play_by_bytes_is_right(play in play()) {
        endpoint_is_right(&play);
    }
}
