//! Nominal references in place of the NC kernel `[T 4.1.1]`: rest, or a walk along waypoints and
//! back.

use std::fmt;

/// Longest list of waypoints.
const MAX_WAYPOINTS: f64 = 1e5;
/// Cycles per second.
const CYCLES_PER_SECOND: f64 = 1000.0;
/// Peak speed of the quintic, times distance over time.
const PEAK_SPEED: f64 = 1.875;
/// Peak acceleration of the quintic, times distance over time squared: `10 / sqrt(3)`.
const PEAK_ACCELERATION: f64 = 5.773_502_691_896_258;
/// Longest leg, cycles: a day.
const MAX_LEG_CYCLES: f64 = 86_400_000.0;
/// Largest speed (m/s) and acceleration (m/s^2) of the way back home of a path that rests there.
const RETURN_SPEED: (f64, f64) = (0.01, 0.1);

/// Motion of the nominal references.
#[derive(Clone, Debug, PartialEq)]
pub enum Motion<const N: usize> {
    /// They stay at home.
    Hold,
    /// From home through the waypoints and the same way back, repeatedly.
    BackAndForth {
        /// Axis positions in metres, home not included.
        waypoints_m: Vec<[f64; N]>,
        /// Largest speed of an axis, m/s.
        speed_m_per_s: f64,
        /// Largest acceleration of an axis, m/s^2.
        acceleration_m_per_s2: f64,
        /// Rest at home and at every waypoint, cycles.
        dwell_cycles: u32,
    },
}

impl<const N: usize> Motion<N> {
    /// Back and forth from home, m, by so much on every axis, m, slowly and with rests: as with
    /// `gantry-tau serve --motion`. By 0 they stay.
    #[must_use]
    pub fn by(home_m: [f64; N], by_m: f64) -> Self {
        if by_m == 0.0 {
            return Self::Hold;
        }
        Self::BackAndForth {
            waypoints_m: vec![home_m.map(|place| place + by_m)],
            speed_m_per_s: 0.02,
            acceleration_m_per_s2: 0.5,
            dwell_cycles: 500,
        }
    }
}

/// A number that is NaN, infinite, or outside its range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutOfRange {
    /// Name of the parameter.
    pub parameter: &'static str,
    /// Smallest value accepted.
    pub lower: f64,
    /// Largest value accepted.
    pub upper: f64,
}

impl fmt::Display for OutOfRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} must be from {:e} to {:e}",
            self.parameter, self.lower, self.upper
        )
    }
}

impl std::error::Error for OutOfRange {}

/// Checks that a number is within its range, limits included.
///
/// # Errors
/// [`OutOfRange`].
pub fn check(
    parameter: &'static str,
    value: f64,
    lower: f64,
    upper: f64,
) -> Result<(), OutOfRange> {
    if (lower..=upper).contains(&value) {
        Ok(())
    } else {
        Err(OutOfRange {
            parameter,
            lower,
            upper,
        })
    }
}

/// One sample of the nominal axis positions per cycle, in metres. Positions, speeds and
/// accelerations are continuous.
#[derive(Clone, Debug, PartialEq)]
pub struct Interpolator<const N: usize> {
    home_m: [f64; N],
    /// The way out, leg by leg.
    legs: Vec<Leg<N>>,
    dwell: u32,
    /// Legs walked since home, out and back.
    walked: usize,
    /// Cycles since the leg began, its dwell first.
    cycle: u32,
    /// Largest speed and acceleration, m/s and m/s^2.
    speed: (f64, f64),
    /// Rest of a leg that was left on the way, from where the axes stood, and the cycles since it
    /// was taken up again.
    rest: Option<(Leg<N>, u32)>,
}

/// The way from one stop to the next.
#[derive(Clone, Debug, PartialEq)]
struct Leg<const N: usize> {
    near_m: [f64; N],
    far_m: [f64; N],
    cycles: u32,
}

impl<const N: usize> Interpolator<N> {
    /// Starts at `home_m` (axis positions, metres).
    ///
    /// # Errors
    /// [`OutOfRange`] naming the waypoints, the speed or the acceleration.
    pub fn new(home_m: [f64; N], motion: &Motion<N>) -> Result<Self, OutOfRange> {
        let mut this = Self {
            home_m,
            legs: Vec::new(),
            dwell: 0,
            walked: 0,
            cycle: 0,
            speed: RETURN_SPEED,
            rest: None,
        };
        if let Motion::BackAndForth {
            waypoints_m,
            speed_m_per_s,
            acceleration_m_per_s2,
            dwell_cycles,
        } = motion
        {
            check("speed_m_per_s", *speed_m_per_s, 1e-6, 10.0)?;
            check("acceleration_m_per_s2", *acceleration_m_per_s2, 1e-6, 1e3)?;
            // A day's dwell is long enough; sums of cycles stay far inside u32.
            check("dwell_cycles", (*dwell_cycles).into(), 0.0, MAX_LEG_CYCLES)?;
            check(
                "number of waypoints_m",
                waypoints_m.len() as f64,
                0.0,
                MAX_WAYPOINTS,
            )?;
            this.dwell = *dwell_cycles;
            this.speed = (*speed_m_per_s, *acceleration_m_per_s2);
            let mut near_m = home_m;
            for &far_m in waypoints_m {
                let cycles = leg_cycles(&near_m, &far_m, *speed_m_per_s, *acceleration_m_per_s2)?;
                this.legs.push(Leg {
                    near_m,
                    far_m,
                    cycles,
                });
                near_m = far_m;
            }
        }
        Ok(this)
    }

    /// Returns the leg being walked, and true on the way back. `None` if there are no waypoints.
    fn leg(&self) -> Option<(&Leg<N>, bool)> {
        let back = self.walked >= self.legs.len();
        let index = if back {
            (2 * self.legs.len()).checked_sub(self.walked + 1)?
        } else {
            self.walked
        };
        Some((self.legs.get(index)?, back))
    }

    /// Takes the path up again from these axis positions (m), at rest: goes to the end of the
    /// present leg, and on from there.
    pub fn go_on_from(&mut self, position_m: [f64; N]) {
        let far_m = match self.leg() {
            Some((leg, back)) => {
                if back {
                    leg.near_m
                } else {
                    leg.far_m
                }
            }
            None => self.home_m,
        };
        let (speed_m_per_s, acceleration_m_per_s2) = self.speed;
        // Positions of a machine are in range; a way that is not is left out, and the step is a
        // nominal fault.
        let cycles = leg_cycles(&position_m, &far_m, speed_m_per_s, acceleration_m_per_s2);
        self.rest = cycles.ok().map(|cycles| {
            (
                Leg {
                    near_m: position_m,
                    far_m,
                    cycles,
                },
                0,
            )
        });
    }

    /// Returns the present axis positions, metres.
    #[must_use]
    pub fn position_m(&self) -> [f64; N] {
        if let Some((leg, cycle)) = &self.rest {
            return leg.at(f64::from(*cycle) / f64::from(leg.cycles));
        }
        let Some((leg, back)) = self.leg() else {
            return self.home_m;
        };
        let walked = f64::from(self.cycle.saturating_sub(self.dwell)) / f64::from(leg.cycles);
        leg.at(if back { 1.0 - walked } else { walked })
    }

    /// True at the last waypoint, until the way back begins.
    #[must_use]
    pub fn has_arrived(&self) -> bool {
        self.rest.is_none() && self.walked == self.legs.len() && self.cycle <= self.dwell
    }

    /// Advances by one cycle.
    pub fn advance(&mut self) {
        if let Some((leg, cycle)) = &mut self.rest {
            *cycle += 1;
            if *cycle >= leg.cycles {
                self.rest = None;
                self.end_leg();
            }
            return;
        }
        let Some((leg, _)) = self.leg() else {
            return;
        };
        let end = self.dwell + leg.cycles;
        self.cycle += 1;
        if self.cycle >= end {
            self.end_leg();
        }
    }

    fn end_leg(&mut self) {
        self.cycle = 0;
        // A path without legs stays at home.
        self.walked = (self.walked + 1) % (2 * self.legs.len()).max(1);
    }
}

impl<const N: usize> Leg<N> {
    /// Returns the axis positions after a share of its time, metres.
    fn at(&self, share: f64) -> [f64; N] {
        let share = quintic(share);
        let mut position_m = self.near_m;
        for (axis_m, far_m) in position_m.iter_mut().zip(self.far_m) {
            *axis_m += (far_m - *axis_m) * share;
        }
        position_m
    }
}

/// Cycles that keep every axis below the speed and the acceleration, at least one.
fn leg_cycles<const N: usize>(
    near_m: &[f64; N],
    far_m: &[f64; N],
    speed_m_per_s: f64,
    acceleration_m_per_s2: f64,
) -> Result<u32, OutOfRange> {
    let mut longest_m = 0.0_f64;
    for (near, far) in near_m.iter().zip(far_m) {
        check("waypoints_m", *far, -1e3, 1e3)?;
        longest_m = longest_m.max((far - near).abs());
    }
    let by_speed_s = PEAK_SPEED * longest_m / speed_m_per_s;
    let by_acceleration_s = (PEAK_ACCELERATION * longest_m / acceleration_m_per_s2).sqrt();
    let cycles = (by_speed_s.max(by_acceleration_s) * CYCLES_PER_SECOND)
        .ceil()
        .max(1.0);
    check("cycles between waypoints_m", cycles, 1.0, MAX_LEG_CYCLES)?;
    Ok(cycles as u32)
}

/// From 0 to 1 with speed and acceleration zero at both ends.
fn quintic(x: f64) -> f64 {
    x * x * x * (10.0 + x * (6.0 * x - 15.0))
}

#[cfg(test)]
#[allow(
    clippy::float_cmp,
    clippy::needless_range_loop,
    reason = "the tests compare floats that must be bit-equal, and walk several arrays by one axis number"
)]
mod tests {
    use super::*;

    /// Returns a motion with these waypoints (m), speed (m/s), acceleration (m/s^2) and dwell
    /// (cycles).
    fn motion<const N: usize>(
        waypoints_m: &[[f64; N]],
        speed: f64,
        acceleration: f64,
        dwell: u32,
    ) -> Motion<N> {
        Motion::BackAndForth {
            waypoints_m: waypoints_m.to_vec(),
            speed_m_per_s: speed,
            acceleration_m_per_s2: acceleration,
            dwell_cycles: dwell,
        }
    }
    use gantry_tau_core::model::robot::ARMS;

    fn walk() -> Interpolator<ARMS> {
        Interpolator::new(
            [0.0; 3],
            &motion(&[[0.1, 0.0, -0.05], [0.1, 0.2, 0.0]], 0.5, 2.0, 20),
        )
        .unwrap()
    }

    #[test]
    fn stays_below_speed_and_acceleration_and_visits_every_stop() {
        let mut walk = walk();
        let mut trace = vec![walk.position_m()];
        for _ in 0..5000 {
            walk.advance();
            trace.push(walk.position_m());
        }
        for pair in trace.windows(3) {
            for axis in 0..ARMS {
                let first = pair[1][axis] - pair[0][axis];
                let second = pair[2][axis] - pair[1][axis];
                assert!(first.abs() <= 0.5e-3 * (1.0 + 1e-9));
                assert!((second - first).abs() <= 2e-6 * 1.05);
            }
        }
        for stop in [[0.0; 3], [0.1, 0.0, -0.05], [0.1, 0.2, 0.0]] {
            let visits = trace.iter().filter(|position| {
                let off = (0..ARMS).map(|axis| (position[axis] - stop[axis]).abs());
                off.fold(0.0, f64::max) < 1e-12
            });
            assert!(visits.count() > 20);
        }
    }

    #[test]
    fn a_path_begins_after_its_dwell_and_not_a_cycle_later() {
        let mut walk = walk();
        for _ in 0..20 {
            assert_eq!(walk.position_m(), [0.0; 3]);
            walk.advance();
        }
        assert_eq!(walk.position_m(), [0.0; 3]);
        walk.advance();
        assert!(walk.position_m()[0] > 0.0, "{walk:?}");
    }

    #[test]
    fn holding_does_not_move() {
        let home = [0.3, -0.2, 1.0];
        let mut hold = Interpolator::new(home, &Motion::Hold).unwrap();
        for _ in 0..100 {
            hold.advance();
            assert_eq!(hold.position_m(), home);
        }
    }

    #[test]
    fn a_leg_that_was_left_is_taken_up_from_where_the_axes_stand() {
        let mut walk = walk();
        let mut last = walk.position_m();
        for _ in 0..200 {
            walk.advance();
        }
        let stood = walk.position_m().map(|metres| metres + 0.004);
        walk.go_on_from(stood);
        assert_eq!(walk.position_m(), stood);
        let mut timed = walk.clone();
        let cycles = timed.rest.as_ref().unwrap().0.cycles;
        (1..cycles).for_each(|_| timed.advance());
        assert!(timed.rest.is_some());
        timed.advance();
        assert!(
            timed.rest.is_none() && timed.position_m() == [0.1, 0.0, -0.05],
            "{timed:?}"
        );
        let (mut before, mut is_there) = (stood, false);
        for _ in 0..5000 {
            (last, before) = (before, walk.position_m());
            walk.advance();
            let now = walk.position_m();
            for axis in 0..ARMS {
                assert!((now[axis] - before[axis]).abs() <= 0.5e-3 * (1.0 + 1e-9));
                assert!((now[axis] - 2.0 * before[axis] + last[axis]).abs() <= 2e-6 * 1.05);
            }
            is_there |= now == [0.1, 0.2, 0.0];
        }
        assert!(is_there, "{last:?}");
        let mut hold = Interpolator::new([0.3; 3], &Motion::Hold).unwrap();
        hold.go_on_from([0.301; 3]);
        for _ in 0..1000 {
            hold.advance();
        }
        assert_eq!(hold.position_m(), [0.3; 3]);
    }

    #[test]
    fn waypoints_that_do_not_move_are_accepted() {
        let mut walk = Interpolator::new([0.0; 3], &motion(&[[0.0; 3]; 2], 0.5, 2.0, 0)).unwrap();
        for _ in 0..10 {
            walk.advance();
            assert_eq!(walk.position_m(), [0.0; 3]);
        }
    }

    /// Name of the parameter that is refused.
    fn bad(waypoint: f64, speed: f64, acceleration: f64) -> &'static str {
        let motion = motion(&[[waypoint; 3]], speed, acceleration, 0);
        Interpolator::new([0.0; 3], &motion).unwrap_err().parameter
    }

    #[test]
    fn refuses_by_name() {
        assert_eq!(bad(f64::NAN, 1.0, 1.0), "waypoints_m");
        assert_eq!(bad(0.1, 0.0, 1.0), "speed_m_per_s");
        assert_eq!(bad(0.1, 1.0, f64::INFINITY), "acceleration_m_per_s2");
    }
}
