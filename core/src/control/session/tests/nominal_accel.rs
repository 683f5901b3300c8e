//! The second difference of the nominal reference: flagged, passed on, and a fault where it is said
//! to be one.

use core::num::NonZeroU32;

use super::*;
use crate::control::session::config::NominalAccel;

const LIMIT_NM: i64 = 20_000;

/// A server whose second axis has the limit, at rest on the path.
fn bench(is_fault: bool) -> Bench {
    let mut parameters = parameters();
    let nm = NonZeroU32::new(20_000).unwrap();
    parameters.axes[1].nominal_accel = Some(NominalAccel { nm, is_fault });
    let mut bench = Bench::new(parameters);
    for _ in 0..3 {
        assert!(!is_flagged(&bench.play(&Silence)));
    }
    bench
}

/// True if the second axis is flagged; the first has no limit.
fn is_flagged(output: &Output<2>) -> bool {
    let [first, second] = output.state.axes.map(|axis| axis.flags);
    assert!(!first.contains(AxisFlags::NOMINAL_ACCEL));
    second.contains(AxisFlags::NOMINAL_ACCEL)
}

/// Plays one tick with both axes there. Returns whether the second is flagged.
fn flagged_at(bench: &mut Bench, one: &Move, nominal: i64) -> bool {
    let (output, positions) = play_at(bench, one, [nominal; 2]);
    assert_eq!(positions, [nominal; 2], "passed on");
    is_flagged(&output)
}

#[test]
fn more_than_the_limit_is_flagged_and_passed_on() {
    let mut bench = bench(false);
    let mut nominal = 0;
    // By the limit, by one more; on at that speed; back to rest at once.
    for (change, is_beyond) in [
        (LIMIT_NM, false),
        (2 * LIMIT_NM + 1, true),
        (2 * LIMIT_NM + 1, false),
        (LIMIT_NM, true),
        (0, false),
        (-LIMIT_NM - 1, true),
        (-LIMIT_NM - 1, false),
    ] {
        nominal += change;
        assert_eq!(flagged_at(&mut bench, &Silence, nominal), is_beyond);
        assert_eq!(bench.session.phase(), Listening);
    }
}

#[test]
fn a_session_goes_on_unless_it_is_said_to_be_a_fault() {
    for (is_fault, phase, ended) in [(false, Obtain, None), (true, Fault, Some(Cause::Nominal))] {
        let mut bench = bench(is_fault);
        bench.play(&Hello);
        bench.play(&submit(0));
        bench.play(&obtain(0));
        let (output, positions) = play_at(&mut bench, &obtain(0), [LIMIT_NM + 1; 2]);
        assert!(is_flagged(&output));
        assert_eq!(positions, [LIMIT_NM + 1; 2]);
        assert_eq!((output.state.phase, output.ended), (phase, ended));
        assert_eq!(output.latched, is_fault);
    }
}

/// After a skipped cycle, a failed reading, a refused write: the path may be anywhere, as far as its
/// step allows, for two ticks.
#[test]
fn two_ticks_pass_after_an_interruption() {
    let skipped = Late(2, at(0));
    let refused = Written(LastWrite::Refused {
        in_force: in_force(0),
    });
    for interruption in [&skipped, &refused] {
        let mut bench = bench(true);
        let far = 10 * LIMIT_NM;
        for (one, nominal, is_beyond) in [
            (interruption, far, false),
            (&Silence, -far, false),
            (&Silence, -far, true),
        ] {
            let found = flagged_at(&mut bench, one, nominal);
            assert_eq!(found, is_beyond, "{interruption:?}, then at {nominal}");
        }
    }
}

#[test]
fn what_is_not_read_is_not_judged() {
    let mut bench = bench(true);
    bench.tick_with(&[], |input| input.tick.reading = None);
    let far = 10 * LIMIT_NM;
    for (nominal, is_beyond) in [(far, false), (-far, false), (-far, true)] {
        assert_eq!(flagged_at(&mut bench, &Silence, nominal), is_beyond);
    }
}

/// An axis that is held at the references in force is not on the path.
#[test]
fn a_path_that_is_waited_for_is_not_judged() {
    let mut bench = bench(true);
    let refused = Written(LastWrite::Refused {
        in_force: in_force(0),
    });
    let step = 1_000_000;
    for (one, nominal) in [
        (&refused, 3 * step),
        (&Silence, 5 * step),
        (&Silence, -7 * step),
    ] {
        let (output, positions) = play_at(&mut bench, one, [nominal; 2]);
        assert_eq!((is_flagged(&output), positions), (false, [0; 2]));
    }
    assert!(!flagged_at(&mut bench, &Silence, step));
    assert!(!flagged_at(&mut bench, &Silence, step));
    assert!(flagged_at(&mut bench, &Silence, step + LIMIT_NM + 1));
}
