//! A campaign over loopback, in lock-step: time is that of the ticks.

mod gauges;
mod recorded;

use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::mpsc::{Sender, channel};

use gantry_tau_client::force_sensor::Sample;
use gantry_tau_client::{Observer, Oscillation};
use gantry_tau_core::control::message::{Capabilities, State, Welcome};
use gantry_tau_core::units::{Epoch, EpochRange, Tick as CoreTick};

use gantry_tau_machine::model::{L2, L2_MOTORS};
use gantry_tau_record::recording::drain;
use gantry_tau_server::links::gauges::GaugePublisher;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::Server;
use gantry_tau_server::server::cycle::Cycle;
use gantry_tau_server::server::tick_source::TickSource;
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::springs::TrueSprings;
use gantry_tau_system::output::Name;

use super::*;
use crate::experiment::campaign_machine::CampaignMachine;
use crate::experiment::fixture::{Folder, campaign_a, first_series, plan_in};
use crate::experiment::gauges::SimulatedGauges;
use crate::experiment::prediction::unloaded;
use crate::experiment::ticks;
use crate::measurements::springs::{self, Campaign, Window};
use crate::springs::identify::{IdentifyOptions, identify};

fn loopback() -> SocketAddr {
    ([127, 0, 0, 1], 0).into()
}

fn robot() -> RobotFile<L2, 3> {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.simulation.jump_gap_m = 0.0;
    robot.simulation.gauge_point_mm = 0.5;
    robot.simulation.gauge_axis_mrad = 2.0;
    robot.sensor.tare_samples = 100;
    robot
}

/// The simulated machine in a campaign, behind a server.
struct TestBench {
    server: Server<3>,
    gauges: SocketAddr,
    ticks: Arc<AtomicU64>,
}

impl TestBench {
    fn start(robot: &RobotFile<L2, 3>, plan: &Plan<3>) -> Self {
        Self::watched(robot, plan, |_| {})
    }

    /// As [`start`](Self::start); `watch` sees each tick.
    fn watched(
        robot: &RobotFile<L2, 3>,
        plan: &Plan<3>,
        mut watch: impl FnMut(&TickRecord<3>) + Send + 'static,
    ) -> Self {
        let link = GaugePublisher::bind(loopback()).unwrap();
        let gauges = link.address().unwrap();
        let machine =
            CampaignMachine::<3, L2_MOTORS>::from_robot(robot, plan.clone(), link).unwrap();
        let switch = machine.switch();
        let config = robot.session_config(Capabilities::LOCKSTEP).unwrap();
        let motors = robot.motor_map().unwrap();
        let cycle = Cycle::new(
            config,
            motors,
            machine,
            EpochRange::VOLATILE,
            StopLatch::volatile(),
            loopback(),
        );
        let (server, mut rows) = Server::spawn(cycle.unwrap(), TickSource::Lockstep).unwrap();
        let ticks = Arc::new(AtomicU64::new(0));
        let seen = Arc::clone(&ticks);
        // Ends with the server.
        std::thread::spawn(move || {
            drain(&mut rows, |row, _| {
                switch.see(row);
                watch(row);
                seen.store(row.state.tick.0, Ordering::Relaxed);
            });
        });
        Self {
            server,
            gauges,
            ticks,
        }
    }

    fn options(
        &self,
        robot: &RobotFile<L2, 3>,
        plan: &Plan<3>,
        output: &Path,
    ) -> LiveOptions<L2, 3> {
        LiveOptions {
            robot: robot.clone(),
            plan: plan.clone(),
            server: self.server.address.into(),
            transport: Transport::Stream,
            key: None,
            sensor: SensorSource::States,
            accelerometer: None,
            gauges: Some(self.gauges.into()),
            obtain: false,
            is_unattended: true,
            raw: None,
            output: output.to_owned(),
        }
    }
}

/// Found from outside: a table that hung kept Ctrl-C from the client.
#[test]
fn a_client_is_asked_to_leave_even_if_the_campaign_hangs() {
    let quit = AtomicBool::new(false);
    let controls = ClientControls::default();
    let (queue, _ticks) = rtrb::RingBuffer::new(1);
    let mut probe = Probe::new(&quit, &controls, None, 0, [1.0; 3], queue);
    let state = TickRecord::listening().state;
    for is_quitting in [false, true] {
        quit.store(is_quitting, Ordering::Relaxed);
        probe.answered(&state, None).unwrap();
        assert_eq!(controls.quit.load(Ordering::Relaxed), is_quitting);
    }
}

/// Offsets that went to zero by themselves would be measured as compensation.
#[test]
fn a_session_that_left_an_oscillation_is_refused() {
    assert!(stayed(ClientReport::default()).is_ok());
    let report = ClientReport {
        oscillations: 1,
        last_oscillation: Some(Oscillation {
            axis: 1,
            is_growing: true,
            period_us: 50_000,
            swing_nm: 12_000,
        }),
        ..ClientReport::default()
    };
    let error = stayed(report).unwrap_err();
    assert!(is_final(&error));
    let begin = "axis 2: the targets oscillate at 20.0 Hz with swings of 12.0 um, growing";
    assert!(error.to_string().starts_with(begin), "{error}");
}

/// A probe that was welcomed by a server with these capabilities, and its queue of one tick.
fn welcomed<'a>(
    quit: &'a AtomicBool,
    controls: &'a ClientControls,
    capabilities: Capabilities,
) -> (Probe<'a, 3>, rtrb::Consumer<ProbeTick<3>>) {
    let (queue, ticks) = rtrb::RingBuffer::<ProbeTick<3>>::new(1);
    let mut probe = Probe::new(quit, controls, None, 0, [1.0; 3], queue);
    probe.welcomed(&Welcome {
        epoch: Epoch(1),
        tick: CoreTick(0),
        cycle_us: 1_000,
        echo_window: 0,
        capabilities,
        kinematics_checksum: 0,
        limits: robot().limits.map(|axis| axis.limits),
    });
    (probe, ticks)
}

/// Shows a tick to a probe, without a load.
fn show(probe: &mut Probe<'_, 3>, tick: u64) {
    let state = State {
        tick: CoreTick(tick),
        ..TickRecord::listening().state
    };
    let sample = Sample {
        tick,
        wrench: [0.0; 6],
        is_cut: false,
    };
    probe.answered(&state, Some(&sample)).unwrap();
}

/// In lock-step the client waits for a campaign that is behind; by the clock its tick is lost.
#[test]
fn a_full_queue_is_waited_for_in_lock_step_alone() {
    let quit = AtomicBool::new(false);
    let controls = ClientControls::default();
    let (mut by_clock, mut ticks) = welcomed(&quit, &controls, Capabilities::NONE);
    show(&mut by_clock, 1);
    show(&mut by_clock, 2);
    assert_eq!(ticks.pop().map(|tick| tick.sample.tick), Ok(1));
    assert!(ticks.is_empty());
    let (mut in_lockstep, mut ticks) = welcomed(&quit, &controls, Capabilities::LOCKSTEP);
    let taken = std::thread::scope(|scope| {
        scope.spawn(move || {
            (1..=5).for_each(|tick| show(&mut in_lockstep, tick));
            drop(in_lockstep);
        });
        let mut taken = Vec::new();
        loop {
            let is_over = ticks.is_abandoned();
            taken.extend(ticks.pop().map(|tick| tick.sample.tick));
            if is_over && ticks.is_empty() {
                break taken;
            }
            std::thread::yield_now();
        }
    });
    assert_eq!(taken, [1, 2, 3, 4, 5]);
}

/// Keys that are never pressed.
fn no_keys() -> (Sender<String>, Receiver<String>) {
    channel()
}

/// Runs a campaign to its end, or until the table has `rows` rows.
fn run_until(options: &LiveOptions<L2, 3>, rows: usize) -> LiveReport {
    let quit = Arc::new(AtomicBool::new(false));
    let (_silent, keys) = no_keys();
    let stop = Arc::clone(&quit);
    let output = options.output.clone();
    let is_over = Arc::new(AtomicBool::new(false));
    let over = Arc::clone(&is_over);
    let watch = std::thread::spawn(move || {
        while !over.load(Ordering::Relaxed) {
            let lines = std::fs::read_to_string(&output)
                .unwrap_or_default()
                .lines()
                .count();
            if lines > rows {
                stop.store(true, Ordering::Relaxed);
            }
            std::thread::sleep(REST);
        }
    });
    let report = run(options.clone(), &quit, &keys).unwrap();
    is_over.store(true, Ordering::Relaxed);
    watch.join().unwrap();
    report
}

/// Checks every reading against the machine's own springs under the load of the row, series by
/// series from its first row.
fn assert_agrees(robot: &RobotFile<L2, 3>, plan: &Plan<3>, campaign: &Campaign<3>) {
    let springs = TrueSprings::from_robot(robot).unwrap();
    let machine = springs.machine();
    let gauges = SimulatedGauges::new(plan, &robot.simulation);
    for (series, planned) in plan.series.iter().enumerate() {
        let windows: Vec<&Window<3>> = campaign
            .windows
            .iter()
            .filter(|window| window.series == series)
            .collect();
        let first = windows[0];
        let began = unloaded(machine, &first.q, &plan.poses[planned.pose].1).unwrap();

        for window in &windows {
            let now = machine
                .equilibrium(&window.q, &window.load, &began)
                .unwrap();
            for gauge in 0..plan.gauges.len() {
                let [here, there] = [(*window, now), (first, began)].map(|(window, now)| {
                    let exact = gauges.read(
                        (series, planned.mounting, gauge),
                        &springs.loaded(began.pose, now, window.load, &[]),
                        0.0,
                    );
                    window.readings_m[gauge].unwrap() - exact
                });
                let off = here - there;
                // Gauges repeat to 1 um in each of two windows; the load's own error is below a
                // micrometre here.
                assert!(
                    off.abs() < 6e-6,
                    "series {series}, window {}, gauge {gauge}: {off:e}",
                    window.window
                );
            }
            let level_n = planned.levels_n[window.window.parse::<usize>().unwrap() - 1];
            let force_n = window.load.fixed_rows::<3>(0).dot(&planned.direction);
            // 0.2 N a sample, of which 2 000 are averaged; the sensor's axes are turned back by a
            // prediction that is 3 % off.
            assert!((force_n - level_n).abs() < 0.1, "{force_n} {level_n}");
        }
    }
}

#[test]
fn a_campaign_over_loopback_measures_the_machine() {
    let folder = Folder::new("live");
    let text = first_series(&campaign_a("", &[0, 240, 0]), 4);
    let robot = robot();
    let plan = plan_in(&folder, &text);
    let bench = TestBench::start(&robot, &plan);
    let output = folder.path("springs.csv");
    let mut options = bench.options(&robot, &plan, &output);
    options.raw = Some(folder.path("raw.csv"));
    let report = run_until(&options, usize::MAX);
    assert_eq!(
        report,
        LiveReport {
            taken: 12,
            missing: 0
        }
    );
    let campaign = springs::read(&folder.path("plan.toml"), "l2", &[1.0; 3]).unwrap();
    let expected: Vec<(usize, Name, i8)> = (0..4)
        .flat_map(|series| {
            [0, 1, -1]
                .into_iter()
                .enumerate()
                .map(move |(level, stroke)| (series, Name::made(level + 1), stroke))
        })
        .collect();
    let found: Vec<_> = campaign
        .windows
        .iter()
        .map(|window| (window.series, window.window.clone(), window.stroke))
        .collect();
    assert_eq!(found, expected);
    assert_agrees(&robot, &plan, &campaign);
    let times: Vec<f64> = campaign
        .windows
        .iter()
        .map(|window| window.time_s.unwrap())
        .collect();
    assert!(times.is_sorted() && times[11] > 60.0, "{times:?}");
    assert_same_windows(&folder, &robot, &campaign);
    // And the same answer: by the digits of a micrometre that the table of ticks has, far below a
    // standard deviation.
    let [by_windows, by_ticks] =
        [None, Some(folder.path("raw.csv"))].map(|raw| identified(&folder, &robot, raw));
    assert_eq!(by_windows.len(), 9);
    for (one, other) in by_windows.iter().zip(&by_ticks) {
        assert!(
            (one / other - 1.0).abs() < 1e-6,
            "{by_windows:?} {by_ticks:?}"
        );
    }
    bench.server.quit().unwrap();
}

/// Springs of a machine by `identify`: from its table of windows, or from one of ticks.
fn identified(folder: &Folder, robot: &RobotFile<L2, 3>, raw: Option<PathBuf>) -> Vec<f64> {
    let options = IdentifyOptions {
        raw,
        ..IdentifyOptions::new(folder.path("plan.toml"), "l2")
    };
    let answer: serde_json::Value =
        serde_json::from_str(&identify(robot, &options).unwrap().json).unwrap();
    answer["parameters"]
        .as_array()
        .unwrap()
        .iter()
        .map(|parameter| parameter["value"].as_f64().unwrap())
        .collect()
}

/// Checks that the windows of a campaign are those that its table of ticks gives: to rounding, of a
/// sum of 2 000 readings of 1 mm.
fn assert_same_windows(folder: &Folder, robot: &RobotFile<L2, 3>, campaign: &Campaign<3>) {
    let prediction = Prediction::new(robot).unwrap();
    let made = ticks::read(
        &folder.path("raw.csv"),
        &folder.path("plan.toml"),
        robot,
        &prediction,
    )
    .unwrap();
    assert_eq!(made.missed, [""; 0]);
    let made = made.campaign;
    assert_eq!(
        (&made.series, &made.mountings),
        (&campaign.series, &campaign.mountings)
    );
    assert_eq!(made.windows.len(), campaign.windows.len());
    for (one, other) in made.windows.iter().zip(&campaign.windows) {
        let [names, others] = [one, other].map(|window| {
            (
                window.series,
                window.mounting,
                window.pose,
                window.window.clone(),
                window.stroke,
            )
        });
        assert_eq!(names, others);
        assert_close(&one.q, &other.q, 1e-12);
        assert_close(one.load.as_slice(), other.load.as_slice(), 1e-9);
        let [lengths, others] = [one, other].map(|window| {
            let lengths = window.readings_m.iter().chain(&window.sds_m);
            lengths.map(|length| length.unwrap()).collect::<Vec<f64>>()
        });
        assert_close(&lengths, &others, 1e-14);
        assert_close(&[one.time_s.unwrap()], &[other.time_s.unwrap()], 1e-9);
    }
}

fn assert_close(some: &[f64], others: &[f64], to: f64) {
    for (one, other) in some.iter().zip(others) {
        assert!((one - other).abs() <= to, "{one:e} {other:e}");
    }
}

#[test]
fn an_interrupted_campaign_goes_on_where_it_ended() {
    let folder = Folder::new("resumed");
    let text = first_series(&campaign_a("", &[0, 60, 120, 60, 0]), 2);
    let robot = robot();
    let plan = plan_in(&folder, &text);
    let bench = TestBench::start(&robot, &plan);
    let output = folder.path("springs.csv");
    let mut options = bench.options(&robot, &plan, &output);
    options.raw = Some(folder.path("raw.csv"));
    // In the middle of the first series, and at its end.
    let mut before = Vec::new();
    for rows in [3, 5, usize::MAX] {
        run_until(&options, rows);
        let now = std::fs::read(&output).unwrap();
        assert!(
            now.starts_with(&before),
            "the bytes of windows that were taken stay"
        );
        before = now;
    }
    let campaign = springs::read(&folder.path("plan.toml"), "l2", &[1.0; 3]).unwrap();
    let found: Vec<_> = campaign
        .windows
        .iter()
        .map(|window| (window.series, window.window.as_str()))
        .collect();
    let expected: Vec<_> = (0..2)
        .flat_map(|series| ["1", "2", "3", "4", "5"].map(|window| (series, window)))
        .collect();
    assert_eq!(found, expected);
    assert_agrees(&robot, &plan, &campaign);
    assert_same_windows(&folder, &robot, &campaign);
    // Nothing is left to do, and nothing is done.
    assert_eq!(
        run_until(&options, usize::MAX),
        LiveReport {
            taken: 0,
            missing: 0
        }
    );
    assert_eq!(std::fs::read(&output).unwrap(), before);
    bench.server.quit().unwrap();
}
