//! Position loops between the session and drives that take velocities: core's [`PositionLoops`],
//! and what permits them to run.
//!
//! The session's references are followed, never changed. While the loops stop or stand, those
//! references are not in force: to the session the drives have refused them, so it is in Fault,
//! ramps its offsets, and goes on from where the axes stand.

use gantry_tau_core::control::axis::{Actual, InForce, Reference};
use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::control::position_loop::config::LoopConfig;
use gantry_tau_core::control::position_loop::quick_stop::{QuickStop, travel_margin_m};
use gantry_tau_core::control::position_loop::{
    Enable, LoopInput, LoopStop, PositionLoops, VelocityReference,
};
use gantry_tau_core::control::session::config::AxisConfig;

use super::cycle::OperatorInputs;
use crate::black_box::loops::{LoopsBox, LoopsInput};
use crate::plant::{Plant, PlantError, PlantFailure, VelocityPlant};

/// [`VelocityPlant::write_velocity`] of a machine.
type WriteVelocity<const N: usize, const M: usize, P> = fn(
    &mut P,
    &[VelocityReference; M],
    Option<&[InForce; N]>,
)
    -> Result<(), <P as Plant<N, M>>::Error>;

/// Reason why a machine must not be moved by velocities.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum VelocityInterfaceError {
    /// The drives take positions.
    #[error("the drives take positions, and drives.interface is \"velocity\"")]
    Positions,
    /// The drives have no watchdog, or one that acts too late.
    #[error(
        "velocities need a watchdog of 1 to {} cycles; the drives have one of {cycles}",
        QuickStop::MAX_WATCHDOG_CYCLES
    )]
    Watchdog {
        /// Cycles after which it acts.
        cycles: u32,
    },
    /// The drives have no quick stop.
    #[error("velocities need a quick stop; the drives' deceleration is {m_per_s2} m/s^2")]
    QuickStop {
        /// Its deceleration.
        m_per_s2: f64,
    },
    /// A stop by the drives leaves the machine's travel.
    #[error(
        "axis {axis}: the machine's travel is {:.1} mm longer than the path's; a stop by the drives takes {:.1} mm",
        .margin_m * 1e3,
        .stop_m * 1e3
    )]
    Travel {
        /// Index of the axis.
        axis: usize,
        /// Travel of the machine beyond that of the path.
        margin_m: f64,
        /// Distance that a stop by the drives takes.
        stop_m: f64,
    },
}

/// Position loops of a machine with `N` axes and `M` motors.
pub struct VelocityInterface<const N: usize, const M: usize, P: Plant<N, M>> {
    loops: PositionLoops<N>,
    /// Of a machine that takes velocities; no other can be asked.
    write_velocity: WriteVelocity<N, M, P>,
    motors: MotorMap<N, M>,
    /// The drives took the last velocities.
    accepted: bool,
    /// The loops have run since the start.
    has_run: bool,
}

/// Result of writing to the machine in one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Written {
    /// It took the references, and follows them.
    Followed,
    /// It took velocities, by which its axes are stopped.
    Stopped,
    /// It did not take what was written, or its position loops have stopped by themselves.
    Failed(PlantFailure),
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
    /// Inputs of the operator at the machine.
    pub operator: OperatorInputs,
}

impl<const N: usize, const M: usize, P: Plant<N, M>> VelocityInterface<N, M, P> {
    /// Creates loops at rest at what is in force.
    ///
    /// # Errors
    /// [`VelocityInterfaceError`]: the drives do not stop by themselves in time, or within the
    /// travel.
    pub fn new(
        config: [LoopConfig; N],
        motors: MotorMap<N, M>,
        axes: &[AxisConfig; N],
        in_force: &[InForce; N],
        plant: &P,
    ) -> Result<Self, VelocityInterfaceError>
    where
        P: VelocityPlant<N, M>,
    {
        let own = plant
            .quick_stop()
            .ok_or(VelocityInterfaceError::Positions)?;
        if own.watchdog_cycles == 0 || own.watchdog_cycles > QuickStop::MAX_WATCHDOG_CYCLES {
            return Err(VelocityInterfaceError::Watchdog {
                cycles: own.watchdog_cycles,
            });
        }
        if !(own.quick_stop_m_per_s2.is_finite() && own.quick_stop_m_per_s2 > 0.0) {
            return Err(VelocityInterfaceError::QuickStop {
                m_per_s2: own.quick_stop_m_per_s2,
            });
        }
        for (axis, (config, limits)) in config.iter().zip(axes).enumerate() {
            let stop_m = own.stopping_distance_m(f64::from(config.values().velocity.max()) * 1e-6);
            let margin_m = travel_margin_m(limits);
            if margin_m < stop_m {
                return Err(VelocityInterfaceError::Travel {
                    axis,
                    margin_m,
                    stop_m,
                });
            }
        }
        let references = in_force.map(|axis| axis.nominal);
        Ok(Self {
            loops: PositionLoops::at_rest(config, references),
            write_velocity: P::write_velocity,
            motors,
            accepted: true,
            has_run: false,
        })
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

    /// Runs the loops, and writes their velocities.
    pub fn write(
        &mut self,
        plant: &mut P,
        followed: &Followed<'_, N>,
        recorder: Option<&mut LoopsBox<N>>,
    ) -> Written {
        let permit = self.permit(followed);
        let mut inputs = followed.references.map(|reference| LoopInput {
            reference,
            actual: None,
            permit,
        });
        for (input, actual) in inputs.iter_mut().zip(followed.actual.into_iter().flatten()) {
            input.actual = Some(actual.position);
        }
        let (before, accepted) = (self.loops, self.accepted);
        let axes = self.loops.tick(&inputs, accepted);
        if let Some(recorder) = recorder {
            recorder.before_tick(&before);
            recorder.after_tick(
                &LoopsInput {
                    accepted,
                    axes: inputs,
                },
                &axes,
                followed.ends,
            );
        }
        let is_running = self.loops.is_running();
        self.has_run |= is_running;
        let motors = spread(&self.motors, &axes);
        let written = (self.write_velocity)(plant, &motors, is_running.then_some(followed.parts));
        self.accepted = written.is_ok();
        if let Err(error) = written {
            return Written::Failed(PlantFailure::of(&error));
        }
        match self.loops.stop() {
            None => Written::Followed,
            // Nothing else keeps them from running.
            Some(_)
                if permit == Enable::Rearm
                    && accepted
                    && before.is_at_rest()
                    && followed.actual.is_some() =>
            {
                let reason = "an axis is further from its reference than its window (drives.following_error_um)";
                lost(reason)
            }
            Some((_, LoopStop::NotPermitted)) => Written::Stopped,
            Some((_, stop)) => lost(reason(stop)),
        }
    }

    /// In Fault the loops stop, and a re-arm lets them run again. The first time they begin by
    /// themselves.
    const fn permit(&self, followed: &Followed<'_, N>) -> Enable {
        let OperatorInputs { stop, quit, rearm } = followed.operator;
        let is_faulted = matches!(followed.phase, Phase::Fault);
        if stop || quit || followed.withheld || (is_faulted && !rearm) {
            Enable::Stop
        } else if is_faulted || !self.has_run {
            Enable::Rearm
        } else {
            Enable::Run
        }
    }
}

/// Returns the failure of axes that do not follow their references.
fn lost(reason: &'static str) -> Written {
    let operation = "follow its references";
    Written::Failed(PlantFailure::of(&PlantError { operation, reason }))
}

/// Returns the reference of each motor: those of one axis get the same.
pub fn spread<const N: usize, const M: usize>(
    motors: &MotorMap<N, M>,
    axes: &[VelocityReference; N],
) -> [VelocityReference; M] {
    // Every axis of a motor map exists.
    motors
        .axis_of_motor()
        .map(|axis| axes.get(axis).copied().unwrap_or_default())
}

const fn reason(stop: LoopStop) -> &'static str {
    match stop {
        LoopStop::NoActual => "a position is unknown to its position loop",
        LoopStop::FollowingError => {
            "the following error of a position loop was too large (drives.following_error_um)"
        }
        LoopStop::Limited => {
            "the limits of a position loop cut its velocity for too long: an overload, or position_loop.max_m_per_s2 is too small"
        }
        LoopStop::Refused => "the drives did not take a velocity",
        _ => "a position loop has stopped",
    }
}
