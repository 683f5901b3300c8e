//! Motor of a drive: current loop, current over time, inertia and friction; and the cart that it
//! moves through play.

use gantry_tau_machine::robot_file::{RATED_FORCE_N, TORQUE_LIMIT};

use super::encoder::Motion;
use super::profile::{CURRENT_SHARE, Friction, VISCOUS_FRICTION};
use super::{SUBSTEP_S, Settings};

/// Stiffness of the flanks between motor and cart, N/m: far above the springs of the machine, which
/// are behind the cart. ASSUMED.
const FLANK_N_PER_M: f64 = 1e9;
/// Their damping, N s/m.
const FLANK_N_S_PER_M: f64 = 2e4;
/// Share of the overcurrent-time area below which a motor at its rated limit gets its torque limit
/// back. ASSUMED.
const RECOVERED: f64 = 0.5;

/// Something with a mass on a guideway.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MovingMass {
    pub(super) position_m: f64,
    pub(super) velocity_m_per_s: f64,
}

impl MovingMass {
    const fn at_rest(position_m: f64) -> Self {
        Self {
            position_m,
            velocity_m_per_s: 0.0,
        }
    }

    /// Integrates a step under a force, N, which is without Coulomb friction.
    fn advance(&mut self, sum_n: f64, mass_kg: f64, friction: &Friction) {
        let before = self.velocity_m_per_s;
        let opposing_n = if before == 0.0 {
            if sum_n.abs() <= friction.breakaway_n {
                sum_n
            } else {
                friction.sliding_n.copysign(sum_n)
            }
        } else {
            friction.sliding_n.copysign(before)
        };
        self.velocity_m_per_s += (sum_n - opposing_n) / mass_kg * SUBSTEP_S;
        // Friction ends a motion; only a force beyond the breakaway begins another.
        if friction.sliding_n > 0.0 && before * self.velocity_m_per_s < 0.0 {
            self.velocity_m_per_s = 0.0;
        }
        self.position_m += self.velocity_m_per_s * SUBSTEP_S;
    }
}

/// State of a motor, with its cart where there is no play between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DriveMotor {
    pub(super) body: MovingMass,
    pub(super) force_n: f64,
    /// Overcurrent-time area, rated torques times s.
    area: f64,
    /// The area was used up: rated torque is the limit.
    is_at_rated: bool,
}

impl DriveMotor {
    /// Creates a motor at rest at a position, m.
    pub(super) const fn at_rest(position_m: f64) -> Self {
        Self {
            body: MovingMass::at_rest(position_m),
            force_n: 0.0,
            area: 0.0,
            is_at_rated: false,
        }
    }

    pub(super) const fn motion(&self) -> Motion {
        (self.body.position_m, self.body.velocity_m_per_s)
    }

    /// Returns the largest force, N.
    pub(super) const fn limit_n(&self) -> f64 {
        if self.is_at_rated {
            RATED_FORCE_N
        } else {
            TORQUE_LIMIT * RATED_FORCE_N
        }
    }

    /// Lets the current follow this force for a step.
    fn drive(&mut self, wanted_n: f64, settings: &Settings) {
        self.force_n += (wanted_n - self.force_n) * CURRENT_SHARE;
        let Some(peak_s) = settings.peak_s else {
            return;
        };
        let most = (TORQUE_LIMIT - 1.0) * peak_s;
        let above_rated = self.force_n.abs() / RATED_FORCE_N - 1.0;
        self.area = (self.area + above_rated * SUBSTEP_S).clamp(0.0, most);
        self.is_at_rated = if self.is_at_rated {
            self.area > RECOVERED * most
        } else {
            self.area >= most
        };
    }

    /// Integrates a step with this force wanted of the current loop, under a load on the cart, N.
    pub(super) fn advance(&mut self, wanted_n: f64, load_n: f64, settings: &Settings) {
        self.drive(wanted_n, settings);
        let sum_n = self.force_n + load_n - VISCOUS_FRICTION * self.body.velocity_m_per_s;
        self.body
            .advance(sum_n, settings.body_kg, &settings.friction);
    }

    /// Integrates a step with this force wanted, in front of a cart. Returns the force on the cart,
    /// N.
    pub(super) fn advance_in_front_of(
        &mut self,
        cart: &Cart,
        wanted_n: f64,
        settings: &Settings,
    ) -> f64 {
        self.drive(wanted_n, settings);
        let pushed_n = cart.pushed_n(&self.body, settings.backlash_m);
        // Friction is the guideway's.
        self.body.advance(
            self.force_n - pushed_n,
            0.5 * settings.body_kg,
            &Friction {
                sliding_n: 0.0,
                breakaway_n: 0.0,
            },
        );
        pushed_n
    }
}

/// Cart of an axis whose motors drive it through play, or against each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cart {
    body: MovingMass,
}

impl Cart {
    /// Creates a cart at rest at a position, m.
    pub(super) const fn at_rest(position_m: f64) -> Self {
        Self {
            body: MovingMass::at_rest(position_m),
        }
    }

    /// Returns its position, m, and velocity, m/s.
    #[must_use]
    pub const fn motion(&self) -> Motion {
        (self.body.position_m, self.body.velocity_m_per_s)
    }

    /// Returns the force of a motor on it, N; none within the play.
    fn pushed_n(&self, motor: &MovingMass, backlash_m: f64) -> f64 {
        let lead_m = motor.position_m - self.body.position_m;
        let pressed_m = lead_m - lead_m.clamp(-0.5 * backlash_m, 0.5 * backlash_m);
        let speed_m_per_s = motor.velocity_m_per_s - self.body.velocity_m_per_s;
        let force_n = FLANK_N_PER_M * pressed_m + FLANK_N_S_PER_M * speed_m_per_s;
        // A flank does not pull.
        if pressed_m * force_n > 0.0 {
            force_n
        } else {
            0.0
        }
    }

    /// Integrates a step under the forces of this many motors and the load, N.
    pub(super) fn advance(&mut self, forces_n: f64, motors: f64, settings: &Settings) {
        let friction = &settings.friction;
        let sum_n = forces_n - motors * VISCOUS_FRICTION * self.body.velocity_m_per_s;
        let all = Friction {
            sliding_n: motors * friction.sliding_n,
            breakaway_n: motors * friction.breakaway_n,
        };
        self.body
            .advance(sum_n, motors * 0.5 * settings.body_kg, &all);
    }
}
