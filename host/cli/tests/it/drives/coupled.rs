//! Two motors on one cart: play, and a bias against it.

use gantry_tau_sim::drive::profile::Friction;
use gantry_tau_sim::drive::{Cart, Drive, RATED_FORCE_N, Settings, coupled};

use super::{actual, at, ideal};

struct Pair {
    drives: [Drive; 2],
    cart: Cart,
}

impl Pair {
    fn new(bias: f64, backlash_m: f64, friction_n: f64) -> Self {
        let friction = Friction {
            sliding_n: friction_n,
            breakaway_n: friction_n,
        };
        let settings = Settings {
            bias,
            backlash_m,
            friction,
            ..ideal()
        };
        let drives =
            [1.0, -1.0].map(|direction| Drive::at_rest(&at(0), &settings).biased(direction));
        Self {
            cart: drives[0].cart(),
            drives,
        }
    }

    fn advance(&mut self, nm: i64, load_n: f64) {
        self.drives
            .iter_mut()
            .for_each(|drive| drive.command(&at(nm)));
        coupled::advance(&mut self.drives, |_| true, &mut self.cart, load_n);
    }

    /// Moves at a constant speed in a second, and waits half of one; place of the cart then, um.
    fn walk(&mut self, from: i64, to: i64) -> f64 {
        for cycle in 0..=1_000 {
            self.advance(from + (to - from) * cycle / 1_000, 0.0);
        }
        for _ in 0..500 {
            self.advance(to, 0.0);
        }
        self.cart.motion().0 * 1e6
    }

    /// Torques in N, each to half a newton.
    fn torques_n(&self) -> [f64; 2] {
        self.drives
            .each_ref()
            .map(|drive| f64::from(actual(drive).torque.0) * 1e-3 * RATED_FORCE_N)
    }

    /// Place of the cart under a load that is put on slowly, um.
    fn settled_um(&mut self, from_n: f64, to_n: f64) -> f64 {
        for cycle in 0..1_000 {
            self.advance(0, from_n + (to_n - from_n) * f64::from(cycle) / 1_000.0);
        }
        for _ in 0..1_000 {
            self.advance(0, to_n);
        }
        self.cart.motion().0 * 1e6
    }
}

#[test]
fn a_bias_above_half_the_load_takes_the_play_away() {
    for (bias, lost_um, within_um) in [(0.0, 20.0, 1.0), (0.2, 0.0, 1.0), (0.1, 20.0, 1.0)] {
        let mut pair = Pair::new(bias, 20e-6, 0.0);
        let forwards = pair.settled_um(0.0, 300.0);
        let torques = pair.torques_n();
        let backwards = pair.settled_um(300.0, -300.0);
        let found = forwards - backwards;
        assert!(
            (found - lost_um).abs() <= within_um,
            "bias {bias}: {found} um"
        );
        let (difference, mean) = (torques[0] - torques[1], 0.5 * (torques[0] + torques[1]));
        assert!(
            (difference - 2.0 * bias * RATED_FORCE_N).abs() <= 1.0,
            "bias {bias}: {torques:?} N"
        );
        assert!((mean + 150.0).abs() <= 1.0, "bias {bias}: {torques:?} N");
    }
}

/// The same by motion: the cart at one reference, reached from both sides, against the friction of
/// its guideway. At 0.2 mm/s it hardly coasts within the play when the motors stop; at 2 mm/s it
/// does so for 1.5 um.
#[test]
fn a_reversal_loses_the_play() {
    for (bias, lost_um, within_um) in [(0.0, 20.0, 1.0), (0.2, 0.0, 1.0)] {
        let mut pair = Pair::new(bias, 20e-6, 50.0);
        pair.walk(0, -200_000);
        let rising = pair.walk(-200_000, 0);
        pair.walk(0, 200_000);
        let falling = pair.walk(200_000, 0);
        let found = falling - rising;
        assert!(
            (found - lost_um).abs() <= within_um,
            "bias {bias}: {found} um"
        );
    }
}

/// Without play and bias the pair is two carts in step, as before; with an infinitesimal bias it is
/// one cart on two motors.
#[test]
fn a_stiff_pair_follows_like_two_carts() {
    let mut pair = Pair::new(1e-6, 0.0, 0.0);
    let mut single = Drive::at_rest(&at(0), &ideal());
    for cycle in 0..1_000 {
        let nm = super::accelerating(cycle);
        pair.advance(nm, 200.0);
        single.command(&at(nm));
        single.advance(100.0);
        let off_um = (pair.cart.motion().0 - single.position_m()) * 1e6;
        assert!(off_um.abs() < 2.0, "{cycle}: {off_um} um");
    }
}
