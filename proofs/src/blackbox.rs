//! T11: what a black box holds.

use gantry_tau_core::session::{BlackBox, Input, Output, Session};
use gantry_tau_core::units::Tick;

/// Records one tick, as the endpoint does.
pub fn record<const N: usize, const HALF: usize>(
    black_box: &mut BlackBox<N, HALF>,
    session: &mut Session<N>,
    input: &Input<N>,
) -> Output<N> {
    black_box.before_tick(session);
    let output = session.tick(input);
    black_box.after_tick(input, &output);
    output
}

/// T11, the bookkeeping: the entries are ticks that follow each other without a gap, up to the latest recorded one; the session
/// they begin with is the one before the first; and there are enough of them.
///
/// # Panics
/// When it does not hold.
pub fn holds_the_end<const N: usize, const HALF: usize>(
    black_box: &BlackBox<N, HALF>,
    latest: Tick,
    recorded: usize,
) {
    let mut count = 0_usize;
    let mut last = black_box
        .before()
        .map(|session| session.parts().discrete.tick);
    for entry in black_box.entries() {
        let tick = entry.output.state.tick;
        assert!(
            last.map(|last| last.0 + 1) == Some(tick.0),
            "T11: no gap, from the session before the first on"
        );
        last = Some(tick);
        count += 1;
    }
    assert!(
        count == 0 || last == Some(latest),
        "T11: up to the latest tick"
    );
    assert!(
        count >= recorded.min(2 * HALF) && count <= 3 * HALF,
        "T11: at least 2 HALF ticks, where there were as many"
    );
}
