//! Meaning of the samples' fields, for the JSON schemas: units, codes and words.

use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_server::plant::DriveState;
use gantry_tau_server::record::EventKind;
use serde_json::{Map, Value, json};

/// Units by the endings of names, the longer ones first.
const UNITS: [(&str, &str); 6] = [
    ("_um_s", "µm/s"),
    ("_permille", "per mille of the rated torque"),
    ("_nm", "nm"),
    ("_rad", "rad"),
    ("_m", "m"),
    ("_us", "µs"),
];

/// Descriptions by names.
const WORDS: [(&str, &str); 26] = [
    ("tick", "Number of the server's tick, 1 ms each"),
    ("epoch", "Epoch of the session"),
    (
        "sequence",
        "Sequence number of the last command that was accepted",
    ),
    ("phase", "State of the server"),
    (
        "cause",
        "Cause of the last end of a session; of an event of kind 3 the phase",
    ),
    ("kind", "Kind of the event"),
    ("on_time", "Commands on time among the last 100"),
    ("ramp_ticks_left", "Ticks until the ramp ends"),
    (
        "counters",
        "received, missed, late, duplicate, stale, malformed, out of range, limited, clamped, of strangers; at most 2^31 - 1",
    ),
    ("longest_miss_run", "Longest run of missed ticks"),
    ("axis", "The axes, in their order"),
    ("nominal_nm", "Nominal position"),
    ("reference_nm", "Reference written to the drive"),
    ("position_offset_nm", "Offset of the position in force"),
    ("velocity_offset_um_s", "Offset of the velocity in force"),
    ("torque_offset_permille", "Offset of the torque in force"),
    (
        "shadow_nm",
        "Offset of the position that would be in force in Obtain; 0 outside Submit",
    ),
    ("actual_nm", "Actual position"),
    ("actual_velocity_um_s", "Actual velocity"),
    ("actual_torque_permille", "Actual torque"),
    ("flags", "Flags of the axis, as in wire.md"),
    ("step", "Step of the experiment"),
    (
        "load",
        "Force x, y, z in N and moment x, y, z in N m on the platform, world axes",
    ),
    (
        "displacement_m",
        "Displacement of the tool centre point from its nominal place; null if it is not measured",
    ),
    (
        "turn_rad",
        "Turn of the platform from its nominal orientation, rotation vector; null if it is not measured",
    ),
    ("gauges_m", "Readings of the gauges; null if there are none"),
];

/// Adds what is known of a field to its schema.
pub(super) fn describe(sample: &str, name: &str, schema: &mut Map<String, Value>) {
    if let Some((_, words)) = WORDS.iter().find(|(known, _)| *known == name) {
        schema.insert("description".to_owned(), (*words).into());
    }
    let units = UNITS
        .iter()
        .find(|(ending, _)| name.ends_with(ending))
        .map(|(_, unit)| Value::from(*unit));
    let unit = match name {
        "load" => Some(json!(["N", "N", "N", "N m", "N m", "N m"])),
        "tick" | "ramp_ticks_left" => Some("ms".into()),
        _ => units,
    };
    if let Some(unit) = unit {
        schema.insert("unit".to_owned(), unit);
    }
    let codes = match (sample, name) {
        (_, "phase") => Some(codes(|code| Phase::from_code(code).map(Phase::name))),
        ("state", "cause") => Some(codes(|code| Cause::from_code(code).map(Cause::name))),
        (_, "kind") => Some(codes(|code| {
            EventKind::from_code(code).map(EventKind::name)
        })),
        _ => None,
    };
    if let Some(codes) = codes {
        schema.insert("oneOf".to_owned(), codes);
    }
    if (sample, name) == ("drives", "state") {
        let codes = codes_of_drives();
        if let Some(Value::Object(items)) = schema.get_mut("items") {
            items.insert("oneOf".to_owned(), codes);
        }
    }
}

fn codes_of_drives() -> Value {
    codes(|code| DriveState::from_code(code).map(DriveState::name))
}

/// Codes of a byte with their names, as JSON schema has enumerations with titles.
fn codes(name: impl Fn(u8) -> Option<&'static str>) -> Value {
    (0..=u8::MAX)
        .filter_map(|code| name(code).map(|title| json!({ "const": code, "title": title })))
        .collect()
}
