//! Devices of a bus as one line of JSON.

use gantry_tau_ethercat::scan::{
    Answer, ClockWidth, Device, Dictionary, FIRST_AXIS, Mapping, SECOND_AXIS,
};
use serde_json::{Map, Value, json};

/// Format of the answer.
const FORMAT: &str = "gantry-tau bus scan 1";

/// Returns the answer of all devices.
pub(super) fn of(devices: &[Device]) -> Value {
    let devices: Vec<Value> = devices.iter().map(of_device).collect();
    json!({ "format": FORMAT, "devices": devices })
}

fn of_device(device: &Device) -> Value {
    let verdict = device.verdict();
    let protocols: Vec<&str> = device.protocols.names().collect();
    json!({
        "position": device.position,
        "alias": device.alias,
        "name": device.name,
        "vendor": device.vendor,
        "product": device.product,
        "revision": device.revision,
        "serial": device.serial,
        "protocols": protocols,
        "clock_bits": match device.clock {
            ClockWidth::None => 0,
            ClockWidth::Bits32 => 32,
            ClockWidth::Bits64 => 64,
        },
        "refused_pre_op": device.refused_pre_op,
        "emergencies": device.emergencies,
        "dictionary": device.dictionary.as_ref().map(of_dictionary),
        "verdict": verdict.to_string(),
        "is_drivable": verdict.is_drivable(),
    })
}

fn of_dictionary(dictionary: &Dictionary) -> Value {
    let [outputs, inputs] = dictionary.synchronisation.map(of_answer);
    let [assigned_outputs, assigned_inputs] = &dictionary.assigned;
    json!({
        "6502": of_answer(dictionary.modes),
        "1C32:04": outputs,
        "1C33:04": inputs,
        "first_axis": objects(&FIRST_AXIS, &dictionary.first_axis),
        "second_axis": objects(&SECOND_AXIS, &dictionary.second_axis),
        "608F:02": of_answer(dictionary.turns),
        "1C12": assigned_outputs,
        "1C13": assigned_inputs,
        "mapping_is_writable": dictionary.mapping.map(|[outputs, inputs]| {
            json!({ "1600": is_writable(outputs), "1A00": is_writable(inputs) })
        }),
    })
}

fn objects(indices: &[u16; 12], answers: &[Answer; 12]) -> Value {
    let of_one = |(index, answer): (&u16, &Answer)| (format!("{index:04X}"), of_answer(*answer));
    Value::Object(
        indices
            .iter()
            .zip(answers)
            .map(of_one)
            .collect::<Map<_, _>>(),
    )
}

/// A value, or the reason why there is none.
fn of_answer(answer: Answer) -> Value {
    match answer {
        Answer::Value(value) => json!(value),
        Answer::Aborted(code) => json!({ "aborted": code }),
        Answer::Silent => json!("no answer"),
    }
}

/// True, false, or null without an answer.
const fn is_writable(mapping: Mapping) -> Option<bool> {
    match mapping {
        Mapping::Written => Some(true),
        Mapping::Fixed(_) => Some(false),
        Mapping::TooLong | Mapping::NotRestored | Mapping::Silent => None,
    }
}
