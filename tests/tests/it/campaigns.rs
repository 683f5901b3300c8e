//! Files of campaigns: read to the last column, and refused by line and column.

use std::fs;
use std::path::{Path, PathBuf};

use gantry_tau_identify::measurements::MAX_ROWS;
use gantry_tau_identify::measurements::springs::{Campaign, read};
use gantry_tau_machine::elastic::gauge::Gauge;
use gantry_tau_system::output::Name;

const SETUP: &str = r#"format = "gantry-tau springs 1"
model = "l2"
measurements = "springs.csv"
[noise]
gauge_um = 1.0
force_n = 1.0
moment_nm = 0.05
[setup]
gauge_point_mm = 0.5
[[pose]]
name = "home"
T = [0.0, 0.5, 0.65]
[[gauge]]
name = "pz1"
on = "platform"
point_m = [0.12, -0.06, 0.10]
axis = [0.0, 0.0, 1.0]
[[gauge]]
name = "cart2"
on = "axis"
axis_number = 2
"#;

const TABLE: &str = "\
series,mounting,pose,window,stroke,q_1,q_2,q_3,force_x_n,force_y_n,force_z_n,moment_x_nm,moment_y_nm,moment_z_nm,push_2_n,pz1_um,cart2_um,pz1_sd_um
s1,m1,home,0,0,0.5,-0.5,0.5,0,0,0,0,0,0,0,3.5,-1,
s1,m1,home,1,1,0.5,-0.5,0.5,60.5,0,0,0,-4.8,0,1000,12.25,,0.5
s2,m2,home,0,0,0.5,-0.5,0.5,0,0,0,0,0,0,0,0,0,
";

fn campaign(folder: &Path, setup: &str, table: &str) -> Result<Campaign<3>, String> {
    fs::create_dir_all(folder).unwrap();
    let path = folder.join("springs.toml");
    fs::write(&path, setup).unwrap();
    fs::write(folder.join("springs.csv"), table).unwrap();
    read::<3>(&path, "l2", &[1.0, 2.0, 1.0]).map_err(|error| error.to_string())
}

fn folder(test: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("campaigns")
        .join(test)
}

fn micrometres(readings: &[Option<f64>]) -> Vec<Option<f64>> {
    readings
        .iter()
        .map(|reading| reading.map(|metres| (metres * 1e9).round() / 1e3))
        .collect()
}

#[test]
fn a_campaign_arrives() {
    let campaign = campaign(&folder("good"), SETUP, TABLE).unwrap();
    assert_eq!(
        campaign.series,
        ["s1", "s2"].map(|name| name.parse::<Name>().unwrap())
    );
    assert_eq!(
        campaign.mountings,
        ["m1", "m2"].map(|name| name.parse::<Name>().unwrap())
    );
    assert_eq!(
        campaign.gauges[1].gauge,
        Gauge::Axis {
            axis: 1,
            metres_per_q: 2.0
        }
    );
    assert_eq!(
        (campaign.setup.gauge_point_mm, campaign.setup.sensor_gain),
        (Some(0.5), None)
    );
    let [start, rising, other] = &campaign.windows[..] else {
        panic!("{:?}", campaign.windows)
    };
    assert_eq!(
        (start.stroke, rising.stroke, other.series, other.line),
        (0, 1, 1, 4)
    );
    assert_eq!(rising.load.as_slice(), [60.5, 0.0, 0.0, 0.0, -4.8, 0.0]);
    assert_eq!(rising.pushes_n.as_slice(), [0.0, 1000.0, 0.0]);
    assert_eq!(micrometres(&start.readings_m), [Some(3.5), Some(-1.0)]);
    assert_eq!(
        micrometres(&rising.readings_m),
        [Some(12.25), None],
        "an empty field is no reading"
    );
    assert_eq!(
        (micrometres(&start.sds_m), micrometres(&rising.sds_m)),
        (vec![None, None], vec![Some(0.5), None])
    );
}

/// Row of a series of its own.
fn row(series: usize) -> String {
    format!("s{series},m{series},home,0,0,0.5,-0.5,0.5,0,0,0,0,0,0,0,3.5,-1,\n")
}

#[test]
fn as_many_series_as_rows_are_read_and_one_more_is_refused() {
    let (header, _) = TABLE.split_once('\n').unwrap();
    let mut table = format!("{header}\n");
    for series in 0..MAX_ROWS {
        table += &row(series);
    }
    let read = campaign(&folder("long"), SETUP, &table).unwrap();
    assert_eq!(
        [read.series.len(), read.mountings.len(), read.windows.len()],
        [MAX_ROWS; 3]
    );
    table += &row(MAX_ROWS);
    let error = campaign(&folder("long"), SETUP, &table).unwrap_err();
    assert!(
        error.contains(&format!(
            "springs.csv:{}: has more than {MAX_ROWS} rows",
            MAX_ROWS + 2
        )),
        "{error}"
    );
}

#[test]
fn wrong_campaigns_are_refused_by_line_and_column() {
    let folder = folder("wrong");
    let tables = [
        (
            "stroke,",
            "",
            "springs.csv:1: stroke: this column is missing",
        ),
        (
            "cart2_um,",
            "cart2_mm,",
            "springs.csv:1: cart2_mm: this column is unknown",
        ),
        (
            "push_2_n",
            "push_4_n",
            "springs.csv:1: push_4_n: this column is unknown",
        ),
        (
            "home,1,1",
            "home,1,2",
            "springs.csv:3: stroke: \"2\" is not 1 (rising), -1 (falling) or 0",
        ),
        (
            "m1,home,1",
            "m1,away,1",
            "springs.csv:3: pose: \"away\" is not in the set-up",
        ),
        (
            "s1,m1,home,1",
            "s1,m2,home,1",
            "springs.csv:3: series: a series has one mounting and one pose",
        ),
        (
            "12.25",
            "122500",
            "springs.csv:3: pz1_um: 122500 is not from",
        ),
        (
            "60.5",
            "sixty",
            "springs.csv:3: force_x_n: \"sixty\" is not a number",
        ),
        (
            ",0.5\n",
            ",0\n",
            "springs.csv:3: pz1_sd_um: a standard deviation is above 0",
        ),
        (
            "s2,m2",
            ",m2",
            "springs.csv:4: series: is empty; give it a name",
        ),
        (
            "s2,m2",
            "s2,=m2",
            "springs.csv:4: mounting: begins with '=', which spreadsheets take for a formula",
        ),
        (
            "home,1,1",
            "home,@1,1",
            "springs.csv:3: window: begins with '@'",
        ),
    ];
    for (from, to, expected) in tables {
        let error = campaign(&folder, SETUP, &TABLE.replacen(from, to, 1)).unwrap_err();
        assert!(error.contains(expected), "{error:?}, expected {expected:?}");
    }
    let setups = [
        (
            "[0.0, 0.0, 1.0]",
            "[0.0, 0.0, 2.0]",
            "springs.toml: gauge.pz1.axis: has length 2, not 1",
        ),
        (
            "axis_number = 2",
            "axis_number = 4",
            "springs.toml: gauge.cart2.axis_number: is 4; the machine has axes 1 to 3",
        ),
        (
            "on = \"axis\"",
            "on = \"rail\"",
            "springs.toml: gauge.cart2.on: is \"rail\"",
        ),
        (
            "point_m = [0.12",
            "point_m = [120",
            "springs.toml: gauge.pz1.point_m: is more than 10 m away",
        ),
        (
            "\"cart2\"",
            "\"pz1\"",
            "springs.toml: gauge.pz1.name: duplicate name",
        ),
        (
            "\"cart2\"",
            "\"cart\\u001b2\"",
            "springs.toml:19: name \"cart\\u{1b}2\": has the character '\\u{1b}'",
        ),
        (
            "force_n = 1.0",
            "force_n = -1.0",
            "springs.toml: noise.force_n: -1 is not from",
        ),
        (
            "gauge_point_mm",
            "gauge_point_um",
            "springs.toml:9: unknown field `gauge_point_um`",
        ),
        (
            "springs 1",
            "springs 9",
            "springs.toml: format: is \"gantry-tau springs 9\"",
        ),
    ];
    for (from, to, expected) in setups {
        let error = campaign(&folder, &SETUP.replacen(from, to, 1), TABLE).unwrap_err();
        assert!(error.contains(expected), "{error:?}, expected {expected:?}");
    }
}
