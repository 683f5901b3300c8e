//! Accelerations of the nominal path beyond their limit, logged once per session.

use gantry_tau_core::control::message::AxisFlags;

use crate::record::TickRecord;

/// The nominal references of the last two rows, and whether this session's first acceleration is
/// logged.
#[derive(Debug, Default)]
pub(super) struct Path {
    before_nm: Vec<i64>,
    last_nm: Vec<i64>,
    is_logged: bool,
}

impl Path {
    /// Takes the row of the next tick.
    pub(super) fn see<const N: usize>(&mut self, row: &TickRecord<N>) {
        self.is_logged &= !row.welcomed;
        let now_nm = row.state.axes.map(|axis| axis.nominal.0);
        let mut axes = (1..).zip(&row.state.axes);
        let first = axes.find(|(_, axis)| axis.flags.contains(AxisFlags::NOMINAL_ACCEL));
        if let (Some((number, _)), false) = (first, self.is_logged) {
            let tick = row.state.tick.0;
            let change = self.second_difference(number - 1, &now_nm);
            tracing::warn!(
                "tick {tick}: the nominal path of axis {number} accelerated by {change} µm per tick², more than \
                 its limit; further ones of this session are only flagged"
            );
            self.is_logged = true;
        }
        std::mem::swap(&mut self.before_nm, &mut self.last_nm);
        self.last_nm.clear();
        self.last_nm.extend(now_nm);
    }

    /// Second difference of the nominal reference of an axis, µm, in three ticks one after the
    /// other, as flagged ones are.
    fn second_difference(&self, axis: usize, now_nm: &[i64]) -> f64 {
        let at = |nm: &[i64]| nm.get(axis).copied().unwrap_or_default();
        let change = |from: &[i64], to: &[i64]| at(to).saturating_sub(at(from));
        let second =
            change(&self.last_nm, now_nm).saturating_sub(change(&self.before_nm, &self.last_nm));
        second as f64 * 1e-3
    }
}

#[cfg(test)]
mod tests {
    use gantry_tau_core::units::PositionNm;
    use gantry_tau_test_support::logged::logged;

    use super::*;

    /// Shows ticks in which the second axis is there, of which some are flagged; returns the lines.
    fn lines(path: &mut Path, ticks: &[(i64, bool)]) -> Vec<String> {
        let ((), lines) = logged(|| {
            for (tick, (nominal, is_flagged)) in (1..).zip(ticks) {
                let mut row = TickRecord::<2>::listening();
                row.state.tick.0 = tick;
                row.state.axes[1].nominal = PositionNm(*nominal);
                row.state.axes[1].flags =
                    AxisFlags::default().with(AxisFlags::NOMINAL_ACCEL, *is_flagged);
                path.see(&row);
            }
        });
        lines.lines().map(str::to_owned).collect()
    }

    #[test]
    fn the_first_of_a_session_is_logged_with_axis_and_value() {
        let mut path = Path::default();
        let ticks = [(0, false), (1_000, false), (-23_000, true), (5_000, true)];
        let said = lines(&mut path, &ticks);
        assert_eq!(said.len(), 1, "{said:?}");
        assert!(
            said[0].contains("tick 3: the nominal path of axis 2 accelerated by -25 µm per tick²"),
            "{said:?}"
        );
        assert!(said[0].contains("WARN"), "{said:?}");
        assert_eq!(lines(&mut path, &ticks), Vec::<String>::new());
        let mut granted = TickRecord::<2>::listening();
        granted.welcomed = true;
        path.see(&granted);
        assert_eq!(lines(&mut path, &ticks).len(), 1);
    }
}
