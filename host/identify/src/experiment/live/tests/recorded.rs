//! A recording of the server in a campaign, made into windows.

use std::sync::Mutex;
use std::sync::atomic::AtomicU64;

use gantry_tau_record::recording::Recording;
use gantry_tau_sim::springs::TrueSprings;
use gantry_tau_system::output::Name;

use super::*;
use crate::measurements::FileError;

/// Ticks that are recorded after the campaign, at most the calm that a level needs.
const MORE_TICKS: u64 = 7_000;

/// Gauges of a recording: at the tool centre point, along the axes of the world.
const GAUGES: [(&str, [f64; 3]); 3] = [
    ("gauge_x", [1.0, 0.0, 0.0]),
    ("gauge_y", [0.0, 1.0, 0.0]),
    ("gauge_z", [0.0, 0.0, 1.0]),
];

/// A plan with the gauges of a recording.
fn plan_text() -> String {
    let text = first_series(&campaign_a("", &[0, 120, 240, 120, 0]), 2);
    let (head, rest) = text.split_once("[[gauge]]").unwrap();
    let series = &rest[rest.find("[[pose]]").unwrap()..];
    let gauges = GAUGES.map(|(name, axis)| {
        format!("[[gauge]]\nname = {name:?}\non = \"platform\"\npoint_m = [0.0, 0.0, 0.0]\naxis = {axis:?}\n")
    });
    let names = GAUGES.map(|(name, _)| name);
    let lines = series
        .lines()
        .map(|line| match line.starts_with("gauges = ") {
            true => format!("gauges = {names:?}\n"),
            false => line.to_owned() + "\n",
        });
    head.to_owned() + &gauges.concat() + &lines.collect::<String>()
}

/// Records a campaign to `record.csv`; returns the number of rows that the recorder was too slow
/// for.
fn record(folder: &Folder, robot: &RobotFile<L2, 3>, plan: &Plan<3>) -> u64 {
    let to = folder.path("record.csv").to_str().unwrap().parse().unwrap();
    let file = Arc::new(Mutex::new(Some(
        Recording::<3>::create::<TickRecord<3>, _>(&to, robot).unwrap(),
    )));
    let shared = Arc::clone(&file);
    let ticks = Arc::new(AtomicU64::new(0));
    let counted = Arc::clone(&ticks);
    let bench = TestBench::watched(robot, plan, move |row| {
        counted.fetch_add(1, Ordering::Relaxed);
        if let Some(file) = shared.lock().unwrap().as_mut() {
            file.write(row, &[]);
        }
    });
    let options = bench.options(robot, plan, &folder.path("springs.csv"));
    assert_eq!(
        run_until(&options, usize::MAX),
        LiveReport {
            taken: 10,
            missing: 0
        }
    );
    // The last level is calm in the recording a little later than in the campaign, which is over.
    let end = ticks.load(Ordering::Relaxed) + MORE_TICKS;
    while ticks.load(Ordering::Relaxed) < end {
        std::thread::yield_now();
    }
    let dropped = bench.server.controls.dropped_rows.load(Ordering::Relaxed);
    bench.server.quit().unwrap();
    let recorded = file.lock().unwrap().take().unwrap().finish(0);
    assert_eq!((recorded.lost, recorded.failure), (0, None));
    dropped
}

/// Makes the windows of `record.csv`.
fn read(folder: &Folder, robot: &RobotFile<L2, 3>) -> Result<ticks::TickCampaign<3>, FileError> {
    let prediction = Prediction::new(robot).unwrap();
    ticks::read(
        &folder.path("record.csv"),
        &folder.path("plan.toml"),
        robot,
        &prediction,
    )
}

#[test]
fn a_recording_is_divided_by_the_plan() {
    // A campaign in lock-step is over in seconds: a recorder that is not scheduled for long misses
    // rows of it.
    let tried = (0..5).find_map(|_| {
        let folder = Folder::new("recorded");
        let robot = robot();
        let plan = plan_in(&folder, &plan_text());
        (record(&folder, &robot, &plan) == 0).then_some((folder, robot, plan))
    });
    let (folder, robot, plan) = tried.expect("a recorder that keeps up once in five campaigns");
    let made = read(&folder, &robot).unwrap();
    assert_eq!(made.missed, [""; 0]);
    let names: Vec<_> = made
        .campaign
        .windows
        .iter()
        .map(|window| (window.series, window.window.as_str()))
        .collect();
    let expected: Vec<_> = (0..2)
        .flat_map(|series| ["1", "2", "3", "4", "5"].map(|window| (series, window)))
        .collect();
    assert_eq!(
        (names, &made.campaign.series),
        (expected, &["x1", "y1"].map(Name::made).to_vec())
    );
    // Each level is calm for 6 s at least, and a campaign of ten takes a few minutes of ticks.
    let times: Vec<f64> = made
        .campaign
        .windows
        .iter()
        .map(|window| window.time_s.unwrap())
        .collect();
    assert!(
        times
            .windows(2)
            .all(|pair| (5.0..60.0).contains(&(pair[1] - pair[0]))),
        "{times:?}"
    );
    // By the machine's own springs: a recording has the exact load, and gauges that show whole
    // steps of 0.5 um, slack (where the platform has sagged to) and pulled.
    let springs = TrueSprings::from_robot(&robot).unwrap();
    for window in &made.campaign.windows {
        let planned = &plan.series[window.series];
        let level_n = planned.levels_n[window.window.parse::<usize>().unwrap() - 1];
        assert!(
            (window.load.fixed_rows::<3>(0) - planned.direction * level_n).amax() < 1e-9,
            "{}",
            window.load
        );
        let began = unloaded(springs.machine(), &window.q, &plan.poses[planned.pose].1).unwrap();
        let now = springs
            .machine()
            .equilibrium(&window.q, &window.load, &began)
            .unwrap();
        let moved = now.pose.translation_m - began.pose.translation_m;
        for (reading, moved) in window.readings_m.iter().zip(&moved) {
            assert!(
                (reading.unwrap() - moved).abs() < 0.51e-6,
                "{reading:?} {moved:e}"
            );
        }
    }

    // Plans and recordings that are not each other's.
    let text = plan_text();
    let (without, _) = text.split_once("[[series]]").unwrap();
    for (text, expected) in [
        (
            text.replace("120.0, 240.0", "120.0, 250.0")
                .replace("120, 240", "120, 280"),
            "record.csv: series x1, window 3 (280 N) of the plan is not in it: a recording shows the whole plan in its order, each level calm for 6 s",
        ),
        (
            text.replace("\"gauge_", "\"probe_"),
            "gauge: a recording has the gauges gauge_x, gauge_y and gauge_z, and the set-up names none of them",
        ),
        (
            without.to_owned(),
            "series: is missing: a plan has [[series]]",
        ),
    ] {
        std::fs::write(folder.path("plan.toml"), text).unwrap();
        let error = read(&folder, &robot).unwrap_err().to_string();
        assert!(error.ends_with(expected), "{error}");
    }
    std::fs::write(folder.path("plan.toml"), &text).unwrap();
    let path = folder.path("record.csv");
    let bad = std::fs::read_to_string(&path)
        .unwrap()
        .replacen('\n', "\n,", 2);
    std::fs::write(&path, bad).unwrap();
    let error = read(&folder, &robot).unwrap_err().to_string();
    assert!(
        error.contains("record.csv:") && error.contains("values for"),
        "{error}"
    );
}
