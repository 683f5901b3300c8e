//! Schema of gantry-tau's samples, as a text that LabComm's compiler takes.

use std::fmt::Write as _;

use gantry_tau_labcomm::samples::{Axes, Data, ForceSensor, SessionEvent, State, Tool};
use gantry_tau_labcomm::{Kind, Sample, Type, Version};
use gantry_tau_server::publication::{DriveStates, MachineIdentity};

use super::from_json::Bytes;

/// Returns the samples of a machine of `N` axes, made from the types that are sent.
#[must_use]
pub fn schema<const N: usize>() -> String {
    [
        sample::<Data>("gauges, counts of the gauge's resolution (0.5 um)"),
        sample::<ForceSensor>("N, then N m, sensor axes, raw"),
        sample::<State>("state of the server after a tick; codes and counters as in wire.md"),
        sample::<Axes<N>>("every axis after a tick; flags as in wire.md"),
        sample::<Tool>("the simulation's truth"),
        sample::<SessionEvent>("kind: 0 granted, 1 refused, 2 ended, 3 phase, 4 machine failed, 5 rows lost"),
        sample::<DriveStates<N>>(
            "state of the drives of every axis: 0 not ready, 1 ready, 2 operating, 3 quick stop, 4 fault",
        ),
        sample::<MachineIdentity>(
            "the machine, once: checksum of its kinematic parameters as in wire.md, name and text of its robot file, and 1 in lock-step",
        ),
    ]
    .concat()
}

fn sample<T: Sample>(comment: &str) -> String {
    let mut bytes = Bytes::new(Version::V2014);
    T::write_type(&mut bytes);
    let mut out = format!("// {comment}\nsample ");
    if let Ok(ty) = Type::whole(Version::V2014, &bytes.bytes) {
        declaration(&mut out, &ty, T::NAME, 0);
    }
    out
}

/// Writes `TYPE NAME DIMS;` and a line end.
fn declaration(out: &mut String, of: &Type<'_>, name: &str, depth: usize) {
    let (mut of, mut sizes) = (*of, String::new());
    while let Kind::Array(array) = of.kind() {
        let dims: Vec<String> = array
            .indices()
            .map(|size| {
                if size == 0 {
                    "_".to_owned()
                } else {
                    size.to_string()
                }
            })
            .collect();
        let _ = write!(sizes, "[{}]", dims.join(", "));
        of = array.element();
    }
    match of.kind() {
        Kind::Primitive(primitive) => out.push_str(primitive.name()),
        Kind::Structure(structure) => {
            out.push_str("struct {\n");
            let inner = depth.saturating_add(1);
            for (field, of) in structure.fields() {
                out.push_str(&"  ".repeat(inner));
                declaration(out, &of, &String::from_utf8_lossy(field), inner);
            }
            out.push_str(&"  ".repeat(depth));
            out.push('}');
        }
        Kind::Array(_) => {}
    }
    let _ = writeln!(out, " {name}{sizes};");
}
