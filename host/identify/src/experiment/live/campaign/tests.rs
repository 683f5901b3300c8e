//! A campaign fed tick by tick: an operator, a strap and gauges without sockets.

use gantry_tau_machine::model::L2;
use gantry_tau_machine::sensor::Mounting;
use gantry_tau_server::links::gauges::MAX_GAUGES;
use gantry_tau_system::output::Name;
use gantry_tau_test_support::logged::logged;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::experiment::fixture::{Folder, campaign_a, first_series, plan_in};
use crate::experiment::noise::normal;
use crate::measurements::springs;

/// A machine at home, whose strap and gauges follow the test.
struct TestBench {
    folder: Folder,
    campaign: LiveCampaign<3>,
    robot: RobotFile<L2, 3>,
    random: ChaCha8Rng,
    tick: u64,
    /// Zero error of the force sensor, N.
    bias_n: f64,
    /// Pull along x at the tool centre point, N, and its change per second.
    pull_n: (f64, f64),
    /// Distance of the first axis from the pose, nm.
    off_nm: i64,
    /// All gauges, m.
    length_m: f64,
}

/// Noise of a sample: N, m.
const FORCE_N: f64 = 0.2;
const LENGTH_M: f64 = 0.3e-6;

impl TestBench {
    fn new(name: &str, levels: &[u32], has_gauges: bool) -> Self {
        Self::with_series(name, &first_series(&campaign_a("", levels), 1), has_gauges)
    }

    fn with_series(name: &str, plan: &str, has_gauges: bool) -> Self {
        let folder = Folder::new(name);
        plan_in(&folder, plan);
        let robot = RobotFile::builtin_l2().unwrap();
        let campaign = Self::campaign(&folder, &robot, has_gauges);
        let random = ChaCha8Rng::seed_from_u64(1);
        Self {
            folder,
            campaign,
            robot,
            random,
            tick: 7,
            bias_n: 3.0,
            pull_n: (0.0, 0.0),
            off_nm: 0,
            length_m: 0.0,
        }
    }

    fn campaign(folder: &Folder, robot: &RobotFile<L2, 3>, has_gauges: bool) -> LiveCampaign<3> {
        let plan = crate::experiment::fixture::read(&folder.path("plan.toml"));
        let table = WindowTable::open(&folder.path("springs.csv"), &plan, true).unwrap();
        let prediction = Prediction::new(robot).unwrap();
        let mut campaign = LiveCampaign::new(robot, plan, table, prediction, None).unwrap();
        campaign.set_instruments(has_gauges, false);
        campaign
    }

    /// Another program goes on with the table, once this one has ended.
    fn restart(self) -> Self {
        let Self {
            folder,
            campaign,
            robot,
            ..
        } = self;
        let has_gauges = campaign.has_gauges;
        drop(campaign);
        let campaign = Self::campaign(&folder, &robot, has_gauges);
        Self {
            folder,
            campaign,
            robot,
            ..self
        }
    }

    /// Lets seconds pass.
    fn wait(&mut self, seconds: u32) {
        self.passes(seconds).unwrap();
    }

    /// Lets seconds pass, until an error.
    fn passes(&mut self, seconds: u32) -> Result<(), ExperimentError> {
        let mounting = Mounting::from(&self.robot.sensor);
        let place = &self.campaign.places[0];
        let nominal = place.nominal;
        let rotation = place.unloaded.pose.rotation;
        for _ in 0..seconds * 1_000 {
            let force = self.pull_n.0 + normal(&mut self.random, FORCE_N);
            self.pull_n.0 += self.pull_n.1 * TICK_S;
            // At the hook, 80 mm below the tool centre point.
            let load = Vector6::new(force, 0.0, 0.0, 0.0, -0.08 * force, 0.0);
            let mut wrench: [f64; 6] = mounting.seen(&load, &rotation).into();
            wrench[0] += self.bias_n;
            let mut lengths_m = [0.0; MAX_GAUGES];
            for length_m in &mut lengths_m {
                *length_m = self.length_m + normal(&mut self.random, LENGTH_M);
            }
            let gauges = if self.campaign.has_gauges { 9 } else { 0 };
            let q = nominal.map(|axis| axis.to_metres().0);
            let mut nominal = nominal;
            nominal[0].0 += self.off_nm;
            let sample = InstrumentSample {
                tick: self.tick,
                q,
                wrench,
                lengths_m,
                gauges,
            };
            self.campaign.feed(&ProbeTick { sample, nominal })?;
            self.tick += 1;
        }
        Ok(())
    }

    fn key(&mut self, line: &str) {
        self.campaign.key(line).unwrap();
    }

    /// The windows of the table, each with the name of its series.
    fn windows(&self) -> Vec<(Name, springs::Window<3>)> {
        let plan = crate::experiment::fixture::read(&self.folder.path("plan.toml"));
        let path = self.folder.path("springs.csv");
        // The table is made with its first row.
        if !path.exists() {
            return Vec::new();
        }
        springs::windows_of::<3>(&path, &plan.poses, &plan.gauges).unwrap()
    }

    /// Series, window, force in x (N) and first reading (um) of each row.
    fn rows(&self) -> Vec<(String, String, f64, f64)> {
        self.windows()
            .into_iter()
            .map(|(name, window)| {
                (
                    name.to_string(),
                    window.window.to_string(),
                    window.load[0],
                    window.readings_m[0].unwrap() * 1e6,
                )
            })
            .collect()
    }

    fn names(&self) -> Vec<String> {
        self.rows()
            .iter()
            .map(|(series, window, ..)| format!("{series} {window}"))
            .collect()
    }
}

#[test]
fn a_window_needs_a_pose_an_operator_a_pull_and_calm() {
    let mut bench = TestBench::new("operator", &[0, 60, 0], true);
    bench.off_nm = 200_000;
    bench.key("");
    bench.wait(20);
    // Enter counts once it was asked for: in the pose.
    bench.off_nm = 0;
    bench.wait(20);
    assert_eq!(bench.names(), [""; 0]);
    bench.key("");
    bench.wait(8);
    assert_eq!(bench.names(), ["x1 1"]);
    // Not the pull of the level; then a pull that runs away by 3 N/s; then a calm one.
    bench.pull_n = (100.0, 0.0);
    bench.wait(10);
    bench.pull_n = (56.0, 1.5);
    bench.wait(5);
    assert_eq!(bench.names(), ["x1 1"]);
    bench.pull_n = (62.0, 0.0);
    bench.length_m = 5e-6;
    bench.wait(8);
    let rows = bench.rows();
    assert_eq!(bench.names(), ["x1 1", "x1 2"]);
    // The tare has the zero error; five deviations of a mean of 2 000 samples, twice. The platform
    // turns by the pull: 60 N x 0.5 mrad.
    assert!((rows[1].2 - 62.0).abs() < 0.1, "{rows:?}");
    assert!(
        (rows[1].3 - 5.0).abs() < 0.1 && rows[0].3.abs() < 0.1,
        "{rows:?}"
    );
    bench.pull_n = (0.0, 0.0);
    bench.wait(8);
    assert!(bench.campaign.is_done());
    assert_eq!(
        bench.campaign.report(),
        LiveReport {
            taken: 3,
            missing: 0
        }
    );
    // 0.3 um a sample are 7 nm of a mean; its noise is the stated micrometre at least.
    assert!(
        bench
            .windows()
            .iter()
            .all(|(_, window)| window.sds_m == vec![Some(1e-6); 9])
    );
}

#[test]
fn what_is_waited_for_is_said_every_five_seconds() {
    let mut bench = TestBench::new("reminded", &[0, 60], true);
    bench.off_nm = 200_000;
    let ((), said) = logged(|| bench.wait(21));
    assert_eq!(
        said.matches("waiting for pose home; the farthest axis is 0.20 mm away")
            .count(),
        4,
        "{said}"
    );
    bench.off_nm = 0;
    let ((), said) = logged(|| bench.wait(21));
    assert_eq!(
        said.matches("press Enter with the strap slack").count(),
        5,
        "once in the pose, then reminders: {said}"
    );
    bench.key("");
    bench.wait(8);
    bench.pull_n = (-0.2, 0.0);
    let ((), said) = logged(|| bench.wait(6));
    assert!(
        said.contains("series x1, window 2 of 2: pull to 60 N along (1, 0, 0) at the hook (0, 0, -0.08) m: now 0 N"),
        "{said}"
    );
    assert!(!said.contains("-0 N"), "{said}");
}

/// A force sensor that counts in other units than it should.
#[test]
fn a_load_that_no_machine_bears_is_reported_with_its_size() {
    let mut bench = TestBench::new("units", &[0, 60], true);
    bench.wait(1);
    bench.key("");
    bench.wait(8);
    bench.pull_n = (1e6, 0.0);
    let said = bench.passes(1).unwrap_err().to_string();
    // The mean of a tenth of a second, of which two ticks are that far.
    assert!(
        said.starts_with("series x1, 60 N: the sensor shows 20000 N and 0 N m, which "),
        "{said}"
    );
    assert!(said.ends_with("; look at the sensor's units"), "{said}");
}

/// A gauge that was touched before the first window: no row has the series' first name.
#[test]
fn a_series_remounted_before_its_first_window_is_not_asked_for_again() {
    let mut bench = TestBench::new("remounted", &[0, 60, 0], true);
    bench.wait(1);
    bench.key("remount");
    bench.wait(1);
    bench.key("");
    bench.wait(8);
    assert_eq!(bench.names(), ["x1.2 1"]);
    bench = bench.restart();
    bench.wait(1);
    bench.key("");
    bench.wait(8);
    for pull in [60.0, 0.0] {
        bench.pull_n = (pull, 0.0);
        bench.wait(8);
    }
    assert!(bench.campaign.is_done());
    assert_eq!(bench.names(), ["x1.2 1", "x1.2 2", "x1.2 3"]);
}

#[test]
fn a_level_that_was_skipped_is_asked_for_in_a_remounted_series() {
    let mut bench = TestBench::new("skipped", &[0, 60, 0], true);
    bench.wait(1);
    bench.key("");
    bench.wait(8);
    bench.key("skip");
    bench.key("remount");
    bench.wait(1);
    bench.key("");
    bench.wait(8);
    bench.pull_n = (60.0, 0.0);
    bench.wait(8);
    assert_eq!(bench.names(), ["x1 1", "x1.2 1", "x1.2 2"]);
}

/// The later series was remounted by an earlier program.
#[test]
fn a_remounted_series_does_not_ask_for_a_later_one_again() {
    let plan = first_series(&campaign_a("", &[0, 60]), 2)
        .replace("\"aside\"\nmounting", "\"home\"\nmounting")
        .replace("direction = [0.0, 1.0, 0.0]", "direction = [1.0, 0.0, 0.0]");
    let mut bench = TestBench::with_series("later", &plan, true);
    bench.wait(1);
    bench.key("skip");
    bench.wait(1);
    bench.key("remount");
    bench.wait(1);
    bench.key("");
    bench.wait(8);
    assert_eq!(bench.names(), ["y1.2 1"]);
    bench = bench.restart();
    bench.wait(1);
    bench.key("remount");
    for _ in ["x1.2", "y1.2"] {
        bench.pull_n = (0.0, 0.0);
        bench.wait(1);
        bench.key("");
        bench.wait(8);
        bench.pull_n = (60.0, 0.0);
        bench.wait(8);
    }
    assert_eq!(bench.names(), ["y1.2 1", "x1.2 1", "x1.2 2", "y1.2 2"]);
    assert!(bench.campaign.is_done());
}

#[test]
fn a_machine_that_leaves_the_pose_is_waited_for() {
    let mut bench = TestBench::new("left", &[0, 60, 0], true);
    bench.wait(1);
    bench.key("");
    bench.wait(8);
    bench.pull_n = (60.0, 0.0);
    bench.wait(3);
    bench.off_nm = -150_000;
    bench.wait(1);
    bench.off_nm = 0;
    bench.wait(20);
    assert_eq!(bench.names(), ["x1 1"], "the sensor must be tared again");
    let ((), said) = logged(|| bench.key("again"));
    assert!(
        said.contains("no window of this series was taken since the tare"),
        "{said}"
    );
    // With another zero error than before, and the strap slack.
    bench.bias_n = -4.0;
    bench.pull_n = (0.0, 0.0);
    bench.key("");
    bench.wait(8);
    bench.pull_n = (60.0, 0.0);
    bench.wait(8);
    let rows = bench.rows();
    assert_eq!(bench.names(), ["x1 1", "x1 2"]);
    assert!((rows[1].2 - 60.0).abs() < 0.1, "{rows:?}");
}

#[test]
fn keys_repeat_skip_and_mount_again() {
    let mut bench = TestBench::new("keys", &[0, 60, 120, 60, 0], true);
    bench.wait(1);
    bench.key("");
    bench.wait(8);
    bench.pull_n = (60.0, 0.0);
    bench.wait(8);
    bench.key("again");
    bench.wait(8);
    bench.key("nonsense");
    bench.key("skip");
    assert_eq!(bench.names(), ["x1 1", "x1 2", "x1 2"]);
    // 120 N is skipped: 60 N on the way back is next.
    bench.wait(8);
    assert_eq!(bench.names().last().unwrap(), "x1 4");
    // A gauge was touched: the series begins again, under another name, and with a tare.
    bench.key("remount");
    bench.pull_n = (0.0, 0.0);
    bench.length_m = 80e-6;
    bench.wait(10);
    assert_eq!(bench.rows().len(), 4);
    bench.key("");
    bench.wait(8);
    assert_eq!(bench.names().last().unwrap(), "x1.2 1");
    // Another program finds both in the table, and goes on with the second.
    bench = bench.restart();
    bench.wait(1);
    bench.key("");
    bench.wait(8);
    for pull in [60.0, 120.0, 60.0, 0.0] {
        bench.pull_n = (pull, 0.0);
        bench.wait(8);
    }
    assert!(bench.campaign.is_done());
    let expected = [
        "x1 1", "x1 2", "x1 2", "x1 4", "x1.2 1", "x1.2 2", "x1.2 3", "x1.2 4", "x1.2 5",
    ];
    assert_eq!(bench.names(), expected);
}

#[test]
fn readings_are_typed_where_there_is_no_link() {
    let mut bench = TestBench::new("typed", &[0, 60], false);
    bench.wait(1);
    bench.key("");
    bench.wait(8);
    for wrong in [
        "1 2 3",
        "1 2 3 4 5 6 7 8 nine",
        "1 2 3 4 5 6 7 8 9 10",
        "NaN 2 3 4 5 6 7 8 9",
    ] {
        bench.key(wrong);
    }
    assert!(bench.rows().is_empty());
    bench.key("1.5 -2 3 4 5 6 7 8 9");
    assert_eq!(bench.rows().len(), 1);
    assert!((bench.rows()[0].3 - 1.5).abs() < 1e-9);
}
