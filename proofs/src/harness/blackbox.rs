//! A black box over a sequence of ticks, any of which ends a session or is followed by a release.

use gantry_tau_core::axis::Offsets;
use gantry_tau_core::channel::Limits;
use gantry_tau_core::message::Cause;
use gantry_tau_core::session::config::{AxisConfig, Config, Parameters, Travel};
use gantry_tau_core::session::{BlackBox, Input, Output, Session};
use gantry_tau_core::units::{Epoch, PositionNm, Tick};

use crate::blackbox;

/// A session of one axis that nobody talks to.
fn session_at_rest() -> Session<1> {
    let axis = AxisConfig::position_only(Limits::DISABLED, Travel::around_zero(0), 0);
    let config = Config::new(Parameters::thesis([axis])).unwrap();
    let nominal = [PositionNm(0)];
    Session::new(config, &[Offsets::default()], nominal, Tick(0), Epoch(0)).unwrap()
}

/// Records ticks `1..=TICKS` of a session of one axis. Entries are copied whole, whatever is in them: only their number and
/// whether a session ended matter to the box.
fn check<const HALF: usize, const TICKS: u64>() {
    let mut black_box = BlackBox::<1, HALF>::new();
    let mut session = session_at_rest();
    let mut recorded = 0_usize;
    let mut latest = Tick(0);
    for _ in 0..TICKS {
        black_box.before_tick(&session);
        let input = Input::nothing();
        let mut output: Output<1> = session.tick(&input);
        output.ended = kani::any::<bool>().then_some(Cause::Closed);
        let frozen = black_box.is_frozen();
        black_box.after_tick(&input, &output);
        if !frozen {
            recorded += 1;
            latest = output.state.tick;
        }
        if kani::any() {
            black_box.release();
            recorded = 0;
        }
    }
    blackbox::holds_the_end(&black_box, latest, recorded);
    kani::cover!(black_box.is_frozen(), "a cause froze it");
    kani::cover!(recorded > 3 * HALF, "the oldest were dropped");
}

#[kani::proof]
#[kani::unwind(9)]
#[kani::solver(minisat)]
fn blackbox_holds_the_end_1() {
    check::<1, 7>();
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(12)]
#[kani::solver(minisat)]
fn blackbox_holds_the_end_2() {
    check::<2, 10>();
    kani::cover!(true, "the end is reached");
}
