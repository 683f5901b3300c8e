//! Numbers of a demo, from its recording.

use gantry_tau_core::control::message::Phase;
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_server::server::tick_source::TickSource;
use serde::Serialize;

use super::DemoOptions;
use super::corrections::Corrections;
use super::motion::MotionNumbers;
use super::sampler::TickSample;
use super::scenario::{COMPENSATED, Recording};

/// Largest share of the displacement that may remain at any step below the jump.
pub const ALLOWED_SHARE: f64 = 0.05;

/// Numbers of table, report and JSON file. The JSON layout is stable: fields are added, never
/// renamed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Results {
    /// Version of this layout.
    pub layout: u32,
    /// "real" or "lockstep".
    pub pace: &'static str,
    /// Robot file.
    pub robot: String,
    /// Number of axes; with three, the turning of the platform cannot be compensated.
    pub axes: usize,
    /// Force steps.
    pub steps: Vec<ForceStep>,
    /// Both ways to compute a correction, under the largest force below the jump.
    pub corrections: Option<Corrections>,
    /// The ramp after the cable was pulled.
    pub ramp: Ramp,
    /// Computed motion of a machine with masses.
    pub in_motion: Option<MotionNumbers>,
    /// Quality of the connection until the cable was pulled.
    pub link: LinkQuality,
    /// Largest change of any drive reference in one tick, nm, from the first tick to the last.
    pub largest_reference_change_nm: u64,
    /// Largest change the limits allow, nm per tick.
    pub allowed_reference_change_nm: u32,
    /// Results outside their limits; empty when all is well.
    pub complaints: Vec<String>,
}

/// One force step; displacements are means over its settled half.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ForceStep {
    /// Force in x, N.
    pub force_n: f64,
    /// Mean displacement of the tool without compensation, µm, x y z.
    pub uncompensated_um: [f64; 3],
    /// The same with compensation.
    pub compensated_um: [f64; 3],
    /// Length of the first, µm.
    pub uncompensated_norm_um: f64,
    /// Length of the second, µm.
    pub compensated_norm_um: f64,
    /// Second over first.
    pub remaining_share: f64,
    /// Angle by which the platform is turned, µrad: without and with compensation.
    pub turn_urad: [f64; 2],
    /// Second over first.
    pub remaining_turn_share: f64,
    /// At or beyond 95 % of the force at which the machine jumps; the jump is never compensated.
    pub beyond_jump: bool,
    /// Length of the displacement as the quantised gauges show it, µm: without and with
    /// compensation.
    pub gauges_um: [f64; 2],
}

/// Ramp after the cable was pulled.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ramp {
    /// Cause of the session's end, in words.
    pub cause: String,
    /// Offsets in the last tick before the ramp, nm.
    pub start_offset_nm: Vec<i32>,
    /// Ticks of the ramp, each one step; an overrun of the server skips tick numbers, not steps.
    pub ticks: u64,
    /// Expected ticks: the largest start offset over the ramp rate, rounded up.
    pub expected_ticks: u64,
    /// Largest change of any offset in one tick, nm.
    pub largest_change_nm: u32,
    /// Answer to a newcomer during the ramp, in words.
    pub refusal: String,
    /// Last message of the client whose cable was pulled.
    pub client: String,
}

/// Quality of a connection.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LinkQuality {
    /// Deadlines of the session.
    pub deadlines: u64,
    /// Deadlines missed.
    pub missed: u32,
    /// Share of deadlines met.
    pub on_time_share: f64,
    /// Longest run of misses.
    pub longest_miss_run: u16,
    /// From a State's departure to its answer's arrival, µs: median, 99th percentile, largest.
    pub round_trip_us: [u32; 3],
}

impl Results {
    pub(super) fn of<K: MachineKind<N>, const N: usize>(
        options: &DemoOptions<K, N>,
        pace: TickSource,
        recording: &Recording<N>,
        in_motion: Option<MotionNumbers>,
    ) -> Self {
        let samples = &recording.samples;
        let limits = options.robot.limits.iter();
        let largest_step = limits
            .map(|axis| axis.limits.position.step().unsigned_abs())
            .max();
        let mut results = Self {
            layout: 1,
            pace: match pace {
                TickSource::RealTime => "real",
                TickSource::Lockstep => "lockstep",
            },
            robot: options.robot.name.clone(),
            axes: N,
            corrections: corrections(options),
            steps: steps(options, samples),
            ramp: ramp(options, recording),
            in_motion,
            link: link(samples, recording.ended.tick),
            largest_reference_change_nm: largest_change(samples),
            allowed_reference_change_nm: largest_step.unwrap_or(0),
            complaints: Vec::new(),
        };
        results.complain(recording);
        results
    }

    fn complain<const N: usize>(&mut self, recording: &Recording<N>) {
        let mut complaints = Vec::new();
        for step in self.steps.iter().filter(|step| !step.beyond_jump) {
            let turn = (self.axes > ARMS).then_some(("turning", step.remaining_turn_share));
            for (what, share) in [("displacement", step.remaining_share)]
                .into_iter()
                .chain(turn)
            {
                // NaN is outside of every range.
                if !(0.0..=ALLOWED_SHARE).contains(&share) {
                    complaints.push(format!(
                        "at {:.0} N {:.1} % of the {what} remain, more than {:.0} %",
                        step.force_n,
                        100.0 * share,
                        100.0 * ALLOWED_SHARE
                    ));
                }
            }
        }
        let ramp = &self.ramp;
        if ramp.ticks != ramp.expected_ticks {
            complaints.push(format!(
                "the ramp took {} ticks, not {}",
                ramp.ticks, ramp.expected_ticks
            ));
        }
        if let Some((tick, violation)) = recording.violation {
            complaints.push(format!("tick {}: {violation}", tick.0));
        }
        if recording.dropped > 0 {
            complaints.push(format!("{} ticks were not sampled", recording.dropped));
        }
        self.complaints = complaints;
    }
}

fn is_beyond_jump<K, const N: usize>(options: &DemoOptions<K, N>, force_n: f64) -> bool {
    force_n >= 0.95 * options.robot.simulation.jump_force_n
}

fn corrections<K: MachineKind<N>, const N: usize>(
    options: &DemoOptions<K, N>,
) -> Option<Corrections> {
    let below = options
        .forces_n()
        .into_iter()
        .filter(|force_n| !is_beyond_jump(options, *force_n));
    Corrections::of(&options.robot, below.last()?)
}

fn steps<K, const N: usize>(
    options: &DemoOptions<K, N>,
    samples: &[TickSample<N>],
) -> Vec<ForceStep> {
    (1..)
        .zip(options.forces_n())
        .map(|(number, force_n)| {
            let before = settled(options, samples, number);
            let after = settled(options, samples, COMPENSATED + number);
            let u = mean(&before, |s| s.displacement_um);
            let c = mean(&after, |s| s.displacement_um);
            let turn_urad = [&before, &after].map(|half| norm(mean(half, |s| s.turn_urad)));
            let [turned, held] = turn_urad;
            let gauges_um = [&before, &after].map(|half| norm(mean(half, |s| s.gauges_um)));
            ForceStep {
                force_n,
                uncompensated_um: u,
                compensated_um: c,
                uncompensated_norm_um: norm(u),
                compensated_norm_um: norm(c),
                remaining_share: norm(c) / norm(u),
                turn_urad,
                remaining_turn_share: held / turned,
                beyond_jump: is_beyond_jump(options, force_n),
                gauges_um,
            }
        })
        .collect()
}

/// Returns the samples of the second half of a step. A step is cut off at its nominal length,
/// before the cable is pulled.
fn settled<'a, K, const N: usize>(
    options: &DemoOptions<K, N>,
    samples: &'a [TickSample<N>],
    step: u32,
) -> Vec<&'a TickSample<N>> {
    let Some(first) = samples.iter().find(|sample| sample.step == step) else {
        return Vec::new();
    };
    let from = first.tick + options.step_ticks() / 2;
    let to = first.tick + options.step_ticks();
    samples
        .iter()
        .filter(|sample| sample.step == step && (from..=to).contains(&sample.tick))
        .collect()
}

fn mean<const N: usize>(
    samples: &[&TickSample<N>],
    value: impl Fn(&TickSample<N>) -> [f64; 3],
) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let mut count = 0.0;
    for sample in samples {
        for (total, part) in sum.iter_mut().zip(value(sample)) {
            *total += part;
        }
        count += 1.0;
    }
    sum.map(|total| total / count)
}

fn norm(vector: [f64; 3]) -> f64 {
    vector.iter().map(|value| value * value).sum::<f64>().sqrt()
}

fn ramp<K, const N: usize>(options: &DemoOptions<K, N>, recording: &Recording<N>) -> Ramp {
    let samples = &recording.samples;
    let ended = recording.ended.tick;
    let before = samples.iter().take_while(|s| s.tick < ended).last();
    let start_offset_nm = before.map_or([0; N], |sample| sample.offset_nm);
    let during = samples
        .iter()
        .filter(|s| s.tick >= ended && s.phase == Phase::SafeDisconnect);
    // Counts rows, not tick numbers: an overrun skips numbers, and the ramp takes one step per row.
    let above_zero = during
        .clone()
        .take_while(|sample| sample.offset_nm != [0; N]);
    let ticks = above_zero.count() as u64 + 1;
    let mut last = start_offset_nm;
    let mut largest_change_nm = 0;
    for sample in during {
        for (from, to) in last.into_iter().zip(sample.offset_nm) {
            largest_change_nm = largest_change_nm.max(from.abs_diff(to));
        }
        last = sample.offset_nm;
    }
    let rates = options.robot.limits.map(|axis| axis.limits.position.ramp());
    let expected = start_offset_nm.into_iter().zip(rates);
    Ramp {
        cause: (recording.ended.ended).map_or_else(|| "none".to_owned(), |cause| cause.to_string()),
        start_offset_nm: start_offset_nm.into(),
        ticks,
        expected_ticks: expected
            .map(|(offset, rate)| u64::from(offset.unsigned_abs().div_ceil(rate)))
            .max()
            .unwrap_or(0),
        largest_change_nm,
        refusal: recording.refusal.to_string(),
        client: recording.client.clone(),
    }
}

fn link<const N: usize>(samples: &[TickSample<N>], ended: u64) -> LinkQuality {
    let session = samples
        .iter()
        .filter(|s| s.tick < ended && matches!(s.phase, Phase::Submit | Phase::Obtain));
    // The first of the two misses that end the session is caused by the cable as well.
    let last = session.clone().rev().nth(1);
    let missed = last.map_or(0, |sample| sample.missed);
    let deadlines = match (session.clone().next(), last) {
        (Some(first), Some(last)) => last.tick - first.tick,
        _ => 0,
    };
    let mut round_trips: Vec<u32> = session.filter_map(|s| s.round_trip_us).collect();
    round_trips.sort_unstable();
    LinkQuality {
        deadlines,
        missed,
        on_time_share: 1.0 - f64::from(missed) / deadlines.max(1) as f64,
        longest_miss_run: last.map_or(0, |sample| sample.longest_miss_run),
        round_trip_us: [0.5, 0.99, 1.0].map(|share| quantile(&round_trips, share)),
    }
}

/// Returns the value below which this share of sorted values is; 0 without values.
fn quantile(sorted: &[u32], share: f64) -> u32 {
    let last = sorted.len().saturating_sub(1);
    let index = (share * last as f64).ceil() as usize;
    sorted.get(index).copied().unwrap_or(0)
}

/// Returns the largest change of any reference between consecutive samples.
fn largest_change<const N: usize>(samples: &[TickSample<N>]) -> u64 {
    let pairs = samples.iter().zip(samples.iter().skip(1));
    pairs
        .flat_map(|(a, b)| a.reference_nm.into_iter().zip(b.reference_nm))
        .map(|(from, to)| from.abs_diff(to))
        .max()
        .unwrap_or(0)
}
