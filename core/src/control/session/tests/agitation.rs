//! The agitation budget: a client that shakes is ended, and nothing else is.

use super::*;
use crate::control::agitation::AgitationBudget;

/// `r`, nm per tick.
const R: u32 = 100;
/// `B`, nm.
const B: i64 = 100_000;

/// The usual machine with a budget on its first axis.
fn with_budget() -> Parameters<2> {
    let mut parameters = parameters();
    parameters.axes[0].agitation = AgitationBudget::new(R);
    parameters
}

/// A session in Submit.
fn submitting(parameters: Parameters<2>) -> Bench {
    let mut bench = Bench::new(parameters);
    bench.play(&Hello);
    bench.play(&submit(0));
    bench
}

/// Targets that swing between the two sides, a step either way.
fn shake(tick: i32) -> [Offsets; 2] {
    at(if tick % 2 == 0 { 2_500 } else { -2_500 })
}

impl Bench {
    /// Plays a move; returns its output and the second difference of the first axis' offset.
    fn differ(&mut self, one: &Move) -> (Output<2>, i64) {
        let before = self.session.parts().axes[0].channels.position.change();
        let output = self.play(one);
        let after = self.session.parts().axes[0].channels.position.change();
        (output, i64::from(after) - i64::from(before))
    }

    /// Agitation of the first axis, nm.
    fn agitation(&self) -> u32 {
        self.session.parts().axes[0].agitation.0
    }

    /// Shakes the first axis until the session ends; returns the ticks of Obtain and their sum of
    /// second differences.
    fn shake_to_the_end(&mut self) -> (i32, i64) {
        let (mut ticks, mut sum, mut last) = (0, 0, 0);
        loop {
            let (output, second) = self.differ(&Move::Answer(Mode::Obtain, shake(ticks)));
            if let Some(cause) = output.ended {
                assert_eq!(cause, Cause::Agitated);
                assert_eq!(output.state.phase, SafeDisconnect);
                // The tick that took the sum above the budget is the last of Obtain.
                assert!(sum > B + i64::from(R) * i64::from(ticks));
                assert!(sum - last <= B + i64::from(R) * i64::from(ticks - 1));
                return (ticks, sum);
            }
            assert_eq!(output.state.phase, Obtain);
            (ticks, last) = (ticks + 1, second.abs());
            sum += last;
        }
    }
}

/// The bench's monitor checks every tick: no step beyond the limits, and an exact ramp.
#[test]
fn a_client_that_shakes_is_ended_and_ramps() {
    let mut bench = submitting(with_budget());
    let (ticks, sum) = bench.shake_to_the_end();
    assert_eq!((ticks, sum), (12, 110_000));
    assert_eq!(bench.agitation(), 0);
    let mut offset = bench.offset();
    while offset != 0 {
        let output = bench.play(&Silence);
        assert_eq!(output.state.phase, SafeDisconnect);
        assert_eq!(bench.offset().abs(), (offset.abs() - 100).max(0));
        offset = bench.offset();
        assert_eq!(bench.agitation(), 0, "the ramp does not count");
    }
    let output = bench.play(&Silence);
    assert_eq!(
        (output.state.phase, output.state.cause, bench.agitation()),
        (Listening, Cause::Agitated, 0)
    );
    // The next session begins with the whole budget.
    bench.play(&Hello);
    bench.play(&submit(0));
    assert_eq!(bench.shake_to_the_end(), (ticks, sum));
}

#[test]
fn without_a_budget_any_client_may_shake() {
    let mut bench = submitting(parameters());
    for tick in 0..1_000 {
        let output = bench.play(&Move::Answer(Mode::Obtain, shake(tick)));
        assert_eq!((output.ended, bench.agitation()), (None, 0));
    }
    // An axis without budget beside one with it; the latter rests.
    let mut bench = submitting(with_budget());
    for tick in 0..1_000 {
        let [_, other] = shake(tick);
        let output = bench.play(&Move::Answer(Mode::Obtain, [Offsets::ZERO, other]));
        assert_eq!((output.ended, bench.agitation()), (None, 0));
    }
}

#[test]
fn a_quiet_client_is_never_ended() {
    let mut bench = submitting(with_budget());
    let (mut offset, mut change) = (0, 0);
    for tick in 0..20_000 {
        // The change swings by r per tick, between 2 um per tick and its opposite.
        change += if tick % 80 < 20 || tick % 80 >= 60 {
            100
        } else {
            -100
        };
        offset += change;
        let output = bench.play(&obtain(offset));
        assert_eq!((output.ended, bench.offset()), (None, offset));
        assert_eq!(bench.agitation(), 0);
    }
}

#[test]
fn what_the_server_does_is_not_charged_to_the_client() {
    // In Submit the shadow is shaken, and no offset.
    let mut bench = submitting(with_budget());
    for tick in 0..1_000 {
        bench.play(&Move::Answer(Mode::Submit, shake(tick)));
        assert_eq!(bench.agitation(), 0);
    }
    // Back to zero by Submit in Obtain counts; in Submit the sum begins at zero again.
    bench.play(&obtain(2_500));
    assert_eq!(bench.agitation(), 2_400);
    bench.play(&submit(0));
    assert_eq!((bench.session.phase(), bench.agitation()), (Obtain, 7_300));
    bench.play(&submit(0));
    assert_eq!((bench.session.phase(), bench.agitation()), (Submit, 0));
    // A held tick is one of Obtain: the offset stops.
    bench.play(&obtain(5_000));
    bench.play(&Silence);
    assert_eq!((bench.session.phase(), bench.agitation()), (Obtain, 9_800));
    // A stop, and references that the drives refuse.
    for end in [STOP, Written(LastWrite::Unknown)] {
        let mut bench = bench.clone();
        bench.play(&end);
        assert_eq!((bench.session.phase(), bench.agitation()), (Fault, 0));
    }
}

#[test]
fn agitation_ends_a_session_before_a_miss_and_after_a_goodbye() {
    let mut bench = submitting(with_budget());
    let mut tick = 0;
    while i64::from(bench.agitation()) <= B {
        bench.play(&Move::Answer(Mode::Obtain, shake(tick)));
        tick += 1;
    }
    let mut last = bench.clone();
    let output = last.play(&Silence);
    assert_eq!(
        (output.ended, output.state.counters.missed),
        (Some(Cause::Agitated), 0)
    );
    assert_eq!(bench.clone().play(&Goodbye).ended, Some(Cause::Goodbye));
    assert_eq!(bench.play(&STOP).ended, Some(Cause::Stop));
}
