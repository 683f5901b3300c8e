//! Samples of a recording, compared with the CSV recording of the same run.

use std::collections::HashMap;
use std::path::Path;

use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_server::plant::DriveState;
use serde_json::Value;

/// Returns the rows of a CSV recording by their ticks; each a map from column to text.
pub fn csv_rows(path: &Path) -> HashMap<i64, HashMap<String, String>> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    lines
        .map(|line| {
            let names = header.iter().map(|name| (*name).to_owned());
            names.zip(line.split(',').map(str::to_owned)).collect()
        })
        .map(|row: HashMap<String, String>| (row["tick"].parse().unwrap(), row))
        .collect()
}

/// Samples of one recording.
#[derive(Default)]
pub struct Samples {
    /// By name, in their order.
    values: HashMap<String, Vec<Value>>,
}

impl Samples {
    /// Adds a sample.
    pub fn add(&mut self, name: &str, value: Value) {
        self.values.entry(name.to_owned()).or_default().push(value);
    }

    /// Returns the samples of a name.
    #[must_use]
    pub fn of(&self, name: &str) -> &[Value] {
        self.values.get(name).map_or(&[], Vec::as_slice)
    }
}

/// Compares every field of `axes`, and what CSV has of `state`, `drives` and `tool`, with the CSV
/// recording. Each row has one of each.
pub fn compare(samples: &Samples, rows: &HashMap<i64, HashMap<String, String>>, axes: usize) {
    assert_eq!(samples.of("axes").len(), rows.len());
    assert_eq!(samples.of("state").len(), rows.len());
    for value in samples.of("axes") {
        let row = &rows[&tick_of(value)];
        assert_eq!(value["axis"].as_array().unwrap().len(), axes);
        for (axis, number) in value["axis"].as_array().unwrap().iter().zip(1..) {
            let fields = [
                ("nominal_nm", "nominal_{}_nm"),
                ("reference_nm", "reference_{}_nm"),
                ("position_offset_nm", "offset_{}_nm"),
                ("velocity_offset_um_s", "velocity_offset_{}_um_s"),
                ("torque_offset_permille", "torque_offset_{}_permille"),
                ("shadow_nm", "shadow_{}_nm"),
                ("actual_nm", "actual_{}_nm"),
                ("actual_velocity_um_s", "actual_velocity_{}_um_s"),
                ("actual_torque_permille", "actual_torque_{}_permille"),
                ("flags", "flags_{}"),
            ];
            assert_eq!(axis.as_object().unwrap().len(), fields.len());
            for (field, column) in fields {
                assert_eq!(
                    axis[field].to_string(),
                    row[&column.replace("{}", &format!("{number}"))],
                    "{column}"
                );
            }
        }
    }
    for value in samples.of("state") {
        let row = &rows[&tick_of(value)];
        assert_eq!(
            Phase::from_code(code(&value["phase"])).unwrap().name(),
            row["state"]
        );
        assert_eq!(
            Cause::from_code(code(&value["cause"])).unwrap().name(),
            row["cause"]
        );
        assert_eq!(value["counters"][1].to_string(), row["missed"]);
        assert_eq!(value["ramp_ticks_left"].to_string(), row["ramp_ticks_left"]);
    }
    // A server tells them in every tick, a client never.
    let tells_drives = rows.values().any(|row| row.contains_key("drive_1"));
    assert_eq!(
        samples.of("drives").len(),
        if tells_drives { rows.len() } else { 0 }
    );
    for value in samples.of("drives") {
        let row = &rows[&tick_of(value)];
        let codes = value["state"].as_array().unwrap();
        assert_eq!(codes.len(), axes);
        for (state, number) in codes.iter().zip(1..) {
            let state = DriveState::from_code(code(state)).unwrap();
            assert_eq!(state.name(), row[&format!("drive_{number}")]);
        }
    }
    assert_eq!(samples.of("tool").len(), rows.len());
    for value in samples.of("tool") {
        let row = &rows[&tick_of(value)];
        let loads = [
            "force_x_n",
            "force_y_n",
            "force_z_n",
            "moment_x_n_m",
            "moment_y_n_m",
            "moment_z_n_m",
        ];
        for (number, column) in loads.into_iter().enumerate() {
            same(&value["load"][number], 1.0, &row[column]);
        }
        for (number, axis) in ["x", "y", "z"].into_iter().enumerate() {
            // A client does not know them.
            if let Some(way) = row.get(&format!("displacement_{axis}_um")) {
                same(&value["displacement_m"][number], 1e6, way);
                same(
                    &value["gauges_m"][number],
                    1e6,
                    &row[&format!("gauge_{axis}_um")],
                );
                same(
                    &value["turn_rad"][number],
                    1e6,
                    &row[&format!("turn_{axis}_urad")],
                );
            } else {
                assert!(value["displacement_m"][number].as_f64().is_none());
            }
        }
    }
}

fn tick_of(sample: &Value) -> i64 {
    sample["tick"].as_i64().unwrap()
}

fn code(value: &Value) -> u8 {
    u8::try_from(value.as_u64().unwrap()).unwrap()
}

fn same(value: &Value, scale: f64, text: &str) {
    let expected: f64 = text.parse().unwrap();
    assert_eq!(
        (value.as_f64().unwrap() * scale).to_bits(),
        expected.to_bits()
    );
}
