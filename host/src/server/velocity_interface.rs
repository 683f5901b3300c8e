//! Position loops between the session and drives that take velocities: core's [`PositionLoops`], and what permits them to run.
//!
//! The session's references are followed, never changed. While the loops stop or stand, those references are not in force: to the session
//! the drives have refused them, so it is in Fault, ramps its offsets, and goes on from where the axes stand.

use gantry_tau_core::control::axis::{Actual, InForce, Reference};
use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::control::position_loop::config::LoopConfig;
use gantry_tau_core::control::position_loop::{LoopInput, LoopStop, Permit, PositionLoops, VelocityReference};
use gantry_tau_core::control::session::config::AxisConfig;

use super::cycle::Demands;
use crate::black_box::loops::{LoopsBox, LoopsInput};
use crate::plant::{OwnStop, Plant, PlantError};

/// Position loops of a machine with `N` axes and `M` motors.
#[derive(Clone, Debug)]
pub struct VelocityInterface<const N: usize, const M: usize> {
    loops: PositionLoops<N>,
    motors: MotorMap<N, M>,
    /// The drives took the last velocities.
    accepted: bool,
    /// The loops have run since the start.
    has_run: bool,
}

/// References of one tick, as the session gave them, and what permits to follow them.
#[derive(Clone, Copy, Debug)]
pub struct Followed<'a, const N: usize> {
    /// References of the axes.
    pub references: &'a [Reference; N],
    /// Nominal references and offsets that they consist of.
    pub parts: &'a [InForce; N],
    /// The session withholds them.
    pub withheld: bool,
    /// Measurements of this tick; `None` if the machine could not be read.
    pub actual: Option<&'a [Actual; N]>,
    /// Phase after the tick.
    pub phase: Phase,
    /// A session, or what goes on without one, ended in this tick.
    pub ends: bool,
    /// Switches at the machine.
    pub demands: Demands,
}

impl<const N: usize, const M: usize> VelocityInterface<N, M> {
    /// Creates loops at rest at what is in force.
    ///
    /// # Errors
    /// The reason for which the machine must not be moved by velocities: its drives do not stop by themselves in time, or within the
    /// travel.
    pub fn new(
        config: [LoopConfig; N],
        motors: MotorMap<N, M>,
        axes: &[AxisConfig; N],
        in_force: &[InForce; N],
        own_stop: Option<OwnStop>,
    ) -> Result<Self, String> {
        let own = own_stop.ok_or("the drives take positions, and drives.interface is \"velocity\"")?;
        if own.watchdog_cycles == 0 || own.watchdog_cycles > OwnStop::MAX_WATCHDOG_CYCLES {
            let (cycles, most) = (own.watchdog_cycles, OwnStop::MAX_WATCHDOG_CYCLES);
            return Err(format!("velocities need a watchdog of 1 to {most} cycles; the drives have one of {cycles}"));
        }
        if !(own.quick_stop_m_per_s2.is_finite() && own.quick_stop_m_per_s2 > 0.0) {
            return Err(format!(
                "velocities need a quick stop; the drives' deceleration is {} m/s^2",
                own.quick_stop_m_per_s2
            ));
        }
        for (axis, (config, limits)) in config.iter().zip(axes).enumerate() {
            let way_m = own.way_m(f64::from(config.values().velocity.max()) * 1e-6);
            let margin_m = travel_margin_m(limits);
            if margin_m < way_m {
                return Err(format!(
                    "axis {axis}: the machine's travel is {:.1} mm longer than the path's; a stop by the drives takes {:.1} mm",
                    margin_m * 1e3,
                    way_m * 1e3
                ));
            }
        }
        let references = in_force.map(|axis| axis.nominal);
        Ok(Self { loops: PositionLoops::at_rest(config, references), motors, accepted: true, has_run: false })
    }

    /// Returns the loops.
    #[must_use]
    pub const fn loops(&self) -> &PositionLoops<N> {
        &self.loops
    }

    /// True if the drives took the last velocities.
    #[must_use]
    pub const fn is_accepted(&self) -> bool {
        self.accepted
    }

    /// True if the loops have stopped and the drives have taken velocities of zero.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.accepted && !self.loops.is_running() && self.loops.is_at_rest()
    }

    /// Runs the loops, and writes their velocities. Returns true if the axes follow the references, and false if they were stopped.
    ///
    /// # Errors
    /// The loops have stopped by themselves, or the machine did not take the velocities.
    pub fn write<P: Plant<N, M>>(
        &mut self,
        plant: &mut P,
        followed: &Followed<'_, N>,
        recorder: Option<&mut LoopsBox<N>>,
    ) -> Result<bool, PlantError> {
        let permit = self.permit(followed);
        let mut inputs = followed.references.map(|reference| LoopInput { reference, actual: None, permit });
        for (input, actual) in inputs.iter_mut().zip(followed.actual.into_iter().flatten()) {
            input.actual = Some(actual.position);
        }
        let (before, accepted) = (self.loops, self.accepted);
        let axes = self.loops.tick(&inputs, accepted);
        if let Some(recorder) = recorder {
            recorder.before_tick(&before);
            recorder.after_tick(&LoopsInput { accepted, axes: inputs }, &axes, followed.ends);
        }
        let is_running = self.loops.is_running();
        self.has_run |= is_running;
        let motors = spread(&self.motors, &axes);
        let written = plant.write_velocity(&motors, is_running.then_some(followed.parts));
        self.accepted = written.is_ok();
        written?;
        match self.loops.stop() {
            None => Ok(true),
            // Nothing else keeps them from running.
            Some(_) if permit == Permit::Rearm && accepted && before.is_at_rest() && followed.actual.is_some() => {
                let reason = "an axis is further from its reference than its window (drives.following_error_um)";
                Err(PlantError { operation: "follow its references", reason })
            }
            Some((_, LoopStop::NotPermitted)) => Ok(false),
            Some((_, stop)) => Err(PlantError { operation: "follow its references", reason: reason(stop) }),
        }
    }

    /// In Fault the loops stop, and a re-arm lets them run again. The first time they begin by themselves.
    const fn permit(&self, followed: &Followed<'_, N>) -> Permit {
        let Demands { stop, quit, rearm } = followed.demands;
        let is_faulted = matches!(followed.phase, Phase::Fault);
        if stop || quit || followed.withheld || (is_faulted && !rearm) {
            Permit::Stop
        } else if is_faulted || !self.has_run {
            Permit::Rearm
        } else {
            Permit::Run
        }
    }
}

/// Returns the reference of each motor: those of one axis get the same.
pub(crate) fn spread<const N: usize, const M: usize>(
    motors: &MotorMap<N, M>,
    axes: &[VelocityReference; N],
) -> [VelocityReference; M] {
    // Every axis of a motor map exists.
    motors.axis_of_motor().map(|axis| axes.get(axis).copied().unwrap_or_default())
}

/// Returns the smallest distance from an end of the path's travel to the machine's, m.
pub(crate) fn travel_margin_m(limits: &AxisConfig) -> f64 {
    let (nominal, machine) = (&limits.nominal_travel, &limits.machine_travel);
    let below_m = nominal.lower.to_metres().0 - machine.lower.to_metres().0;
    let above_m = machine.upper.to_metres().0 - nominal.upper.to_metres().0;
    below_m.min(above_m)
}

const fn reason(stop: LoopStop) -> &'static str {
    match stop {
        LoopStop::NoActual => "a position is unknown to its position loop",
        LoopStop::FollowingError => "the following error of a position loop was too large (drives.following_error_um)",
        LoopStop::Limited => {
            "the limits of a position loop cut its velocity for too long: an overload, or position_loop.max_m_per_s2 is too small"
        }
        LoopStop::Refused => "the drives did not take a velocity",
        _ => "a position loop has stopped",
    }
}
