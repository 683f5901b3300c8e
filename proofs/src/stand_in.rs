//! Stand-ins for functions that a solver cannot compare with themselves: an unknown function each, of
//! which some numbers are chosen.
//!
//! They return a bit or a byte of their arguments, no matter which, so that two calls agree only if
//! both see the same arguments.

#[cfg(feature = "keys")]
mod keys;

use core::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::control::message::{AxisState, Mode, Phase};
use gantry_tau_core::control::session::config::{AxisConfig, NominalAccel};
use gantry_tau_core::control::session::{Connection, Event};
use gantry_tau_core::units::{Epoch, PositionNm, Tick, TorquePermille, VelocityUmS};
use gantry_tau_core::verification::control::{
    Accepted, Action, Axis, AxisCommand, Classifier, Decision, Diagnostics, EndReason, FsmInput,
    FsmState, Rules,
};

#[cfg(feature = "keys")]
pub use keys::{Places, choose_tag, cookie_of_definition, cookie_of_keyring, mac, new_key, tag};

static BIT: AtomicU32 = AtomicU32::new(0);
static KEY: AtomicU32 = AtomicU32::new(0);
static PLACE: AtomicUsize = AtomicUsize::new(0);

/// Chooses the bit that [`nominal_stepped`] and [`nominal_accelerated`] return.
pub fn choose_bit(bit: u32) {
    BIT.store(bit, Ordering::Relaxed);
}

/// Comparison of a nominal reference with its limit, which is a product of two unknowns: an unknown
/// bit of the arguments. One that stands still is within any limit.
#[must_use]
pub fn nominal_stepped(from: PositionNm, to: PositionNm, axis: &AxisConfig, cycles: u32) -> bool {
    let limit = i64::from(axis.nominal_step_nm).rotate_left(32);
    let mixed = from.0 ^ to.0.rotate_left(16) ^ limit ^ i64::from(cycles);
    from != to && mixed.rotate_right(BIT.load(Ordering::Relaxed)) & 1 == 1
}

/// Comparison of the second difference of a nominal reference with its limit, of any machine at
/// once: an unknown bit of the arguments.
#[must_use]
pub fn nominal_accelerated(axis: &Axis, to: PositionNm, limit: NominalAccel) -> bool {
    let limit = i64::from(limit.nm.get()).rotate_left(32);
    let places = axis.nominal.0 ^ to.0.rotate_left(16) ^ axis.nominal_before.0.rotate_left(48);
    (places ^ limit).rotate_right(BIT.load(Ordering::Relaxed)) & 1 == 1
}

/// Chooses the argument that [`decide`] and [`act`] depend on, and what is decided: phase, action and
/// end, by bits.
pub fn choose_argument(place: usize, decided: u32) {
    PLACE.store(place, Ordering::Relaxed);
    KEY.store(decided, Ordering::Relaxed);
}

/// Decision: any phase, action and end, and a state that an unknown argument is in.
#[must_use]
pub fn decide(state: &FsmState, input: &FsmInput, rules: &Rules) -> Decision {
    let flags = [
        input.stop,
        input.quit,
        input.rearm,
        input.nominal_fault,
        input.framing,
        input.flood,
        input.closed,
        input.goodbye,
        input.agitated,
        input.all_zero,
        input.command.is_some(),
        input.hello.is_some(),
    ];
    let flags = flags
        .into_iter()
        .fold(0, |all, flag| all << 1 | u64::from(flag));
    let command = input.command.map_or((0, 0), |(sequence, mode)| {
        (sequence.0, u64::from(mode == Mode::Obtain))
    });
    let hello = input
        .hello
        .map_or((0, 0), |(from, epoch)| (from.0, epoch.0));
    let budget = rules.budget.map_or(0, |budget| {
        u64::from(budget.window) << 32 | u64::from(budget.allowed) << 1 | 1
    });
    let arguments = [
        flags,
        command.0,
        command.1,
        hello.0,
        hello.1,
        input.skipped.into(),
        rules.handshake_ticks.into(),
        budget,
    ];
    let decided = KEY.load(Ordering::Relaxed);
    let phase = match decided & 7 {
        0 => Phase::Listening,
        1 => Phase::Handshake,
        2 => Phase::Submit,
        3 => Phase::Obtain,
        4 => Phase::SafeDisconnect,
        _ => Phase::Fault,
    };
    let action = match decided >> 3 & 3 {
        0 => Action::Hold,
        1 => Action::Follow,
        2 => Action::FollowZero,
        _ => Action::Ramp,
    };
    Decision {
        next: FsmState {
            phase,
            tick: Tick(state.tick.0 ^ argument(&arguments)),
            ..*state
        },
        action,
        end: (decided >> 5 & 1 == 1).then_some(EndReason::Missed),
    }
}

/// Classification of an event: an unknown bit of connection and state says if it is a Goodbye.
pub fn classify<const N: usize>(
    classifier: &Classifier<'_, N>,
    connection: Connection,
    _: &Event<N>,
    accepted: &mut Accepted<N>,
    _: &mut Diagnostics,
) {
    let FsmState { tick, epoch, .. } = *classifier.discrete;
    let next = classifier.next_epoch.unwrap_or(Epoch(0));
    let mixed =
        connection.0.rotate_left(48) ^ tick.0 ^ epoch.0.rotate_left(16) ^ next.0.rotate_left(32);
    accepted.fsm.goodbye = mixed.rotate_right(BIT.load(Ordering::Relaxed)) & 1 == 1;
}

/// Tick of an axis: what it becomes, and its reference, depend on an unknown one of the numbers that
/// reach it.
pub fn act(
    axis: &mut Axis,
    command: &AxisCommand,
    config: &AxisConfig,
    state: &mut AxisState,
) -> Reference {
    let number = argument(&[
        bits(axis.nominal.0),
        bits(command.nominal.0),
        bits(command.actual.position.0),
        bits(command.target.position.0.into()),
        config.nominal_step_nm.into(),
        u64::from(command.obtains) << 1 | u64::from(command.action == Action::Follow),
    ]);
    axis.nominal = PositionNm(i64::from_ne_bytes(number.to_ne_bytes()));
    state.nominal = command.nominal;
    Reference {
        position: PositionNm(i64::from_ne_bytes(number.rotate_left(32).to_ne_bytes())),
        velocity_offset: VelocityUmS(0),
        torque_offset: TorquePermille(0),
    }
}

fn bits(number: i64) -> u64 {
    u64::from_ne_bytes(number.to_ne_bytes())
}

/// The chosen one of these numbers.
fn argument(numbers: &[u64]) -> u64 {
    let place = PLACE.load(Ordering::Relaxed);
    numbers.get(place).copied().unwrap_or(0)
}

/// Chooses the byte that [`checksum`] depends on, and a key.
pub fn choose_checksum(key: u32, place: usize) {
    KEY.store(key, Ordering::Relaxed);
    PLACE.store(place, Ordering::Relaxed);
}

/// CRC-32: an unknown function of the number of bytes and of an unknown one of them.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u32 {
    let byte = bytes
        .get(PLACE.load(Ordering::Relaxed))
        .copied()
        .unwrap_or(0);
    let length = u16::try_from(bytes.len()).unwrap_or(u16::MAX);
    KEY.load(Ordering::Relaxed) ^ u32::from(byte) ^ (u32::from(length) << 8)
}
