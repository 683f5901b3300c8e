//! The simulated drives: what they do by themselves, and what the server sees of it.

mod cascade;
mod coupled;
mod encoder;
mod machine;
mod robot_file;
mod stops;

use gantry_tau_core::control::axis::{Actual, Reference};
use gantry_tau_core::units::{PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_sim::drive::{Drive, Settings, report};

/// Text of the L2's robot file, and of the F1's.
const L2: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../robots/l2.toml"));
const F1: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../robots/f1.toml"));

fn at(nm: i64) -> Reference {
    Reference {
        position: PositionNm(nm),
        velocity_offset: VelocityUmS(0),
        torque_offset: TorquePermille(0),
    }
}

fn actual(drive: &Drive) -> Actual {
    report(std::iter::once(drive)).unwrap()
}

/// Reference of a cycle on the way to 0.5 m/s at 2 m/s^2, nm: integers, so nothing is rounded.
fn accelerating(cycle: i64) -> i64 {
    if cycle < 250 {
        cycle * cycle * 1_000
    } else {
        250 * 250 * 1_000 + (cycle - 250) * 500_000
    }
}

/// Nanometres as micrometres.
fn um(nm: i64) -> f64 {
    f64::from(i32::try_from(nm).unwrap()) * 1e-3
}

fn close(value: f64, expected: f64, share: f64) -> bool {
    (value / expected - 1.0).abs() <= share
}

fn ideal() -> Settings {
    Settings::IDEAL
}

/// A robot file without its section of drives.
fn without_drives(text: &str) -> String {
    let Some((before, rest)) = text.split_once("[drives]\n") else {
        return text.to_owned();
    };
    let (_, after) = rest.split_once("\n[").unwrap();
    format!("{before}[{after}")
}
