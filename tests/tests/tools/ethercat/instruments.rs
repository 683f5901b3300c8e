//! SOEM, and the programs of this repository, on encoder terminals and a force sensor.

use std::path::Path;

use gantry_tau_ethercat::GaugeConfig;
use gantry_tau_ethercat::emulation::{
    Chain, EmulatedWire, EncoderModel, EncoderTerminal, ForceTerminal, ForceUnits, Instrument,
    Kinematic, Node, Plain, SubDevice,
};
use gantry_tau_ethercat::gauges::Gauges;
use gantry_tau_ethercat::{DevicePlace, RawSocket, Wire as _};
use serde_json::{Value, json};

use super::{ENDS, FarEnd, connect, judged};

/// Counts of the terminals before and after they move.
const COUNTS: [i64; 2] = [70_000, -2];
const MOVED: i64 = 1_234;
const FORCE: [i32; 6] = [1, -2, 3, -4, 5, i32::MIN];
/// Longest wait for an answer over the veth pair, µs: nothing here depends on how busy the computer
/// is.
const ANSWER_US: u32 = 200_000;

fn chain() -> Vec<Node> {
    let encoder = |model, counts| {
        let mut terminal = EncoderTerminal::new(model);
        terminal.set_counts(counts);
        Instrument::Encoder(terminal)
    };
    let units = ForceUnits {
        force: 2,
        torque: 4,
        counts_per_force: 1_000_000,
        counts_per_torque: 1_000,
    };
    let mut sensor = ForceTerminal::new(ForceTerminal::IDENTITY, units);
    sensor.set_counts(FORCE);
    [
        Instrument::Plain(Plain::coupler()),
        encoder(EncoderModel::El5101, COUNTS[0]),
        encoder(EncoderModel::El5101Old, COUNTS[1]),
        Instrument::Force(sensor),
    ]
    .map(|device| Node::Instrument(SubDevice::of(device)))
    .into()
}

/// Moves both terminals.
fn move_gauges(wire: &EmulatedWire<Kinematic>) {
    let mut bench = wire.bench();
    for (position, counts) in (1..).zip(COUNTS) {
        let subdevice = bench.chain.instrument_mut(position).unwrap();
        if let Instrument::Encoder(terminal) = subdevice.device_mut() {
            terminal.set_counts(counts + MOVED);
        }
    }
}

pub(super) fn soem_agrees(python: &Path) {
    connect();
    let wire = EmulatedWire::new(Chain::of(chain(), Kinematic));
    let far = FarEnd::start(wire.clone(), Some(10));
    let saw = judged(python, "instruments.py");
    assert_eq!(
        (&saw["found"], &saw["safe_op"], &saw["state"]),
        (&json!(4), &json!(4), &json!(8))
    );
    assert_eq!(saw["outputs"], json!([6, 3, 8]));
    assert_eq!(saw["size"], 6 + 3 + 8 + 10 + 5 + 32);
    assert_eq!(saw["counter"], 9, "{saw}");
    assert_eq!(saw["units"], json!([1_000_000, 1_000]));
    let bytes = |cycle: usize, device: usize| -> Vec<u8> {
        let Value::String(hex) = &saw["shown"][cycle][device] else {
            panic!("{saw}");
        };
        let digits = hex.as_bytes().chunks(2);
        let digits = digits.map(|pair| std::str::from_utf8(pair).unwrap());
        digits
            .map(|pair| u8::from_str_radix(pair, 16).unwrap())
            .collect()
    };
    for cycle in 0..2 {
        // Status without its toggle bit, counter, latch.
        let wide = bytes(cycle, 0);
        assert_eq!((wide[0], wide[1] & 0x7F), (0, 0));
        assert_eq!(wide[2..], [0x70, 0x11, 0x01, 0, 0, 0, 0, 0]);
        assert_eq!(bytes(cycle, 1), [0, 0xFE, 0xFF, 0, 0]);
        let sensor = bytes(cycle, 2);
        let words = sensor
            .chunks(4)
            .map(|word| i32::from_le_bytes(word.try_into().unwrap()));
        let words: Vec<i32> = words.collect();
        assert_eq!((&words[..6], words[6], words.len()), (&FORCE[..], 0, 8));
    }
    assert_eq!(
        bytes(0, 0)[1] ^ bytes(1, 0)[1],
        0x80,
        "a new value in each cycle"
    );
    let samples = |cycle| u32::from_le_bytes(bytes(cycle, 2)[28..].try_into().unwrap());
    assert_eq!(samples(1), samples(0) + 1);
    our_gauges_agree(&wire);
    drop(far);
}

/// The gauges of this repository over the same cable.
fn our_gauges_agree(wire: &EmulatedWire<Kinematic>) {
    let configs = [1, 2].map(|position| GaugeConfig {
        place: DevicePlace::Position(position),
        vendor: GaugeConfig::BECKHOFF,
        product: 0x13ED_3052,
    });
    let socket = RawSocket::open(ENDS[0]).unwrap();
    let mut gauges = Gauges::bring_up(socket, &configs, 1_000, ANSWER_US).unwrap();
    gauges.cycle();
    assert_eq!(gauges.counts().collect::<Vec<_>>(), [Ok(0), Ok(0)]);
    move_gauges(wire);
    gauges.cycle();
    assert_eq!(gauges.counts().collect::<Vec<_>>(), [Ok(MOVED), Ok(MOVED)]);
    assert!(gauges.wire_mut().now_us() > 0);
}
