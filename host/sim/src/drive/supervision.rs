//! Supervision of a drive: its states, the watchdog of its cyclic data, and its following error.
//! Integers only.
//!
//! ```text
//! NotReady -- on the reference --> Ready -- new data --> Operating
//!    ^                                                      | watchdog, following error, or another drive of the axis
//!    '------ reset ------ Fault <-- at rest -- QuickStop <--'
//! ```

use gantry_tau_server::plant::DriveState;

/// Limits of a drive that stops by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Cycles without new data until the quick stop.
    pub watchdog_cycles: u32,
    /// Following error that is tolerated for any time, nm (CiA 402: 6065h).
    pub window_nm: u64,
    /// Cycles in a row outside the window until the quick stop (6066h).
    pub window_cycles: u32,
}

/// Cause of a drive's quick stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trip {
    /// No new data came.
    Watchdog,
    /// The position was outside the window for too long.
    FollowingError,
    /// Another drive of the same axis stopped.
    Partner,
}

impl Trip {
    /// Returns the cause in words.
    #[must_use]
    pub const fn reason(self) -> &'static str {
        match self {
            Self::Watchdog => {
                "a drive stopped by itself: no new references came (drives.watchdog_cycles)"
            }
            Self::FollowingError => {
                "a drive stopped by itself: its following error was too large (drives.following_error_um)"
            }
            Self::Partner => "a drive stopped by itself: another drive of its axis stopped",
        }
    }
}

/// Observations of one cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Observed {
    /// New data came for this cycle.
    pub is_fresh: bool,
    /// Following error at its end, nm.
    pub error_nm: i64,
    /// The reference in force is reached: the drive has moved onto it after a reset.
    pub is_on_reference: bool,
    /// The ramp of the quick stop has ended, and the motor stands.
    pub is_at_rest: bool,
}

/// State of the supervision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Supervision {
    limits: Option<Limits>,
    state: DriveState,
    trip: Option<Trip>,
    /// Cycles since new data came.
    silent: u32,
    /// Cycles in a row outside the window.
    outside: u32,
}

impl Supervision {
    /// Creates the supervision of a drive that waits for its first data.
    #[must_use]
    pub const fn new(limits: Option<Limits>) -> Self {
        Self {
            limits,
            state: DriveState::Ready,
            trip: None,
            silent: 0,
            outside: 0,
        }
    }

    /// Returns the state of the drive.
    #[must_use]
    pub const fn state(&self) -> DriveState {
        self.state
    }

    /// Returns the cause of the last quick stop, until the reset.
    #[must_use]
    pub const fn trip(&self) -> Option<Trip> {
        self.trip
    }

    /// Takes one cycle; the state that it leads to is that of the next.
    pub fn observe(&mut self, observed: &Observed) {
        self.state = match self.state {
            DriveState::NotReady if observed.is_on_reference => DriveState::Ready,
            DriveState::Ready | DriveState::Operating if observed.is_fresh => DriveState::Operating,
            DriveState::QuickStop if observed.is_at_rest => DriveState::Fault,
            unchanged => unchanged,
        };
        if let (DriveState::Operating, Some(limits)) = (self.state, self.limits) {
            self.silent = if observed.is_fresh {
                0
            } else {
                self.silent.saturating_add(1)
            };
            let is_outside = observed.error_nm.unsigned_abs() > limits.window_nm;
            self.outside = if is_outside {
                self.outside.saturating_add(1)
            } else {
                0
            };
            if self.silent >= limits.watchdog_cycles {
                self.stop(Trip::Watchdog);
            } else if self.outside >= limits.window_cycles {
                self.stop(Trip::FollowingError);
            }
        }
    }

    /// Stops the drive, unless it has stopped already.
    pub fn stop(&mut self, trip: Trip) {
        if !matches!(self.state, DriveState::QuickStop | DriveState::Fault) {
            (self.state, self.trip) = (DriveState::QuickStop, Some(trip));
        }
    }

    /// Acknowledges a fault. Returns true if there was one.
    pub fn reset(&mut self) -> bool {
        let is_faulty = self.state == DriveState::Fault;
        if is_faulty {
            *self = Self {
                state: DriveState::NotReady,
                ..Self::new(self.limits)
            };
        }
        is_faulty
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use DriveState::{Fault, NotReady, Operating, QuickStop, Ready};

    const LIMITS: Limits = Limits {
        watchdog_cycles: 3,
        window_nm: 2_000_000,
        window_cycles: 10,
    };
    const FRESH: Observed = Observed {
        is_fresh: true,
        error_nm: 0,
        is_on_reference: false,
        is_at_rest: false,
    };
    const SILENT: Observed = Observed {
        is_fresh: false,
        ..FRESH
    };

    fn operating() -> Supervision {
        let mut drive = Supervision::new(Some(LIMITS));
        drive.observe(&FRESH);
        drive
    }

    /// Observes this many equal cycles and returns the states after each.
    fn states(drive: &mut Supervision, observed: &Observed, cycles: usize) -> Vec<DriveState> {
        (0..cycles)
            .map(|_| {
                drive.observe(observed);
                drive.state()
            })
            .collect()
    }

    #[test]
    fn silence_stops_a_drive_that_has_heard_something() {
        let mut drive = Supervision::new(Some(LIMITS));
        assert_eq!(states(&mut drive, &SILENT, 100), [Ready; 100]);
        assert_eq!(states(&mut drive, &FRESH, 1), [Operating]);
        assert_eq!(states(&mut drive, &SILENT, 2), [Operating; 2]);
        assert_eq!(
            states(&mut drive, &FRESH, 1),
            [Operating],
            "new data in time"
        );
        assert_eq!(
            states(&mut drive, &SILENT, 4),
            [Operating, Operating, QuickStop, QuickStop]
        );
        assert_eq!(
            states(&mut drive, &FRESH, 5),
            [QuickStop; 5],
            "late data change nothing"
        );
        assert_eq!(
            states(
                &mut drive,
                &Observed {
                    is_at_rest: true,
                    ..FRESH
                },
                2
            ),
            [Fault; 2]
        );
        assert_eq!(drive.trip(), Some(Trip::Watchdog));
    }

    #[test]
    fn a_following_error_counts_in_a_row_and_beyond_the_window() {
        let (inside, outside) = (2_000_000, 2_000_001);
        for sign in [1, -1] {
            let mut drive = operating();
            let [inside, outside] = [inside, outside].map(|error_nm| Observed {
                error_nm: sign * error_nm,
                ..FRESH
            });
            assert_eq!(states(&mut drive, &inside, 100), [Operating; 100]);
            assert_eq!(states(&mut drive, &outside, 9), [Operating; 9]);
            assert_eq!(states(&mut drive, &inside, 1), [Operating]);
            assert_eq!(states(&mut drive, &outside, 9), [Operating; 9]);
            assert_eq!(states(&mut drive, &outside, 1), [QuickStop]);
            assert_eq!(drive.trip(), Some(Trip::FollowingError));
        }
        let mut drive = operating();
        states(
            &mut drive,
            &Observed {
                error_nm: i64::MIN,
                ..FRESH
            },
            10,
        );
        assert_eq!(drive.state(), QuickStop);
    }

    #[test]
    fn only_a_fault_is_reset_and_nothing_moves_before_the_reference_is_reached() {
        let mut drive = operating();
        assert!(!drive.reset(), "there is no fault");
        drive.stop(Trip::Partner);
        assert!(!drive.reset(), "it does not stand yet");
        drive.observe(&Observed {
            is_at_rest: true,
            ..SILENT
        });
        drive.stop(Trip::Watchdog);
        assert_eq!(
            (drive.state(), drive.trip()),
            (Fault, Some(Trip::Partner)),
            "the first cause stands"
        );
        assert!(drive.reset());
        assert_eq!((drive.state(), drive.trip()), (NotReady, None));
        assert_eq!(states(&mut drive, &SILENT, 50), [NotReady; 50]);
        assert_eq!(
            states(
                &mut drive,
                &Observed {
                    is_on_reference: true,
                    ..FRESH
                },
                2
            ),
            [Ready, Operating]
        );
    }

    #[test]
    fn without_limits_it_never_stops_by_itself() {
        let mut drive = Supervision::new(None);
        states(&mut drive, &FRESH, 1);
        assert_eq!(
            states(
                &mut drive,
                &Observed {
                    error_nm: i64::MAX,
                    ..SILENT
                },
                1000
            ),
            [Operating; 1000]
        );
    }
}
