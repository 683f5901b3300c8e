//! Motion of a machine with masses, cycle by cycle without a server: a tap in free air, and a path
//! that accelerates.

use std::error::Error;

use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{FeedForwardKey, FilterKey, RobotFile};
use gantry_tau_machine::stability::Place;
use gantry_tau_machine::stability::design::SETTLED;
use gantry_tau_report::plots::{Curve, Plot};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_sim::load_pattern::LoadPattern;
use gantry_tau_sim::machine::SimulatedMachine;
use nalgebra::Vector3;
use serde::Serialize;

use super::{DemoError, DemoOptions};
use crate::compensated_machine::CompensatedMachine;

/// Cycles after the tare until the tap, and until the path begins.
const REST: u32 = 500;
/// Cycles that are shown.
const SHOWN: u32 = 1_500;
/// Cycle of a curve after which a tap is over for a second.
const SECOND: usize = 1_000;
/// Force of the tap, N, and the cycles that it lasts.
const TAP: (f64, u32) = (100.0, 20);
/// Cut-off of the filter of first order, Hz.
const FAST_HZ: f64 = 20.0;
/// Acceleration of the path, m/s^2, and its largest speed, m/s.
const ACCELERATION: f64 = 5.0;
const SPEED: f64 = 2.0;
/// Lengths of the path that are tried, m.
const WAYS_M: [f64; 6] = [0.4, -0.4, 0.2, -0.2, 0.1, -0.1];

/// Displacement of the tool over time, s and um.
type Track = Vec<(f64, f64)>;

/// Motion of a machine with masses.
#[derive(Clone, Debug)]
pub struct InMotion {
    settles_s: f64,
    margin_any_phase: f64,
    /// With the filter of the file, and with one of first order.
    tap: [Track; 2],
    /// Without feed-forward and with it; absent if no path is in reach.
    path: Option<[Track; 2]>,
}

/// Numbers of the motion of a machine with masses.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MotionNumbers {
    /// Time to 5 % of a step of the load with the filter of the client, s.
    pub settles_s: f64,
    /// Margin of the compensation at home against any phase.
    pub margin_any_phase: f64,
    /// Largest displacement from a second after a tap on, um: with the filter of the file, and with
    /// one of first order.
    pub tap_left_um: [f64; 2],
    /// Largest displacement on a path, um: without feed-forward and with it.
    pub path_largest_um: Option<[f64; 2]>,
}

impl InMotion {
    /// Moves the machine of a demo. `None` without masses, and of drives that take velocities.
    ///
    /// # Errors
    /// The machine or its client cannot run.
    pub fn of<K: MachineKind<N>, const N: usize, const M: usize>(
        options: &DemoOptions<K, N>,
    ) -> Result<Option<Self>, DemoError> {
        let moved = move_it::<K, N, M>(&options.robot, &options.client);
        moved.map_err(|error| DemoError::Failed(error.to_string()))
    }

    /// Returns what is said of it in numbers.
    #[must_use]
    pub fn numbers(&self) -> MotionNumbers {
        let tap = self.tap.each_ref();
        let path = self.path.as_ref();
        MotionNumbers {
            settles_s: self.settles_s,
            margin_any_phase: self.margin_any_phase,
            tap_left_um: tap.map(|track| largest(track.get(SECOND..).unwrap_or_default())),
            path_largest_um: path.map(|path| path.each_ref().map(|track| largest(track))),
        }
    }

    pub(super) fn tap_plot(&self) -> Plot {
        let names = ["filter of the file", "first order, 20 Hz"];
        plot("A tap in free air", names, &self.tap)
    }

    pub(super) fn path_plot(&self) -> Option<Plot> {
        let names = ["without feed-forward", "with feed-forward"];
        let path = self.path.as_ref()?;
        Some(plot("A path at 5 m/s²", names, path))
    }
}

fn plot(title: &str, names: [&str; 2], tracks: &[Track; 2]) -> Plot {
    let curves = names.into_iter().zip(tracks);
    let curves = curves.map(|(name, track)| Curve::line(name, track.clone()));
    Plot::new(title, "time, s", "displacement, µm", curves.collect())
}

fn largest(track: &[(f64, f64)]) -> f64 {
    track.iter().fold(0.0, |most, (_, um)| most.max(*um))
}

fn move_it<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    client: &RobotFile<K, N>,
) -> Result<Option<InMotion>, Box<dyn Error>> {
    // Drives that take velocities need the loops of a server.
    let moves = robot.masses.is_some() && robot.position_loops.is_none();
    let place = Place::at_home(client, client.client.gain).filter(|_| moves);
    let Some(place) = place else {
        return Ok(None);
    };
    let mut first_order = client.clone();
    first_order.sensor.filter = Some(FilterKey::FirstOrder);
    first_order.sensor.cutoff_hz = FAST_HZ;
    let path = match path(robot) {
        Some(motion) => Some(along::<K, N, M>(robot, client, &motion)?),
        None => None,
    };
    Ok(Some(InMotion {
        settles_s: place.filter().settling_s(SETTLED),
        margin_any_phase: place.margins.exact.any_phase,
        tap: [
            track::<K, N, M>(robot, client, Motion::Hold, true)?,
            track::<K, N, M>(robot, &first_order, Motion::Hold, true)?,
        ],
        path,
    }))
}

/// Moves along a path without feed-forward, and with it.
fn along<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    client: &RobotFile<K, N>,
    motion: &Motion<N>,
) -> Result<[Track; 2], Box<dyn Error>> {
    let mut client = client.clone();
    let mut tracks = [Track::new(), Track::new()];
    let keys = [FeedForwardKey::None, FeedForwardKey::Inertia];
    for (track_of, key) in tracks.iter_mut().zip(keys) {
        client.client.feed_forward = key;
        *track_of = track::<K, N, M>(robot, &client, motion.clone(), false)?;
    }
    Ok(tracks)
}

/// Returns a path along the guideway of arm 1, as long as it is in reach.
fn path<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) -> Option<Motion<N>> {
    let along: Vector3<f64> = robot.model.geometry().guideways.first()?.normalize();
    let end_q = WAYS_M.into_iter().find_map(|way_m| {
        let end_m = robot.home_m() + along * way_m;
        robot.model.axes_at(&end_m).ok()
    })?;
    let mut end_m = end_q;
    for (place, metres) in end_m.iter_mut().zip(&robot.metres_per_q) {
        *place *= metres;
    }
    Some(Motion::BackAndForth {
        waypoints_m: vec![end_m],
        speed_m_per_s: SPEED,
        acceleration_m_per_s2: ACCELERATION,
        dwell_cycles: robot.sensor.tare_samples + REST,
    })
}

/// Returns the displacement of the tool from the end of the rest on.
fn track<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    client: &RobotFile<K, N>,
    motion: Motion<N>,
    is_tapped: bool,
) -> Result<Track, Box<dyn Error>> {
    let (mut hand, tool) = load_generator();
    let machine = SimulatedMachine::<N, M>::moving_from_robot(robot, tool, motion)?;
    let mut machine = CompensatedMachine::new(machine, client)?;
    for _ in 0..robot.sensor.tare_samples + REST {
        machine.cycle()?;
    }
    if is_tapped {
        let (force_n, cycles) = TAP;
        hand.begin(LoadPattern::Tap {
            force_n,
            cycles,
            every_cycles: SHOWN,
        });
    }
    let mut track = Track::new();
    for cycle in 0..SHOWN {
        let displacement_m = Vector3::from(machine.cycle()?.displacement_m);
        track.push((f64::from(cycle) * 1e-3, displacement_m.norm() * 1e6));
    }
    Ok(track)
}
