//! The jump near 360 N in x `[T 5.2.2, 6.1]`: backlash in the joint between platform and arm 3.
//!
//! The platform rests on cart 3 `[T 6.1]`: its weight keeps the sum of the tensions of links 31,
//! 32, 33 on one side of zero, and the joint at one end of its backlash. A force on the tool that
//! turns the sign of that sum carries the joint across its backlash. All three links of the cluster
//! then act longer (the sum has become a tension) or shorter (a thrust) by the gap.
//!
//! The backlash follows the force through it, never against it, so the jump always *adds* to the
//! displacement along the load: by virtual work, `F dx = |F3| gap`. It is spread over
//! [`TRANSITION_N`] so that the equilibrium stays unique and continuous. The preload is constant,
//! as the weight is, and therefore tared by sensor and gauges alike; only its sum with the load
//! matters. It is not turned with the pose. The compliance stays the same on both sides; the thesis
//! measured a lower one after the jump `[T Table 5.2]`, whose negative numbers do not allow to take
//! it over.

/// Width of the transition, in newtons of cluster force.
pub const TRANSITION_N: f64 = 4.0;

/// Steps to find how far the joint has crossed: to a gap of 1e-2 m over 2^40, 1e-14 m.
const BISECTIONS: u32 = 40;

/// Play of the joint of cluster 3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backlash {
    gap_m: f64,
    preload_n: f64,
}

impl Backlash {
    /// Joint without backlash.
    pub const NONE: Self = Self {
        gap_m: 0.0,
        preload_n: 0.0,
    };

    /// Backlash of `gap_m` metres, closed by `preload_n` newtons: the sum of the tensions of
    /// cluster 3 caused by weight alone. `None` when the preload is too small to keep it closed at
    /// rest.
    #[must_use]
    pub fn new(gap_m: f64, preload_n: f64) -> Option<Self> {
        (preload_n.abs() > TRANSITION_N).then_some(Self { gap_m, preload_n })
    }

    /// Elongation of each link of cluster 3, in metres, when the load on the tool adds
    /// `cluster_force_n` to the preload.
    #[must_use]
    pub fn elongation_m(&self, cluster_force_n: f64) -> f64 {
        -self.preload_n.signum() * self.gap_m * self.crossed(cluster_force_n)
    }

    /// Returns the elongation at which the joint stays under the cluster force by it:
    /// `e = elongation_m(force_n(e))`. A force with the sign of the preload grows with the gap.
    pub(super) fn settled_m(&self, force_n: impl Fn(f64) -> f64) -> f64 {
        let elongation_m = |crossed: f64| -self.preload_n.signum() * self.gap_m * crossed;
        let beyond = |share: f64| self.crossed(force_n(elongation_m(share))) - share;
        // The share that the force asks for falls with the share that is crossed.
        let (mut lower, mut upper) = (0.0, 1.0);
        if beyond(lower) <= 0.0 {
            return elongation_m(lower);
        }
        if beyond(upper) >= 0.0 {
            return elongation_m(upper);
        }
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (lower + upper);
            if beyond(middle) > 0.0 {
                lower = middle;
            } else {
                upper = middle;
            }
        }
        elongation_m(0.5 * (lower + upper))
    }

    /// Returns the share of the gap that the joint has crossed, from 0 at rest to 1.
    #[must_use]
    pub fn crossed(&self, cluster_force_n: f64) -> f64 {
        // Positive once the sum has left the side it rests on.
        let beyond_n = -(cluster_force_n + self.preload_n) * self.preload_n.signum();
        smooth_step(beyond_n / TRANSITION_N + 0.5)
    }
}

/// 0 below 0, 1 above 1, once continuously differentiable between.
fn smooth_step(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_at_rest_and_crossed_beyond_the_sign_change() {
        for preload in [-180.0, 180.0] {
            let backlash = Backlash::new(40e-6, preload).unwrap();
            let towards = -preload.signum();
            assert!(backlash.elongation_m(0.0).abs() < 1e-18);
            assert!(backlash.elongation_m(-towards * 500.0).abs() < 1e-18);
            assert!((backlash.elongation_m(-preload) - towards * 20e-6).abs() < 1e-15);
            assert!((backlash.elongation_m(towards * 183.0) - towards * 40e-6).abs() < 1e-15);
        }
    }

    #[test]
    fn never_against_the_force() {
        let backlash = Backlash::new(40e-6, 180.0).unwrap();
        let mut last = backlash.elongation_m(-190.0);
        for tenth in -1900..0 {
            let now = backlash.elongation_m(f64::from(tenth) * 0.1);
            assert!(now >= last);
            last = now;
        }
    }

    #[test]
    fn refuses_a_preload_that_does_not_hold_it_closed() {
        assert_eq!(Backlash::new(40e-6, 1.0), None);
        assert_eq!(Backlash::new(40e-6, f64::NAN), None);
        assert!(Backlash::NONE.elongation_m(1e4).abs() < 1e-30);
    }
}
