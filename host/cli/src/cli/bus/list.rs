//! Devices of a bus as lines for people.

use gantry_tau_ethercat::scan::{
    Answer, ClockWidth, Device, Dictionary, FIRST_AXIS, Mapping, SECOND_AXIS,
};

/// Returns the lines of all devices.
pub(super) fn lines(devices: &[Device]) -> Vec<String> {
    let noun = if devices.len() == 1 {
        "device"
    } else {
        "devices"
    };
    let mut lines = vec![format!("{} {noun}", devices.len())];
    devices
        .iter()
        .for_each(|device| lines.extend(of_device(device)));
    lines
}

fn of_device(device: &Device) -> Vec<String> {
    let verdict = device.verdict();
    let name = if device.name.is_empty() {
        "without a name"
    } else {
        &device.name
    };
    let alias = match device.alias {
        0 => String::new(),
        alias => format!(", alias {alias}"),
    };
    let protocols: Vec<&str> = device.protocols.names().collect();
    let protocols = if protocols.is_empty() {
        "no mailbox".to_owned()
    } else {
        protocols.join(", ")
    };
    let clock = match device.clock {
        ClockWidth::None => "no distributed clock",
        ClockWidth::Bits32 => "distributed clock of 32 bits",
        ClockWidth::Bits64 => "distributed clock",
    };
    let mut lines = vec![
        String::new(),
        format!("position {}{alias}: {name}", device.position),
        format!(
            "  vendor {:#010x}, product {:#010x}, revision {:#010x}, serial {}",
            device.vendor, device.product, device.revision, device.serial
        ),
        format!("  {protocols}; {clock}"),
    ];
    if let Some(dictionary) = &device.dictionary {
        if dictionary.is_of_drive() {
            lines.extend(of_drive(dictionary));
        }
        let [outputs, inputs] = dictionary.assigned.each_ref().map(|pdos| pdo_names(pdos));
        lines.push(format!("  assigned PDOs: 1C12h {outputs}; 1C13h {inputs}"));
    }
    for code in &device.emergencies {
        lines.push(format!("  emergency message: error code {code:04X}h"));
    }
    lines.push(format!("  {verdict}"));
    if verdict.is_drivable() {
        lines.extend(entry(device));
    }
    lines
}

fn of_drive(dictionary: &Dictionary) -> Vec<String> {
    let modes = match dictionary.modes {
        Answer::Value(modes) if modes & 0x80 != 0 => format!("{modes:#x}, with CSP"),
        Answer::Value(modes) => format!("{modes:#x}, without CSP"),
        other => word(other),
    };
    let [outputs, inputs] = dictionary.synchronisation.map(synchronisation);
    let mut lines = vec![
        format!("  supported modes (6502h): {modes}"),
        format!("  synchronisation: outputs (1C32h:04) {outputs}; inputs (1C33h:04) {inputs}"),
        format!(
            "  objects: {}",
            objects(&FIRST_AXIS, &dictionary.first_axis)
        ),
    ];
    if dictionary
        .second_axis
        .iter()
        .any(|answer| answer.value().is_some())
    {
        let second = objects(&SECOND_AXIS, &dictionary.second_axis);
        lines.push(format!("  second axis: {second}"));
    }
    if let Some([outputs, inputs]) = dictionary.mapping {
        lines.push(format!(
            "  mapping: 1600h {}; 1A00h {}",
            mapping(outputs),
            mapping(inputs)
        ));
    }
    lines
}

/// An answer without its value.
fn word(answer: Answer) -> String {
    match answer {
        Answer::Value(_) => "yes".to_owned(),
        Answer::Aborted(_) => "-".to_owned(),
        Answer::Silent => "no answer".to_owned(),
    }
}

fn objects(indices: &[u16; 12], answers: &[Answer; 12]) -> String {
    let of_one = |(index, answer): (&u16, &Answer)| match answer {
        Answer::Value(_) => format!("{index:04X}h"),
        other => format!("{index:04X}h {}", word(*other)),
    };
    let all: Vec<String> = indices.iter().zip(answers).map(of_one).collect();
    all.join(", ")
}

/// Meaning of 1C32h:04 or 1C33h:04.
fn synchronisation(answer: Answer) -> String {
    let Answer::Value(types) = answer else {
        return word(answer);
    };
    let names: Vec<&str> = [
        (0x01, "free run"),
        (0x02, "SM"),
        (0x04, "SYNC0"),
        (0x08, "SYNC1"),
    ]
    .into_iter()
    .filter(|(bit, _)| types & bit != 0)
    .map(|(_, name)| name)
    .collect();
    if names.is_empty() {
        format!("{types:#06x}")
    } else {
        format!("{types:#06x} ({})", names.join(", "))
    }
}

fn pdo_names(pdos: &[u16]) -> String {
    if pdos.is_empty() {
        return "-".to_owned();
    }
    let names: Vec<String> = pdos.iter().map(|pdo| format!("{pdo:04X}h")).collect();
    names.join(", ")
}

fn mapping(tried: Mapping) -> String {
    match tried {
        Mapping::Written => "can be written".to_owned(),
        Mapping::Fixed(code) => format!("is fixed (abort code {code:08X}h)"),
        Mapping::TooLong => "is too long to be tried".to_owned(),
        Mapping::NotRestored => "is not as it was: power the device off and on".to_owned(),
        Mapping::Silent => "no answer".to_owned(),
    }
}

/// Entry of a drive in the robot file.
fn entry(device: &Device) -> Vec<String> {
    let place = match device.alias {
        0 => format!("position = {}", device.position),
        alias => format!("alias = {alias}"),
    };
    let mut lines = vec![
        "    [[ethercat.drives]]".to_owned(),
        format!("    {place}"),
        format!("    vendor = {:#010x}", device.vendor),
        format!("    product = {:#010x}", device.product),
        "    counts_per_q = ?".to_owned(),
        "    sign = ?".to_owned(),
        "    zero_counts = ?".to_owned(),
    ];
    if device.serial != 0 {
        lines.push(format!("    serial = {}", device.serial));
    }
    let counts_per_turn = device.dictionary.as_ref().and_then(|dictionary| {
        let counts = dictionary.of_first_axis(0x608F).value()?;
        counts.checked_div(dictionary.turns.value()?)
    });
    if let Some(counts) = counts_per_turn {
        lines.push(format!("    counts_per_turn = {counts}"));
    }
    lines
}
