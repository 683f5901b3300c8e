//! What of all that arrives is allowed to decide: T7, one event at a time. Any sequence of events follows by induction, for what
//! has been heard so far is arbitrary, and depends on nothing that only counts.

use gantry_tau_core::message::{ClientMessage, Command, Mode, Phase};
use gantry_tau_core::session::Event;
use gantry_tau_core::session::decide::Connection;
use gantry_tau_core::session::sift::{Heard, Noted, Sieve, Verdict};

/// T7: what does not come from the owner, and what the owner sends that is not fresh, decides nothing.
/// A Hello is the one word of a stranger that can, and only in Listening, where there is no owner.
///
/// # Panics
/// When it does not hold.
pub fn only_the_owner_decides<const N: usize>(
    sieve: &Sieve<'_, N>,
    connection: Connection,
    event: &Event<N>,
    heard: &Heard<N>,
    noted: &mut Noted,
) {
    let mut after = *heard;
    sieve.hear(connection, event, &mut after, noted);
    if sieve.discrete.owner == Some(connection) {
        if !owner_may_decide(sieve, event) {
            assert!(after == *heard, "T7: what is not fresh decides nothing");
        }
        return;
    }
    if sieve.discrete.phase != Phase::Listening {
        assert!(after == *heard, "T7: a stranger decides nothing");
    }
    let hello = after.arrivals.hello;
    after.arrivals.hello = heard.arrivals.hello;
    assert!(after == *heard, "T7: a stranger can only ask");
    assert!(
        hello == heard.arrivals.hello || hello == Some((connection, sieve.next_epoch)),
        "T7: and only for itself"
    );
}

/// Whether this event of the owner is one that may decide.
fn owner_may_decide<const N: usize>(sieve: &Sieve<'_, N>, event: &Event<N>) -> bool {
    match event {
        Event::Broken(_) | Event::Flood | Event::Closed => true,
        Event::Malformed(_) | Event::Dropped(_) => false,
        Event::Message(message) => match message {
            ClientMessage::Command(command) => is_fresh(sieve, command),
            ClientMessage::Goodbye(epoch) | ClientMessage::Stop(epoch) => {
                *epoch == sieve.discrete.epoch
            }
            ClientMessage::Hello(_) => false,
        },
    }
}

/// The definition of fresh (DESIGN section 4), for a command of the owner, in the mathematician's integers.
#[must_use]
pub fn is_fresh<const N: usize>(sieve: &Sieve<'_, N>, command: &Command<N>) -> bool {
    let discrete = sieve.discrete;
    let ahead = i128::from(command.sequence.0) - i128::from(discrete.accepted.0);
    let behind = i128::from(discrete.tick.0) - i128::from(command.echo.0);
    let mode_has_its_place = discrete.phase != Phase::Handshake || command.mode == Mode::Submit;
    let admits = |axis: usize| {
        let limits = &sieve.parameters.axes[axis].limits;
        limits.admits(&command.targets[axis])
    };
    discrete.is_live()
        && command.epoch == discrete.epoch
        && (1..=65_536).contains(&ahead)
        && (0..=i128::from(sieve.parameters.echo_window)).contains(&behind)
        && mode_has_its_place
        && (0..N).all(admits)
}

/// Fresh is what the definition says, both ways.
///
/// # Panics
/// When it does not hold.
pub fn fresh_is_as_defined<const N: usize>(sieve: &Sieve<'_, N>, command: &Command<N>) {
    let fresh = sieve.judge(command) == Verdict::Fresh;
    assert!(fresh == is_fresh(sieve, command), "T7: fresh as defined");
}

/// T7's induction: what only counts does not decide, now or later.
///
/// # Panics
/// When it does not hold.
pub fn counts_decide_nothing<const N: usize>(
    sieve: &Sieve<'_, N>,
    connection: Connection,
    event: &Event<N>,
    heard: &Heard<N>,
    (one, other): (&mut Noted, &mut Noted),
) {
    let (mut a, mut b) = (*heard, *heard);
    sieve.hear(connection, event, &mut a, one);
    sieve.hear(connection, event, &mut b, other);
    assert!(a == b, "T7: what counts decides nothing");
}
