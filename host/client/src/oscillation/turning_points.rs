//! Turning points of a sequence, with hysteresis.

/// Value of a tick.
#[derive(Clone, Copy, Debug)]
struct OffsetPoint {
    tick: u64,
    nm: i32,
}

/// Way from one turning point to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Swing {
    /// Distance of their values, nm.
    pub(super) nm: u32,
    /// Their distance in time.
    pub(super) ticks: u64,
}

/// Direction in which the values go, with the extremes since the last turning point.
#[derive(Clone, Copy, Debug, Default)]
enum Course {
    /// No value yet.
    #[default]
    Unknown,
    /// All values are within the hysteresis.
    Level {
        lowest: OffsetPoint,
        highest: OffsetPoint,
    },
    Rising {
        highest: OffsetPoint,
    },
    Falling {
        lowest: OffsetPoint,
    },
}

/// Finder of turning points: an extreme is one as soon as the values have gone back by more than
/// the hysteresis.
#[derive(Clone, Copy, Debug)]
pub(super) struct TurningPoints {
    hysteresis_nm: u32,
    course: Course,
    last: Option<OffsetPoint>,
}

impl TurningPoints {
    pub(super) const fn new(hysteresis_nm: u32) -> Self {
        Self {
            hysteresis_nm,
            course: Course::Unknown,
            last: None,
        }
    }

    /// Forgets all values.
    pub(super) const fn restart(&mut self) {
        *self = Self::new(self.hysteresis_nm);
    }

    /// Takes the value of a tick. Returns the swing that ended, if a turning point was found and
    /// there was one before it.
    pub(super) fn update(&mut self, tick: u64, nm: i32) -> Option<Swing> {
        let (course, turned) = self.next(OffsetPoint { tick, nm });
        self.course = course;
        let end = turned?;
        let start = self.last.replace(end)?;
        Some(Swing {
            nm: end.nm.abs_diff(start.nm),
            ticks: end.tick.saturating_sub(start.tick),
        })
    }

    /// Returns the course with a further value, and the turning point that it shows.
    fn next(&self, now: OffsetPoint) -> (Course, Option<OffsetPoint>) {
        match self.course {
            Course::Unknown => {
                let (lowest, highest) = (now, now);
                (Course::Level { lowest, highest }, None)
            }
            Course::Level { lowest, highest } => (self.leave_level(lowest, highest, now), None),
            Course::Rising { highest } if now.nm > highest.nm => {
                (Course::Rising { highest: now }, None)
            }
            Course::Rising { highest } if self.is_beyond(now, highest) => {
                (Course::Falling { lowest: now }, Some(highest))
            }
            Course::Falling { lowest } if now.nm < lowest.nm => {
                (Course::Falling { lowest: now }, None)
            }
            Course::Falling { lowest } if self.is_beyond(now, lowest) => {
                (Course::Rising { highest: now }, Some(lowest))
            }
            unchanged => (unchanged, None),
        }
    }

    /// Returns the course of values that were level. The extreme that they leave is where they
    /// began, not a turning point.
    fn leave_level(&self, lowest: OffsetPoint, highest: OffsetPoint, now: OffsetPoint) -> Course {
        if now.nm > lowest.nm && self.is_beyond(now, lowest) {
            Course::Rising { highest: now }
        } else if now.nm < highest.nm && self.is_beyond(now, highest) {
            Course::Falling { lowest: now }
        } else {
            Course::Level {
                lowest: if now.nm < lowest.nm { now } else { lowest },
                highest: if now.nm > highest.nm { now } else { highest },
            }
        }
    }

    const fn is_beyond(&self, now: OffsetPoint, extreme: OffsetPoint) -> bool {
        now.nm.abs_diff(extreme.nm) > self.hysteresis_nm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Swings of a sequence, one value per tick.
    fn swings(hysteresis_nm: u32, values: &[i32]) -> Vec<(u32, u64)> {
        let mut points = TurningPoints::new(hysteresis_nm);
        (0..)
            .zip(values)
            .filter_map(|(tick, nm)| points.update(tick, *nm))
            .map(|swing| (swing.nm, swing.ticks))
            .collect()
    }

    #[test]
    fn a_swing_is_from_extreme_to_extreme() {
        // Extremes 20, -10, 30; the last one is open.
        let values = [0, 10, 20, 5, -10, 0, 30, 10, 0];
        assert_eq!(swings(9, &values), [(30, 2), (40, 2)]);
    }

    /// The way from where a sequence begins to its first extreme is half a swing of a sine: it does
    /// not count, whether it leads up or down.
    #[test]
    fn the_first_way_is_not_a_swing() {
        let up = [0, 20, -20, 20, -20];
        let down = up.map(|nm: i32| -nm);
        assert_eq!(swings(9, &up), swings(9, &down));
        assert_eq!(swings(9, &up), [(40, 1), (40, 1)]);
    }

    #[test]
    fn values_within_the_hysteresis_are_level() {
        assert_eq!(swings(10, &[0, 10, 0, 10, 0, 10, 0]), []);
        let wider = swings(10, &[0, 11, 0, 11, 0, 11, 0]);
        assert_eq!(wider, [(11, 1), (11, 1), (11, 1), (11, 1)]);
        // Noise on a rise is not a turning point.
        assert_eq!(swings(10, &[0, 8, 2, 14, 6, 20, 12, 26]), []);
    }

    /// A constant value keeps its first tick, as of targets that a limit cuts.
    #[test]
    fn a_plateau_turns_where_it_began() {
        let values = [0, 50, 50, 50, 0, 0, 0, 50, 50, 0];
        assert_eq!(swings(10, &values), [(50, 3), (50, 3)]);
    }

    #[test]
    fn the_widest_swing_fits() {
        let widest = [0, i32::MAX, i32::MIN, i32::MAX, i32::MIN];
        assert_eq!(swings(10, &widest), [(u32::MAX, 1), (u32::MAX, 1)]);
    }
}
