//! Samples of the server's rows, kept for the results.

use std::time::Duration;

use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_core::control::monitor::{Monitor, Violation};
use gantry_tau_core::units::Tick;
use gantry_tau_report::plots::over_time::Timed;
use gantry_tau_server::record::TickRecord;

use super::scenario::PlayError;

/// Pause when no row is waiting.
const REST: Duration = Duration::from_millis(1);
/// Time without a row after which the server counts as stuck.
const PATIENCE: Duration = Duration::from_secs(10);

/// Values of one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TickSample<const N: usize> {
    pub(super) tick: u64,
    pub(super) phase: Phase,
    pub(super) step: u32,
    pub(super) offset_nm: [i32; N],
    pub(super) reference_nm: [i64; N],
    pub(super) displacement_um: [f64; 3],
    pub(super) turn_urad: [f64; 3],
    pub(super) gauges_um: [f64; 3],
    pub(super) missed: u32,
    pub(super) longest_miss_run: u16,
    pub(super) round_trip_us: Option<u32>,
    pub(super) ended: Option<Cause>,
}

impl<const N: usize> Timed for TickSample<N> {
    /// Ticks of 1 ms.
    fn seconds(&self) -> f64 {
        self.tick as f64 / 1e3
    }

    fn phase(&self) -> Phase {
        self.phase
    }
}

impl<const N: usize> TickSample<N> {
    fn of(row: &TickRecord<N>) -> Self {
        let tool = row.tool;
        Self {
            tick: row.state.tick.0,
            phase: row.state.phase,
            step: tool.map_or(0, |tool| tool.step),
            offset_nm: row.state.axes.map(|axis| axis.offsets.position.0),
            reference_nm: row.references.map(|reference| reference.position.0),
            displacement_um: millionths(tool.map(|tool| tool.displacement_m)),
            turn_urad: millionths(tool.map(|tool| tool.turn_rad)),
            gauges_um: millionths(tool.map(|tool| tool.gauges_m)),
            missed: row.state.counters.missed,
            longest_miss_run: row.state.counters.longest_miss_run,
            round_trip_us: row.round_trip_us,
            ended: row.ended,
        }
    }
}

/// Values in µm of m, or in µrad of rad; not a number where they are not measured.
fn millionths(values: Option<[f64; 3]>) -> [f64; 3] {
    values.map_or([f64::NAN; 3], |values| values.map(|value| value * 1e6))
}

/// Collects every row, and checks it against the limits.
pub(super) struct Sampler<const N: usize> {
    rows: rtrb::Consumer<TickRecord<N>>,
    monitor: Monitor<N>,
    pub(super) samples: Vec<TickSample<N>>,
    /// The first broken limit and its tick.
    pub(super) violation: Option<(Tick, Violation)>,
}

impl<const N: usize> Sampler<N> {
    pub(super) const fn new(rows: rtrb::Consumer<TickRecord<N>>, monitor: Monitor<N>) -> Self {
        Self {
            rows,
            monitor,
            samples: Vec::new(),
            violation: None,
        }
    }

    /// Waits for the next row that satisfies `found`; every row is kept and passed to `each`.
    /// With `may_end`, the session may end meanwhile.
    pub(super) fn until(
        &mut self,
        may_end: bool,
        mut each: impl FnMut(&TickSample<N>),
        mut found: impl FnMut(&TickSample<N>) -> bool,
    ) -> Result<TickSample<N>, PlayError> {
        let mut idle = Duration::ZERO;
        loop {
            let Ok(row) = self.rows.pop() else {
                if idle >= PATIENCE || self.rows.is_abandoned() {
                    return Err(PlayError::Failed(
                        "the server delivers no more ticks".to_owned(),
                    ));
                }
                std::thread::sleep(REST);
                idle += REST;
                continue;
            };
            idle = Duration::ZERO;
            if let Err(violation) = self.monitor.check_tick(&row.state, &row.references) {
                self.violation.get_or_insert((row.state.tick, violation));
            }
            let sample = TickSample::of(&row);
            self.samples.push(sample);
            each(&sample);
            if let (Some(cause), false) = (sample.ended, may_end) {
                return Err(PlayError::Lost(format!(
                    "this machine does not hold 1 kHz throughout: in tick {} the session ended by itself ({cause})",
                    sample.tick
                )));
            }
            if found(&sample) {
                return Ok(sample);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use gantry_tau_core::control::message::Capabilities;
    use gantry_tau_core::control::monitor::Rule;
    use gantry_tau_core::units::EpochRange;

    use super::*;
    use gantry_tau_machine::robot_file::RobotFile;
    use gantry_tau_server::plant::interpolator::Motion;
    use gantry_tau_server::server::cycle::{Cycle, OperatorInputs};
    use gantry_tau_sim::load_generator::load_generator;
    use gantry_tau_sim::machine::SimulatedMachine;

    #[test]
    fn the_first_broken_limit_is_kept_with_its_tick() {
        let robot = RobotFile::builtin_l2().unwrap();
        let config = robot.session_config(Capabilities::NONE).unwrap();
        let limits = config.parameters().axes.map(|axis| axis.limits);
        let (_hand, tool) = load_generator();
        let machine = SimulatedMachine::from_robot(&robot, tool, Motion::Hold).unwrap();
        let motors = robot.motor_map::<3>().unwrap();
        let any = std::net::SocketAddr::from(([127, 0, 0, 1], 0));
        let mut cycle = Cycle::new(
            config,
            motors,
            machine,
            EpochRange::VOLATILE,
            gantry_tau_server::state::StopLatch::volatile(),
            any,
        )
        .unwrap();
        let (mut sender, rows) = rtrb::RingBuffer::new(8);
        let mut sampler = Sampler::new(rows, Monitor::new(limits, None));
        for jump in [0, 0, 1, 2_000_000, 0] {
            let mut row = cycle.step(1, OperatorInputs::default());
            row.references[1].position.0 += jump;
            sender.push(row).unwrap();
        }
        for jumped in [false, false, true, true, true] {
            let sample = sampler.until(false, |_| {}, |_| true).unwrap();
            let found = sampler.violation;
            assert_eq!(found.is_some(), jumped);
            if let Some((tick, violation)) = found {
                assert_eq!((violation.axis, violation.rule), (1, Rule::Reference));
                assert!(tick.0 <= sample.tick && tick.0 + 2 >= sample.tick);
            }
        }
    }
}
