//! Tables of ticks of a synthetic series.

use std::path::PathBuf;

use gantry_tau_machine::model::L2;
use gantry_tau_machine::sensor::Mounting;
use gantry_tau_server::links::gauges::MAX_GAUGES;
use nalgebra::{UnitQuaternion, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::table::{SeriesPart, TickTable};
use super::*;
use crate::experiment::fixture::{Folder, campaign_a, first_series, plan_in};
use crate::experiment::noise::normal;
use crate::experiment::windows::InstrumentSample;
use crate::measurements::plan::Plan;

/// Force of the one level, N; zero error of the sensor, N; noise of a sample, N and m.
const LEVEL_N: f64 = 120.0;
const BIAS_N: f64 = 3.0;
const FORCE_N: f64 = 0.2;
const LENGTH_M: f64 = 0.3e-6;

/// A series at home, slack and pulled along x, whose gauges show 7 um at 120 N.
struct TestBench {
    folder: Folder,
    plan: Plan<3>,
    robot: RobotFile<L2, 3>,
    prediction: Prediction<3>,
    random: ChaCha8Rng,
    tick: u64,
}

impl TestBench {
    fn new(name: &str) -> Self {
        Self::with_levels(name, &[0, 120, 0])
    }

    fn with_levels(name: &str, levels: &[u32]) -> Self {
        let folder = Folder::new(&format!("ticks-{name}"));
        let plan = plan_in(&folder, &first_series(&campaign_a("", levels), 1));
        let robot = RobotFile::builtin_l2().unwrap();
        let prediction = Prediction::new(&robot).unwrap();
        Self {
            folder,
            plan,
            robot,
            prediction,
            random: ChaCha8Rng::seed_from_u64(1),
            tick: 1_000,
        }
    }

    fn path(&self) -> PathBuf {
        self.folder.path("raw.csv")
    }

    /// Writes ticks of parts: milliseconds of each, and the share of the pull.
    fn write(&mut self, parts: &[(SeriesPart, u32, f64)], is_continued: bool) {
        let mut table = TickTable::open(&self.path(), &self.plan, is_continued).unwrap();
        let q = self.robot.model.axes_for(&self.plan.poses[0].1).unwrap();
        let mounting = Mounting::from(&self.robot.sensor);
        for (part, milliseconds, share) in parts {
            for _ in 0..*milliseconds {
                let [along, across] = [FORCE_N; 2].map(|sd| normal(&mut self.random, sd));
                let load = Vector6::new(share * LEVEL_N + along, across, 0.0, 0.0, 0.0, 0.0);
                let mut wrench: [f64; 6] = mounting.seen(&load, &UnitQuaternion::identity()).into();
                wrench[0] += BIAS_N;
                let mut lengths_m = [0.0; MAX_GAUGES];
                lengths_m[..9].fill_with(|| share * 7e-6 + normal(&mut self.random, LENGTH_M));
                let sample = InstrumentSample {
                    tick: self.tick,
                    q,
                    wrench,
                    lengths_m,
                    gauges: 9,
                };
                table
                    .write(&self.plan, (0, *part), self.tick as f64 * 1e-3, &sample)
                    .unwrap();
                self.tick += 1;
            }
        }
        table.flush().unwrap();
    }

    fn read(&self) -> Result<TickCampaign<3>, String> {
        let setup = self.folder.path("plan.toml");
        read(&self.path(), &setup, &self.robot, &self.prediction).map_err(|error| error.to_string())
    }

    /// Reads what a change of the text gives; the folder is left out of the error.
    fn refused(&self, change: impl Fn(&str) -> String) -> String {
        let text = std::fs::read_to_string(self.path()).unwrap();
        std::fs::write(self.path(), change(&text)).unwrap();
        let refused = self.read().unwrap_err();
        std::fs::write(self.path(), text).unwrap();
        refused.replace(&format!("{}/", self.folder.0.path().display()), "")
    }
}

const CALM: [(SeriesPart, u32, f64); 4] = [
    (SeriesPart::Level(0), 6_000, 0.0),
    (SeriesPart::Way, 1_200, 0.5),
    (SeriesPart::Level(1), 6_500, 1.0),
    (SeriesPart::Level(2), 7_000, 0.0),
];

#[test]
fn levels_become_windows() {
    let mut bench = TestBench::new("levels");
    bench.write(&CALM, false);
    let made = bench.read().unwrap();
    assert_eq!(made.missed, [""; 0]);
    let text = std::fs::read(bench.path()).unwrap();
    assert_eq!(made.campaign.crc, crc32fast::hash(&text));
    // Mistaken columns are looked for as the sensor shows them.
    let mounting = Mounting::from(&bench.robot.sensor);
    let load = Vector6::new(10.0, -20.0, 30.0, 1.0, 2.0, -3.0);
    let shown =
        [load, Vector6::zeros()].map(|load| mounting.seen(&load, &UnitQuaternion::identity()));
    let WrenchColumns { names, maps } = &made.campaign.wrench;
    assert_eq!((*names, maps.len()), (SENSOR, bench.plan.poses.len()));
    assert!((maps[0].load_of_columns * (shown[0] - shown[1]) - load).amax() < 1e-9);
    assert!((maps[0].columns_of_load * load - (shown[0] - shown[1])).amax() < 1e-9);
    let found: Vec<_> = made
        .campaign
        .windows
        .iter()
        .map(|window| (window.window.as_str(), window.stroke))
        .collect();
    assert_eq!(found, [("1", 0), ("2", 1), ("3", -1)]);
    let lines: Vec<u64> = made
        .campaign
        .windows
        .iter()
        .map(|window| window.line)
        .collect();
    assert_eq!(lines, [2, 7_202, 13_702]);
    for (window, share) in made.campaign.windows.iter().zip([0.0, 1.0, 0.0]) {
        // Five deviations of the difference of two means of 2 000 samples; the prediction turns 120
        // N by 1 mrad, which is across.
        for (value, expected, sd) in [
            (window.load[0], share * LEVEL_N, FORCE_N),
            (window.readings_m[0].unwrap(), share * 7e-6, LENGTH_M),
        ] {
            assert!(
                (value - expected).abs() < 5.0 * sd / 1_000_f64.sqrt(),
                "{value:e}, not {expected:e}"
            );
        }
        assert_eq!(window.sds_m[0], Some(1e-6), "the stated noise at least");
    }
}

/// Reads of any size: a row ends where the next one begins, wherever the blocks do.
#[test]
fn a_row_that_does_not_end_is_refused() {
    let folder = Folder::new("endless");
    let path = folder.path("raw.csv");
    std::fs::write(&path, vec![b'x'; MAX_ROW_LEN + 1_000]).unwrap();
    for block in [700, 1 << 12, MAX_ROW_LEN] {
        let watch = ReadGuard::default();
        let mut watched = GuardedFile {
            file: BufReader::new(File::open(&path).unwrap()),
            watch: &watch,
        };
        let mut buffer = vec![0; block];
        let mut count = 0;
        let said = loop {
            match watched.read(&mut buffer) {
                Ok(read) => count += read,
                Err(error) => break error.to_string(),
            }
            assert!(count <= MAX_ROW_LEN);
        };
        assert!(
            count + block > MAX_ROW_LEN && said.starts_with("a row is longer than 1 MiB"),
            "{block}: {count}, {said}"
        );
    }
}

/// A session that was lost: another zero error, which the sensor is tared of, and another program
/// that goes on with the table.
#[test]
fn a_table_is_continued_with_a_tare() {
    let mut bench = TestBench::new("continued");
    bench.write(&CALM[..2], false);
    bench.tick = 5;
    bench.write(
        &[
            (SeriesPart::Tare, 6_000, 0.25),
            (SeriesPart::Way, 300, 1.0),
            (SeriesPart::Level(1), 6_500, 1.25),
        ],
        true,
    );
    let campaign = bench.read().unwrap().campaign;
    let found: Vec<_> = campaign
        .windows
        .iter()
        .map(|window| window.window.as_str())
        .collect();
    assert_eq!(found, ["1", "2"]);
    assert!(
        (campaign.windows[1].load[0] - LEVEL_N).abs() < 0.05,
        "{}",
        campaign.windows[1].load
    );
    // One whose last row is not whole, and one of another plan, are not.
    let text = std::fs::read_to_string(bench.path()).unwrap();
    for (bad, expected) in [
        (
            text.trim_end().to_owned(),
            "its last row is not whole; remove that row",
        ),
        (
            text.replacen("axis3_um", "axis4_um", 1),
            "its columns are not those of this plan: series,mounting,",
        ),
    ] {
        std::fs::write(bench.path(), bad).unwrap();
        let refused = TickTable::open(&bench.path(), &bench.plan, true)
            .unwrap_err()
            .to_string();
        assert!(refused.contains(expected), "{refused}");
    }
}

/// A program that was killed before its first tick leaves an empty table.
#[test]
fn an_empty_table_is_begun() {
    let mut bench = TestBench::new("empty");
    std::fs::write(bench.path(), "").unwrap();
    bench.write(&CALM, true);
    assert_eq!(bench.read().unwrap().campaign.windows.len(), 3);
}

#[test]
fn of_many_levels_that_do_not_settle_five_are_named() {
    for (short, others) in [
        (5, None),
        (7, Some("2 more levels do not settle: left out")),
    ] {
        let mut bench = TestBench::with_levels(&format!("short-{short}"), &vec![0; short + 1]);
        let levels = (1..=short).flat_map(|level| {
            [
                (SeriesPart::Way, 10, 0.5),
                (SeriesPart::Level(level), 500, 1.0),
            ]
        });
        bench.write(
            &[CALM[0]].into_iter().chain(levels).collect::<Vec<_>>(),
            false,
        );
        let missed = bench.read().unwrap().missed;
        assert_eq!(missed.get(5).map(String::as_str), others);
        assert!(
            missed.len() <= 6 && missed[4].starts_with("series x1, window 6 (line "),
            "{missed:?}"
        );
    }
}

#[test]
fn a_level_that_does_not_settle_is_named() {
    let mut bench = TestBench::new("restless");
    let first = [
        CALM[0],
        (SeriesPart::Way, 10, 0.5),
        (SeriesPart::Level(1), 4_000, 1.0),
        (SeriesPart::Way, 10, 0.5),
        CALM[3],
    ];
    bench.write(&first, false);
    let made = bench.read().unwrap();
    assert_eq!(
        made.missed,
        ["series x1, window 2 (line 6012) does not settle: left out"]
    );
    assert_eq!(made.campaign.windows.len(), 2);
    // Gauges that go away begin the level again.
    let text = std::fs::read_to_string(bench.path()).unwrap();
    let away = text.lines().enumerate().map(|(index, line)| match index {
        4_000 => line.rsplit_once(',').unwrap().0.to_owned() + ",\n",
        _ => line.to_owned() + "\n",
    });
    std::fs::write(bench.path(), away.collect::<String>()).unwrap();
    let refused = bench.read().unwrap_err();
    assert!(refused.ends_with("raw.csv:6012: stroke: the series does not begin with its slack level, stroke 0, where the sensor is tared, or that does not settle; remove its rows"), "{refused}");
}

/// A text in which one row is changed.
fn with_row(text: &str, line: usize, change: impl Fn(&str) -> String) -> String {
    let rows = text.lines().enumerate();
    rows.map(|(index, row)| {
        if index + 1 == line {
            change(row) + "\n"
        } else {
            row.to_owned() + "\n"
        }
    })
    .collect()
}

/// A text in which one field is changed.
fn with_field(text: &str, line: usize, place: usize, value: &str) -> String {
    with_row(text, line, |row| {
        let mut fields: Vec<&str> = row.split(',').collect();
        // The mounting has a comma, and is quoted.
        fields[place + 1] = value;
        fields.join(",")
    })
}

#[test]
fn what_is_not_a_table_of_ticks_is_refused() {
    let mut bench = TestBench::new("hostile");
    bench.write(&[(SeriesPart::Level(0), 20, 0.0)], false);
    for (line, place, value, expected) in [
        (
            4,
            7,
            "NaN",
            "raw.csv:4: q_1: NaN is not from -1e3 to 1e3; the unit is in the column's name",
        ),
        (
            5,
            10,
            "north",
            "raw.csv:5: sensor_force_x_n: \"north\" is not a number",
        ),
        (
            6,
            16,
            "inf",
            "raw.csv:6: pz1_um: inf is not from -1e5 to 1e5; the unit is in the column's name",
        ),
        (
            6,
            6,
            "-3",
            "raw.csv:6: tick: \"-3\" is not a whole number from 0",
        ),
        (6, 5, "", "raw.csv:6: time_s: \"\" is not a number"),
        (
            6,
            2,
            "moon",
            "raw.csv:6: series: a series has one mounting and one pose",
        ),
        (
            2,
            2,
            "moon",
            "raw.csv:2: pose: \"moon\" is not in the set-up",
        ),
        (
            2,
            3,
            "@",
            "raw.csv:2: window: begins with '@', which spreadsheets take for a formula; begin with a letter",
        ),
        (
            7,
            4,
            "2",
            "raw.csv:7: stroke: \"2\" is not 1 (rising), -1 (falling) or 0",
        ),
    ] {
        let said = bench.refused(|text| with_field(text, line, place, value));
        assert_eq!(said, expected);
    }
    for (line, from, to, expected) in [
        (2, "x1", "", "raw.csv:2: series: is empty; give it a name"),
        (
            2,
            "hook",
            "\u{7}",
            "raw.csv:2: mounting: has the character '\\u{7}'; expected printable ones",
        ),
        (1, "q_2", "q_9", "raw.csv:1: q_9: this column is unknown"),
        (1, ",q_2", "", "raw.csv:1: q_2: this column is missing"),
        (1, "pz2_um", "pz1_um", "raw.csv:1: pz1_um: duplicate column"),
    ] {
        let said = bench.refused(|text| with_row(text, line, |row| row.replacen(from, to, 1)));
        assert_eq!(said, expected);
    }
    assert_eq!(
        bench.refused(|text| text.lines().take(1).collect()),
        "raw.csv: has no rows"
    );
    assert_eq!(
        bench.refused(|_| String::new()),
        "raw.csv:1: series: this column is missing"
    );
    assert_eq!(
        bench.refused(str::to_owned),
        "raw.csv: no level settles, and stays calm for a window of 2 s"
    );
    let short =
        bench.refused(|text| with_row(text, 9, |row| row.rsplit_once(',').unwrap().0.to_owned()));
    assert!(
        short.starts_with("raw.csv:9: ") && short.contains("the row has 24 values for 25 columns"),
        "{short}"
    );
    let long = bench.refused(|text| with_row(text, 9, |row| row.to_owned() + ",1"));
    assert!(
        long.starts_with("raw.csv:9: axis3_um: the row has 26 values for 25 columns"),
        "{long}"
    );
    let quoted = bench.refused(|text| text.to_owned() + "\"" + &"endless\n".repeat(200_000));
    assert!(
        quoted.contains("a row is longer than 1 MiB") && quoted.lines().count() == 1,
        "{quoted}"
    );
}

#[test]
fn moments_in_another_unit_are_found_by_what_no_machine_bears() {
    let mut bench = TestBench::new("moments");
    bench.write(&CALM, false);
    let said = bench.refused(|text| {
        let mut rows = text.lines().map(str::to_owned);
        let header = rows.next().unwrap() + "\n";
        let rows = rows.map(|row| {
            let mut fields: Vec<String> = row.split(',').map(str::to_owned).collect();
            // The mounting has a comma, and is quoted.
            for field in &mut fields[14..17] {
                *field = (field.parse::<f64>().unwrap() * 1e4).to_string();
            }
            fields.join(",") + "\n"
        });
        header + &rows.collect::<String>()
    });
    assert!(
        said.starts_with("raw.csv:7202: window: the sensor shows 121 N and "),
        "{said}"
    );
    assert!(said.ends_with("; look at the sensor's units"), "{said}");
}

/// A killed campaign is continued: what it has written are whole rows.
#[test]
fn a_tick_is_in_the_file_once_it_is_written() {
    let mut bench = TestBench::new("killed");
    bench.write(&[(SeriesPart::Level(0), 3, 0.0)], false);
    let mut table = TickTable::open(&bench.path(), &bench.plan, true).unwrap();
    let sample = InstrumentSample {
        tick: 2_000,
        q: [0.0; 3],
        wrench: [0.0; 6],
        lengths_m: [0.0; MAX_GAUGES],
        gauges: 9,
    };
    table
        .write(&bench.plan, (0, SeriesPart::Level(0)), 2.0, &sample)
        .unwrap();
    let text = std::fs::read_to_string(bench.path()).unwrap();
    assert!(
        text.ends_with('\n') && text.lines().count() == 1 + 3 + 1,
        "{text}"
    );
}

#[test]
fn typed_readings_are_not_in_the_table() {
    let mut bench = TestBench::new("typed");
    bench.write(&CALM, false);
    let said = bench.refused(|text| {
        let rows = text.lines().enumerate().map(|(index, row)| match index {
            0 => row.to_owned() + "\n",
            _ => row.rsplitn(10, ',').last().unwrap().to_owned() + ",,,,,,,,,\n",
        });
        rows.collect()
    });
    let expected =
        "raw.csv: no gauge has a reading: with --ask-gauges they are in the table of windows only";
    assert_eq!(said, expected);
}
