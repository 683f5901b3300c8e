//! References of a cycle in which no tick is run.

use crate::control::axis::Reference;
use crate::units::PositionNm;
use crate::zip::zip;

use super::Session;
use super::act::{drive_reference, nominal_stepped};

/// References of a cycle in which no tick is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Held<const N: usize> {
    /// References of the axes, or motors.
    pub references: [Reference; N],
    /// They are on the nominal references of the cycle; otherwise on those of the last tick.
    pub follows: bool,
}

impl<const N: usize> Session<N> {
    /// Returns the references of a cycle in which no tick is run, `cycles` after the last one: the
    /// offsets of the last tick on these nominal references. If one of them is further from that of
    /// the last tick than its limit in so many cycles, all axes stay at those of the last tick.
    ///
    /// Nothing changes, and the next tick counts the cycle among its own.
    #[must_use]
    pub fn hold(&self, nominal: &[PositionNm; N], cycles: u32) -> Held<N> {
        let configs = &self.config().parameters().axes;
        let demanded = self.demanded();
        let from = demanded.map(|axis| axis.nominal);
        let mut moves = zip(&from, nominal).zip(configs);
        let follows =
            !moves.any(|((from, to), config)| nominal_stepped(*from, *to, config, cycles));
        let mut references = [Reference::ZERO; N];
        let nominal = if follows { nominal } else { &from };
        for (place, ((axis, nominal), config)) in references
            .iter_mut()
            .zip(zip(&demanded, nominal).zip(configs))
        {
            *place = drive_reference(*nominal, &axis.offsets, &config.machine_travel).0;
        }
        Held {
            references,
            follows,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::fixture::{axis, limits};
    use crate::control::session::bench::{Bench, Move, obtain, submit};
    use crate::control::session::config::Parameters;

    #[test]
    fn held_references_are_those_of_a_tick_that_misses() {
        let travel = 10_000_000;
        let parameters =
            Parameters::thesis([axis(limits(1_000_000, 5_000, 10_000, 100), travel, 1_000_000); 2]);
        let mut bench = Bench::new(parameters);
        bench.play(&Move::Hello);
        bench.play(&submit(0));
        let last = (0..10).map(|_| bench.play(&obtain(20_000))).last().unwrap();
        // The path goes on, by as much as it may; and by more, in as many cycles as that takes.
        for (nominal, cycles) in [
            ([500, -1_000_000], 1),
            ([-1_000_001, 7], 2),
            ([9_000_000, -9_000_000], 9),
        ] {
            let nominal = nominal.map(PositionNm);
            let held = bench.session.hold(&nominal, cycles);
            assert!(held.follows);
            assert_eq!(
                held.references.map(|one| one.position.0),
                nominal.map(|one| one.0 + 20_000)
            );
        }
        for nominal in [[1_000_001, 0], [0, -1_000_001], [i64::MAX, i64::MIN]] {
            let held = bench.session.hold(&nominal.map(PositionNm), 1);
            assert_eq!(
                (held.follows, held.references),
                (false, last.references),
                "all axes stay: {nominal:?}"
            );
        }
        // Nothing has changed: one miss is tolerated, with the same references.
        let nominal = [PositionNm(123), PositionNm(-456)];
        let held = bench.session.hold(&nominal, 1);
        assert_eq!(
            held.references,
            bench.play_at(&Move::Silence, nominal).references
        );
    }

    #[test]
    fn held_references_stay_within_the_travel() {
        let mut parameters = Parameters::thesis(
            [axis(limits(1_000_000, 5_000, 10_000, 100), 10_000_000, u32::MAX); 2],
        );
        let end = parameters.axes[0].machine_travel.upper;
        parameters.axes[1].nominal_step_nm = 0;
        let bench = Bench::new(parameters);
        let held = bench
            .session
            .hold(&[PositionNm(end.0 + 5), PositionNm(0)], 1);
        assert_eq!((held.follows, held.references[0].position), (true, end));
    }
}
