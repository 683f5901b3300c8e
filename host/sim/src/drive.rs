//! One drive: an AX5000-like cascade, its motor and its cart `[T 4.1.7, Fig. 4.6]`.
//!
//! ```text
//! position reference --(-)-- P --(+)--(-)-- PI --(+)-- current loop -- motor + cart -- position
//!        |                       |             |            |
//!        '--- derivative --------'        torque offset   load of the machine
//!                velocity offset
//! ```
//!
//! The reference is interpolated linearly over the cycle, as the drive's fine interpolation does.
//! PI current control against the winding is a closed first-order loop here: far above everything
//! the cycle can see. Lengths are metres along the guideway; forces are newtons there; "torque" is
//! force over rated force.

mod cascade;
pub mod coupled;
pub mod encoder;
mod motor;
pub mod profile;
mod report;
pub mod supervision;

use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::control::position_loop::VelocityReference;
use gantry_tau_core::units::{TorquePermille, VelocityUmS};
use gantry_tau_machine::drive_cascade::SUBSTEP_S;
pub use gantry_tau_machine::drive_cascade::{CYCLE_S, SUBSTEPS};
pub use gantry_tau_machine::robot_file::{Interface, MAX_DELAY, RATED_FORCE_N};
use gantry_tau_server::plant::DriveState;

use cascade::{Cascade, Demand};
use encoder::{Motion, Readings};
pub use motor::Cart;
use motor::DriveMotor;
pub use profile::Settings;
use report::Report;
pub(super) use report::mean;
pub use report::report;
use supervision::{Observed, Supervision, Trip};

/// Cycles that are kept for the latency.
const KEPT: usize = MAX_DELAY as usize + 1;
/// Way per cycle onto the reference after a reset, m: 10 mm/s.
const APPROACH_M: f64 = 10e-6;
/// Velocity below which a motor stands, m/s.
const STANDSTILL_M_PER_S: f64 = 1e-3;

/// State of one drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    settings: Settings,
    /// Commands of this cycle and of those before.
    commands: [Reference; KEPT],
    /// A command came since the last cycle.
    is_fresh: bool,
    supervision: Supervision,
    demand: Demand,
    cascade: Cascade,
    motor: DriveMotor,
    readings: Readings,
    /// Measurement of the loops in this step.
    measured: Motion,
    /// Force against the other motors of the axis, N.
    bias_n: f64,
    /// Reports of this cycle and of those before.
    reports: [Report; KEPT],
}

impl Drive {
    /// Creates a drive at rest at `reference`, ready for its first command.
    #[must_use]
    pub fn at_rest(reference: &Reference, settings: &Settings) -> Self {
        let position_m = reference.position.to_metres().0;
        let readings = Readings::at_rest(settings.encoder, position_m);
        Self {
            settings: *settings,
            commands: [*reference; KEPT],
            is_fresh: false,
            supervision: Supervision::new(settings.limits),
            demand: Demand::Stop {
                velocity_m_per_s: 0.0,
                deceleration_m_per_s2: settings.quick_stop_m_per_s2,
            },
            cascade: Cascade::at_rest(position_m),
            motor: DriveMotor::at_rest(position_m),
            readings,
            measured: (position_m, 0.0),
            bias_n: 0.0,
            reports: [Report {
                motion: (position_m, 0.0),
                force_n: 0.0,
            }; KEPT],
        }
    }

    /// Lets it push with its bias, forwards (1.0) or backwards (-1.0), against the other motors of
    /// its axis.
    #[must_use]
    pub fn biased(self, direction: f64) -> Self {
        Self {
            bias_n: direction * self.settings.bias * RATED_FORCE_N,
            ..self
        }
    }

    /// Creates the cart of an axis where the drive's motor is.
    #[must_use]
    pub const fn cart(&self) -> Cart {
        Cart::at_rest(self.motor.body.position_m)
    }

    /// Takes the reference of the next cycle.
    pub const fn command(&mut self, reference: &Reference) {
        self.commands[0] = *reference;
        self.is_fresh = true;
    }

    /// Takes the velocity and the additive torque of the next cycle.
    pub const fn command_velocity(&mut self, reference: &VelocityReference) {
        let position = self.commands[0].position;
        let VelocityReference { velocity, torque } = *reference;
        self.command(&Reference {
            position,
            velocity_offset: velocity,
            torque_offset: torque,
        });
    }

    /// Runs one cycle, under `load_n` newtons that push the cart along its guideway.
    pub fn advance(&mut self, load_n: f64) {
        self.begin();
        for substep in 0..SUBSTEPS {
            self.step(substep, load_n);
        }
        self.end();
    }

    /// Runs one of the [`SUBSTEPS`] of a cycle.
    pub(super) fn step(&mut self, substep: u32, load_n: f64) {
        let measured = self.measure();
        let wanted_n = self.wanted_n(substep, measured);
        self.motor.advance(wanted_n, load_n, &self.settings);
    }

    /// Lets it move this mass in front of the spring of its axis, kg.
    #[must_use]
    pub(super) fn moving(mut self, body_kg: f64) -> Self {
        self.settings.body_kg = body_kg;
        self
    }

    /// Lets it hold this load at rest, N.
    #[must_use]
    pub(super) fn holding(mut self, load_n: f64) -> Self {
        self.cascade.hold(-load_n);
        self.motor.force_n = -load_n;
        for report in &mut self.reports {
            report.force_n = -load_n;
        }
        self
    }

    /// Returns the reference in force: the command of as many cycles ago as it takes to come.
    fn reference(&self) -> Reference {
        self.commands[usize::from(self.settings.command_delay_cycles.min(MAX_DELAY))]
    }

    /// Begins a cycle.
    pub(super) fn begin(&mut self) {
        let reach_m = if self.state() == DriveState::NotReady {
            APPROACH_M
        } else {
            f64::INFINITY
        };
        self.demand = match self.state() {
            DriveState::QuickStop | DriveState::Fault => Demand::Stop {
                velocity_m_per_s: self.demand.velocity_m_per_s(),
                deceleration_m_per_s2: self.settings.quick_stop_m_per_s2,
            },
            _ => self
                .cascade
                .follow(&self.reference(), reach_m, &self.settings),
        };
    }

    fn measure(&mut self) -> Motion {
        self.readings.measure(self.motor.motion())
    }

    /// Returns the force that a step asks of the current loop, N.
    fn wanted_n(&mut self, substep: u32, measured: Motion) -> f64 {
        self.cascade.force_n(
            &self.demand,
            substep,
            measured,
            self.motor.limit_n(),
            &self.settings,
        )
    }

    /// Integrates a step in front of a cart, with the bias. Returns the force on the cart, N.
    fn push(&mut self, substep: u32, measured: Motion, cart: &Cart) -> f64 {
        let limit_n = self.motor.limit_n();
        let wanted_n = (self.wanted_n(substep, measured) + self.bias_n).clamp(-limit_n, limit_n);
        self.motor
            .advance_in_front_of(cart, wanted_n, &self.settings)
    }

    /// Ends a cycle.
    pub(super) fn end(&mut self) {
        let reference = self.reference();
        let has_reached = self.cascade.end(&self.demand, &reference);
        let motion = self.readings.report(self.motor.motion());
        // With velocities there is no position to be away from.
        let (error_m, is_on_reference) = match self.settings.interface {
            Interface::Position => (reference.position.to_metres().0 - motion.0, has_reached),
            Interface::Velocity => (0.0, true),
        };
        self.supervision.observe(&Observed {
            is_fresh: std::mem::take(&mut self.is_fresh),
            error_nm: report::nearest(error_m * 1e9).unwrap_or(i64::MAX),
            is_on_reference,
            is_at_rest: self.demand.velocity_m_per_s() == 0.0
                && motion.1.abs() < STANDSTILL_M_PER_S,
        });
        self.commands.copy_within(..KEPT - 1, 1);
        self.reports.copy_within(..KEPT - 1, 1);
        self.reports[0] = Report {
            motion,
            force_n: self.motor.force_n,
        };
    }

    /// Returns the state of the drive.
    #[must_use]
    pub const fn state(&self) -> DriveState {
        self.supervision.state()
    }

    /// Returns the cause of its last quick stop, until the reset.
    #[must_use]
    pub const fn trip(&self) -> Option<Trip> {
        self.supervision.trip()
    }

    /// Stops it because another drive of its axis has stopped.
    pub fn stop_with_partner(&mut self) {
        self.supervision.stop(Trip::Partner);
    }

    /// Acknowledges a fault: the drive then moves onto the reference in force, at no more than 10
    /// mm/s, before it is ready.
    pub fn reset(&mut self) {
        if self.supervision.reset() {
            self.cascade.restart(self.reports[0].motion.0);
            if self.settings.interface == Interface::Velocity {
                // An old position is a place to go to; an old velocity must not move it.
                let position = self.commands[0].position;
                let still = Reference {
                    position,
                    velocity_offset: VelocityUmS(0),
                    torque_offset: TorquePermille(0),
                };
                self.commands = [still; KEPT];
            }
        }
    }

    /// Motor side of the axis, m.
    #[must_use]
    pub const fn position_m(&self) -> f64 {
        self.motor.body.position_m
    }

    /// Its velocity, m/s.
    #[must_use]
    pub const fn velocity_m_per_s(&self) -> f64 {
        self.motor.body.velocity_m_per_s
    }

    /// Force of the motor, N.
    #[must_use]
    pub const fn force_n(&self) -> f64 {
        self.motor.force_n
    }

    /// Measurements that have come to the bus by now.
    fn report(&self) -> &Report {
        &self.reports[usize::from(self.settings.actual_delay_cycles.min(MAX_DELAY))]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gantry_tau_core::control::axis::Actual;
    use gantry_tau_core::units::PositionNm;
    use gantry_tau_machine::robot_file::TORQUE_LIMIT;

    fn reference(nm: i64) -> Reference {
        Reference {
            position: PositionNm(nm),
            velocity_offset: Default::default(),
            torque_offset: Default::default(),
        }
    }

    fn actual(drive: &Drive) -> Actual {
        report(std::iter::once(drive)).unwrap()
    }

    fn error_nm(drive: &Drive, nm: i64) -> i64 {
        (actual(drive).position.0 - nm).abs()
    }

    #[test]
    fn settles_after_a_step() {
        let pushed = Reference {
            torque_offset: TorquePermille(200),
            ..reference(0)
        };
        // By one over the gain of the position loop.
        let shifted = Reference {
            velocity_offset: VelocityUmS(150),
            ..reference(0)
        };
        for (of, reference_after, load_n, cycles, (nm, within_nm), permille) in [
            (
                "the reference",
                reference(20_000),
                0.0,
                60,
                (20_000, 100),
                None,
            ),
            ("the load", reference(0), 300.0, 80, (0, 100), Some(-300)),
            (
                "the torque offset, absorbed by the position loop",
                pushed,
                0.0,
                100,
                (0, 100),
                Some(0),
            ),
            ("the velocity offset", shifted, 0.0, 200, (1_000, 10), None),
        ] {
            let mut drive = Drive::at_rest(&reference(0), &Settings::IDEAL);
            drive.command(&reference_after);
            for _ in 0..cycles {
                drive.advance(load_n);
                assert!(actual(&drive).position.0 < 40_000, "{of}: {drive:?}");
            }
            assert!(error_nm(&drive, nm) < within_nm, "{of}: {drive:?}");
            assert!(
                permille.is_none_or(|permille| actual(&drive).torque.0 == permille),
                "{of}: {drive:?}"
            );
        }
    }

    #[test]
    fn follows_motion_closely() {
        let mut drive = Drive::at_rest(&reference(0), &Settings::IDEAL);
        let mut worst = 0;
        for cycle in 1..1000_i64 {
            // Up to 0.5 m/s, at 2 m/s^2.
            let nm = if cycle < 250 {
                cycle * cycle * 1000
            } else {
                250 * 250 * 1000 + (cycle - 250) * 500_000
            };
            drive.command(&reference(nm));
            drive.advance(0.0);
            worst = worst.max(error_nm(&drive, nm));
        }
        assert!(worst < 100_000, "{worst} nm");
        assert!(error_nm(&drive, 250 * 250 * 1000 + 749 * 500_000) < 1000);
    }

    #[test]
    fn overload_is_limited_and_recovered_from() {
        let mut drive = Drive::at_rest(&reference(0), &Settings::IDEAL);
        for _ in 0..20 {
            drive.advance(1.2 * TORQUE_LIMIT * RATED_FORCE_N);
            assert!(actual(&drive).torque.0 >= -3000);
        }
        for _ in 0..400 {
            drive.advance(0.0);
        }
        assert!(error_nm(&drive, 0) < 100, "{drive:?}");
    }

    /// Bits of a run with motion, offsets, load and saturation, from the revision before drives had
    /// supervision, latency and encoders.
    #[test]
    fn an_ideal_drive_without_latency_has_the_bits_of_the_first_one() {
        let mut drive = Drive::at_rest(&reference(1_000_000), &Settings::IDEAL);
        let mut digest = 0xcbf2_9ce4_8422_2325_u64;
        for cycle in 0..600_i64 {
            let offset = i32::try_from(cycle % 7 * 100).unwrap();
            drive.command(&Reference {
                velocity_offset: VelocityUmS(offset),
                torque_offset: TorquePermille(i16::try_from(cycle % 5).unwrap()),
                ..reference(1_000_000 + cycle * cycle * 900)
            });
            drive.advance(if cycle > 400 {
                3500.0
            } else {
                0.3 * cycle as f64
            });
            let torque = u64::from(actual(&drive).torque.0.unsigned_abs());
            for word in [drive.position_m().to_bits(), torque] {
                digest = (digest ^ word).wrapping_mul(0x0100_0000_01b3);
            }
        }
        assert_eq!(digest, 0x6ee3_4c5b_c983_ebfb, "{digest:#x}");
    }
}
