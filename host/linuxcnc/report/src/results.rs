//! Numbers of a demonstration in LinuxCNC, from its record.

use gantry_tau_core::Monitor;
use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::units::{PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_machine::robot_file::RobotFile;
use serde::Serialize;

use crate::record::Period;
use crate::tool::{Moment, Pair, norm};

/// Largest share of the displacement that may remain, as in `gantry-tau demo`.
pub(crate) const ALLOWED_SHARE: f64 = 0.05;
/// Periods for which the load must have stood, in Obtain, before a period counts as compensated:
/// the sensor's filter and the steps of the offsets need some 100 ms.
const SETTLED: usize = 300;
/// Smallest force that counts as a load, N.
pub(crate) const LOADED_N: f64 = 1.0;
/// Largest change of the force between two periods that counts as standing still, N. Where the
/// platform turns, the sensor's sample does.
const STANDS_N: f64 = 0.5;

/// Numbers of table, report and JSON file. The JSON layout is stable: fields are added, never
/// renamed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Results {
    /// Version of this layout.
    pub(crate) layout: u32,
    /// Robot file.
    pub(crate) robot: String,
    /// Servo periods judged, from the first session on.
    pub(crate) periods: usize,
    /// Sessions in which a load was compensated.
    pub(crate) sessions: Vec<LoadedSession>,
    /// The ramp of each session that did not end with Goodbye.
    pub(crate) ramps: Vec<Ramp>,
    /// Largest change of any offset in one period, nm.
    pub(crate) largest_change_nm: u32,
    /// The largest that the limits allow, nm.
    pub(crate) allowed_change_nm: u32,
    /// Results outside their limits; empty when all is well.
    pub(crate) complaints: Vec<String>,
}

/// One session's periods under a load that has stood for a while.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct LoadedSession {
    /// First and last of them, s.
    pub(crate) seconds: [f64; 2],
    /// Their number.
    pub(crate) periods: usize,
    /// Periods of them in which the path moved.
    pub(crate) moving: usize,
    /// Largest force on the tool, N.
    pub(crate) force_n: f64,
    /// Mean length of the displacement without offsets, µm.
    pub(crate) uncompensated_um: f64,
    /// The same with them.
    pub(crate) compensated_um: f64,
    /// Largest length with them.
    pub(crate) largest_um: f64,
    /// Second over first.
    pub(crate) remaining_share: f64,
    /// Mean angle of the platform's turning, µrad: without and with offsets.
    pub(crate) turn_urad: [f64; 2],
    /// Deadlines missed in the whole session.
    pub(crate) missed: u32,
}

/// The ramp after a session.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Ramp {
    /// Its first period, s.
    pub(crate) seconds: f64,
    /// Cause of the session's end, in words.
    pub(crate) cause: String,
    /// Offsets in the period before it, nm.
    pub(crate) start_offset_nm: Vec<i32>,
    /// Ticks until all offsets are zero.
    pub(crate) ticks: u64,
    /// Expected ticks: the largest start offset over the rate, rounded up.
    pub(crate) expected_ticks: u64,
    /// Periods in which an offset did not change by its rate, or by what was left of it; or, in a
    /// period without a tick, at all.
    pub(crate) inexact: usize,
    /// Periods in which the path moved.
    pub(crate) moving: usize,
}

impl Results {
    pub(crate) fn of<K, const N: usize>(robot: &RobotFile<K, N>, moments: &[Moment<N>]) -> Self {
        let changes =
            pairs(moments).flat_map(|(last, now)| last.offset_nm.into_iter().zip(now.offset_nm));
        let mut results = Self {
            layout: 1,
            robot: robot.name.clone(),
            periods: moments.len(),
            sessions: stretches(moments, &[Phase::Obtain])
                .filter_map(session)
                .collect(),
            ramps: stretches(moments, &[Phase::SafeDisconnect])
                .filter_map(|part| ramp(robot, moments, part))
                .collect(),
            largest_change_nm: changes
                .map(|(last, now)| last.abs_diff(now))
                .max()
                .unwrap_or(0),
            allowed_change_nm: robot
                .limits
                .iter()
                .map(|axis| axis.limits.position.step().unsigned_abs())
                .max()
                .unwrap_or(0),
            complaints: Vec::new(),
        };
        results.complaints = results.complain(judge(robot, moments));
        results
    }

    fn complain(&self, judged: Result<(), String>) -> Vec<String> {
        let mut complaints: Vec<String> = judged.err().into_iter().collect();
        if self.sessions.len() < 2 {
            complaints.push(format!(
                "{} sessions compensated a load, not two",
                self.sessions.len()
            ));
        }
        for session in &self.sessions {
            let [from, _] = session.seconds;
            // NaN is outside of every range.
            if !(0.0..=ALLOWED_SHARE).contains(&session.remaining_share) {
                let [share, allowed] =
                    [session.remaining_share, ALLOWED_SHARE].map(|share| 100.0 * share);
                complaints.push(format!(
                    "from {from:.1} s on {share:.1} % of the displacement remain, more than {allowed:.0} %"
                ));
            }
            if session.moving == 0 {
                complaints.push(format!("from {from:.1} s on the path stands still"));
            }
        }
        if self.ramps.iter().all(|ramp| ramp.moving == 0) {
            complaints.push("no ramp with a moving path".to_owned());
        }
        for ramp in &self.ramps {
            let Ramp {
                seconds,
                ticks,
                expected_ticks,
                inexact,
                ..
            } = ramp;
            if ticks != expected_ticks || *inexact > 0 {
                complaints.push(format!(
                    "the ramp at {seconds:.1} s took {ticks} ticks, not {expected_ticks}, and {inexact} of its steps are not exact"
                ));
            }
        }
        complaints
    }
}

/// Requires of every period what the core guarantees of references, with the core's monitor.
fn judge<K, const N: usize>(robot: &RobotFile<K, N>, moments: &[Moment<N>]) -> Result<(), String> {
    let limits = robot.limits.each_ref().map(|axis| axis.limits);
    let travels = robot.limits.each_ref().map(|axis| axis.machine_travel);
    let mut monitor = Monitor::new(limits, Some(travels));
    let Some(first) = moments.first() else {
        return Ok(());
    };
    let in_force = first
        .period
        .nominal_nm
        .map(|nm| InForce::at(PositionNm(nm)));
    monitor
        .rebase(&in_force)
        .map_err(|violation| violation.to_string())?;
    for Moment { period, .. } in moments {
        let nominal = period.nominal_nm.map(PositionNm);
        let references = period.reference_nm.map(|nm| Reference {
            position: PositionNm(nm),
            velocity_offset: VelocityUmS(0),
            torque_offset: TorquePermille(0),
        });
        let judged = monitor.check_references(&nominal, &references);
        judged.map_err(|violation| format!("period {}: {violation}", period.number))?;
        let joints = nominal
            .iter()
            .zip(&travels)
            .zip(period.reference_nm.iter().zip(period.offset_nm));
        for (joint, ((nominal, travel), (reference, offset))) in joints.enumerate() {
            let expected = (nominal.0 + i64::from(offset)).clamp(travel.lower.0, travel.upper.0);
            if *reference != expected {
                let number = period.number;
                return Err(format!(
                    "period {number}: joint {joint} is at {reference} nm, and command plus offset at {expected}"
                ));
            }
        }
    }
    Ok(())
}

/// Each period and the one after it.
fn pairs<const N: usize>(moments: &[Moment<N>]) -> impl Iterator<Item = (&Period<N>, &Period<N>)> {
    moments
        .iter()
        .zip(moments.iter().skip(1))
        .map(|(last, now)| (&last.period, &now.period))
}

/// Stretches in which the server is in one of some states.
pub(crate) fn stretches<'a, const N: usize>(
    moments: &'a [Moment<N>],
    phases: &'a [Phase],
) -> impl Iterator<Item = &'a [Moment<N>]> {
    moments
        .chunk_by(|last, now| is_in(last, phases) == is_in(now, phases))
        .filter(|part| part.first().is_some_and(|moment| is_in(moment, phases)))
}

fn is_in<const N: usize>(moment: &Moment<N>, phases: &[Phase]) -> bool {
    phases.contains(&moment.period.phase)
}

fn moving<const N: usize>(moments: &[Moment<N>]) -> usize {
    pairs(moments)
        .filter(|(last, now)| last.nominal_nm != now.nominal_nm)
        .count()
}

fn session<const N: usize>(obtained: &[Moment<N>]) -> Option<LoadedSession> {
    let standing = obtained.chunk_by(stands).max_by_key(|part| part.len())?;
    let settled = standing.get(SETTLED..).filter(|part| !part.is_empty())?;
    let ends = [settled.first()?, settled.last()?];
    let [compensated_um, uncompensated_um] = mean(settled, |moment| moment.displacement_um);
    let [turned, unheld] = mean(settled, |moment| moment.turn_urad);
    Some(LoadedSession {
        seconds: ends.map(|moment| moment.period.number as f64 / 1e3),
        periods: settled.len(),
        moving: moving(settled),
        force_n: largest(settled, |moment| moment.force_n),
        uncompensated_um,
        compensated_um,
        largest_um: largest(settled, |moment| moment.displacement_um.with),
        remaining_share: compensated_um / uncompensated_um,
        turn_urad: [unheld, turned],
        missed: obtained
            .iter()
            .map(|moment| moment.period.missed)
            .max()
            .unwrap_or(0),
    })
}

/// True if a load stands still from one period to the next.
fn stands<const N: usize>(last: &Moment<N>, now: &Moment<N>) -> bool {
    let same = last
        .force_n
        .iter()
        .zip(now.force_n)
        .all(|(last, now)| (last - now).abs() < STANDS_N);
    same && norm(now.force_n) > LOADED_N
}

/// Mean lengths, with the offsets and without them.
fn mean<const N: usize>(moments: &[Moment<N>], value: fn(&Moment<N>) -> Pair) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for norms in moments.iter().map(|moment| value(moment).norms()) {
        sums = [sums[0] + norms[0], sums[1] + norms[1]];
    }
    sums.map(|sum| sum / moments.len() as f64)
}

/// Largest length.
fn largest<const N: usize>(moments: &[Moment<N>], value: fn(&Moment<N>) -> [f64; 3]) -> f64 {
    let lengths = moments.iter().map(|moment| norm(value(moment)));
    lengths.fold(0.0, f64::max)
}

fn ramp<K, const N: usize>(
    robot: &RobotFile<K, N>,
    all: &[Moment<N>],
    ramping: &[Moment<N>],
) -> Option<Ramp> {
    let first = &ramping.first()?.period;
    let before = all
        .iter()
        .take_while(|moment| moment.period.number < first.number)
        .last()?
        .period;
    if before.offset_nm == [0; N] {
        return None;
    }
    let rates = robot
        .limits
        .each_ref()
        .map(|axis| axis.limits.position.ramp());
    let all: Vec<&Period<N>> = std::iter::once(&before)
        .chain(ramping.iter().map(|moment| &moment.period))
        .collect();
    let steps = all.iter().zip(all.iter().skip(1));
    let expected = before
        .offset_nm
        .iter()
        .zip(rates)
        .map(|(offset, rate)| offset.unsigned_abs().div_ceil(rate).into());
    Some(Ramp {
        seconds: first.number as f64 / 1e3,
        cause: first.cause.to_string(),
        start_offset_nm: before.offset_nm.into(),
        ticks: 1 + steps
            .clone()
            .take_while(|(_, now)| now.offset_nm != [0; N])
            .filter(|(last, now)| last.tick != now.tick)
            .count() as u64,
        expected_ticks: expected.max().unwrap_or(0),
        inexact: steps
            .filter(|(last, now)| !is_exact(last, now, rates))
            .count(),
        moving: moving(ramping),
    })
}

/// True if every offset changes by its rate, or by what is left of it; or, in a period without a
/// tick, not at all.
fn is_exact<const N: usize>(last: &Period<N>, now: &Period<N>, rates: [u32; N]) -> bool {
    let is_held = last.tick == now.tick;
    let mut offsets = last.offset_nm.iter().zip(now.offset_nm).zip(rates);
    offsets.all(|((last, now), rate)| {
        let left = last.unsigned_abs() - last.unsigned_abs().min(if is_held { 0 } else { rate });
        left == now.unsigned_abs() && last.signum() * now.signum() >= 0
    })
}
