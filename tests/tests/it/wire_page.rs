//! `wire.md` against the encoder and decoder.

use gantry_tau_core::control::keys::{Key, Keyring, Role, SessionOf};
use gantry_tau_core::control::message::{
    Capabilities, Challenge, ClientMessage, Hello, KeyedHello, ServerMessage, State,
};
use gantry_tau_core::control::wire::{
    Frame, Kind, Sealed, Suite, decode_client, enclose, encode_client, encode_server,
};
use gantry_tau_core::units::{Epoch, ForceMn, MomentUnm, Tick, WrenchSample};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::links::{self, gauges};
use gantry_tau_server::record::TickRecord;

use crate::fuzz_seeds::streams::command;

/// The examples of `wire.md`: their bytes, in order.
fn examples() -> Vec<Vec<u8>> {
    let page = include_str!("../../../wire.md");
    let blocks = page.split("```hex").skip(1);
    let bytes_of = |block: &str| {
        let (block, _) = block.split_once("```").unwrap();
        let bytes = block
            .lines()
            .filter_map(|line| line.split('|').next())
            .flat_map(str::split_whitespace);
        bytes
            .map(|byte| u8::from_str_radix(byte, 16).unwrap())
            .collect()
    };
    blocks.map(bytes_of).collect()
}

/// The worked example of `wire.md`, byte for byte.
#[test]
fn the_worked_example_of_the_specification_holds() {
    let bytes = &examples()[0];
    assert_eq!(command::<3>(42), *bytes);
    // The check value of this CRC-32, as its catalogues have it.
    assert_eq!(gantry_tau_tests::client::crc32(b"123456789"), 0xcbf4_3926);
    let message = decode_client::<3>(&Frame::parse(bytes).unwrap()).unwrap();
    assert_eq!(&*encode_client(&message), bytes);
}

/// The frames with tags of `wire.md`, from secret, nonce and the server's random numbers on.
#[test]
fn the_worked_example_with_keys_holds() {
    let [command, first, challenge, again, tagged, goodbye] = &examples()[..] else {
        panic!("six examples");
    };
    let secret = std::array::from_fn(|index| u8::try_from(index).unwrap());
    let nonce = std::array::from_fn(|index| 0xa0 + u8::try_from(index).unwrap());
    let key = Key::new(&secret, Role::Control);
    let hello = |cookie| {
        let hello = KeyedHello {
            hello: Hello {
                axes: 3,
                capabilities: Capabilities(3),
            },
            key: key.id(),
            nonce,
            cookie,
        };
        let mut frame = enclose(Kind::KeyedHello, &hello);
        frame.tag(key.greeting(), &[]);
        frame
    };
    assert_eq!(&*hello([0; 16]), first);
    let mut peer = [0; 18];
    peer[10..].copy_from_slice(&[0xff, 0xff, 192, 168, 1, 5, 0xc3, 0x50]);
    let cookie = Keyring::new(&[0x55; 32]).cookie(&peer, &nonce, Epoch(7), Tick(999));
    let mut frame = enclose(Kind::Challenge, &Challenge { cookie });
    frame.tag(key.greeting(), &nonce);
    assert_eq!(&*frame, challenge);
    assert_eq!(&*hello(cookie), again);
    let session = key.session(&SessionOf {
        nonce,
        cookie,
        epoch: Epoch(7),
        axes: 3,
        kinematics_checksum: 0x8f2c_1a77,
    });
    let message = decode_client::<3>(&Frame::parse(command).unwrap()).unwrap();
    for (message, expected) in [
        (message, tagged),
        (ClientMessage::Goodbye(Epoch(7)), goodbye),
    ] {
        let mut frame = encode_client(&message);
        frame.tag(&session, &[]);
        assert_eq!(&*frame, expected);
        let sealed = Sealed::parse(expected, Suite::Tag).unwrap();
        let opened = sealed.check_tag(&session, &[]).unwrap();
        assert_eq!(decode_client(&opened), Ok(message));
    }
}

/// The force sensor lies in a State where the page says.
#[test]
fn a_state_has_its_force_sensor_at_the_place_of_the_specification() {
    let page = include_str!("../../../wire.md");
    let sample = WrenchSample {
        age: 9,
        is_cut: true,
        force: [1, -2, 3].map(ForceMn),
        moment: [-4, 5, i32::MAX].map(MomentUnm),
    };
    let state = State {
        sensor: Some(sample),
        ..TickRecord::<3>::listening().state
    };
    let frame = encode_server(&ServerMessage::State(state));
    let mut expected = vec![3, 9];
    for component in [1, -2, 3, -4, 5, i32::MAX] {
        expected.extend(component.to_le_bytes());
    }
    assert!(page.contains("**State** (102 + 44 N)") && page.contains("\n| 76 | `u8` | bit 0"));
    assert_eq!(frame.len(), 8 + 102 + 44 * 3 + 4);
    assert_eq!(frame[8 + 76..][..26], expected);
    for (offset, field) in [(77, "age"), (78, "force"), (90, "moment")] {
        assert!(page.contains(&format!("\n| {offset} | {field}")), "{field}");
    }
}

/// The gauge link is written down as it is.
#[test]
fn the_specification_names_the_sizes_of_the_gauge_link() {
    let page = include_str!("../../../wire.md");
    let (_, section) = page
        .split_once("## The gauges of the simulated machine")
        .unwrap();
    let (section, _) = section.split_once("\n## ").unwrap();
    let (head, longest, most) = (gauges::HEAD, links::MAX_RECORD, gauges::MAX_GAUGES);
    for expected in [
        format!("{head} bytes"),
        format!("at most {longest}"),
        format!("at most {most}"),
    ] {
        assert!(section.contains(&expected), "{expected}");
    }
}

fn numbers(value: &toml::Value) -> Vec<f64> {
    match value {
        toml::Value::Array(values) => values.iter().flat_map(numbers).collect(),
        toml::Value::Integer(sign) => vec![if *sign < 0 { -1.0 } else { 1.0 }],
        other => vec![other.as_float().unwrap()],
    }
}

/// Checksum of these keys of a robot file, of a rotation and of `metres_per_q`.
fn checksum(text: &str, before: &[&str], rotation: &[f64]) -> u32 {
    let file: toml::Table = toml::from_str(text).unwrap();
    let mut all: Vec<f64> = before.iter().flat_map(|key| numbers(&file[*key])).collect();
    all.extend(rotation);
    all.extend(numbers(&file["axes"]["metres_per_q"]));
    // Zeros without sign.
    let bytes: Vec<u8> = all
        .iter()
        .flat_map(|number| (number + 0.0).to_le_bytes())
        .collect();
    gantry_tau_tests::client::crc32(&bytes)
}

/// The checksum of the kinematics, computed from robot files as the page says.
#[test]
fn the_checksum_is_that_of_the_specification() {
    let l2 = include_str!("../../../robots/l2.toml");
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let said = checksum(l2, &["A0", "V", "b", "L", "c", "cf"], &identity);
    assert_eq!(RobotFile::builtin_l2().unwrap().checksum(), said);
    let f1 = include_str!("../../../robots/f1.toml");
    let said = checksum(
        f1,
        &[
            "C", "V", "P", "b", "L", "c", "ax", "ax6", "sigma4", "sigma5",
        ],
        &[],
    );
    assert_eq!(RobotFile::builtin_f1().unwrap().checksum(), said);
}
