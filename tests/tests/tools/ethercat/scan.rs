//! SOEM and `bus scan` on a chain with one device of every kind.

use std::path::Path;

use gantry_tau_ethercat::RawSocket;
use gantry_tau_ethercat::emulation::{Chain, EmulatedWire, Kinematic, one_of_every_kind};
use gantry_tau_ethercat::scan::{Options, scan};
use serde_json::{Value, json};

use super::{ENDS, FarEnd, connect, judged};

pub(super) fn soem_agrees(python: &Path) {
    connect();
    let wire = EmulatedWire::new(Chain::of(one_of_every_kind(), Kinematic));
    let far = FarEnd::start(wire, Some(10));
    let devices = scan(RawSocket::open(ENDS[0]).unwrap(), Options::default()).unwrap();
    let saw = judged(python, "list.py");
    drop(far);
    let listed: Vec<Value> = devices
        .iter()
        .map(|device| json!([device.name, device.vendor, device.product, device.revision]))
        .collect();
    assert_eq!(saw["found"], 9);
    assert_eq!(saw["state"], 2, "PRE-OP: {saw}");
    assert_eq!(saw["devices"], Value::Array(listed));
}
