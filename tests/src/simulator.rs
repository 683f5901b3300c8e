//! The other side of a machine in another process: any [`Plant`] behind the lines of
//! `docs/simulators.md`, written from that page alone.
#![allow(
    clippy::as_conversions,
    reason = "nanometres of a machine of some metres are exact in a float"
)]

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};

use gantry_tau_core::control::axis::{InForce, Offsets, Reference};
use gantry_tau_core::units::{OffsetNm, PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_server::plant::{Plant, Reading};
use serde_json::{Value, json};

/// Conduct of a simulator that has an answer to a call.
#[derive(Clone, Debug)]
pub enum Conduct {
    /// Sends it.
    Answer,
    /// Sends these bytes in its place.
    Say(Vec<u8>),
    /// Sends nothing.
    IsSilent,
    /// Closes the connection.
    Leaves,
}

/// Serves a machine in a thread that ends with the process, one connection after the other; `conduct`
/// is asked with every call and its answer. Returns its address.
pub fn spawn<P, const N: usize, const M: usize>(
    mut machine: P,
    mut conduct: impl FnMut(&Value, &Value) -> Conduct + Send + 'static,
) -> SocketAddr
where
    P: Plant<N, M> + 'static,
{
    let listener = TcpListener::bind(crate::server_fixture::LOOPBACK).unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            serve(&mut machine, &stream.unwrap(), &mut conduct);
        }
    });
    address
}

fn serve<P: Plant<N, M>, const N: usize, const M: usize>(
    machine: &mut P,
    mut stream: &TcpStream,
    conduct: &mut impl FnMut(&Value, &Value) -> Conduct,
) {
    stream.set_nodelay(true).unwrap();
    for line in BufReader::new(stream).lines() {
        let Ok(line) = line else { return };
        let call: Value = serde_json::from_str(&line).unwrap();
        let mut answer = answer(machine, &call);
        answer["n"] = call["n"].clone();
        let bytes = match conduct(&call, &answer) {
            Conduct::Answer => format!("{answer}\n").into_bytes(),
            Conduct::Say(bytes) => bytes,
            Conduct::IsSilent => continue,
            Conduct::Leaves => return,
        };
        if stream.write_all(&bytes).is_err() {
            return;
        }
    }
}

fn answer<P: Plant<N, M>, const N: usize, const M: usize>(machine: &mut P, call: &Value) -> Value {
    let done = |done: Result<(), P::Error>| match done {
        Ok(()) => json!({}),
        Err(error) => json!({ "error": error.to_string() }),
    };
    match call["call"].as_str().unwrap() {
        "start" => {
            assert_eq!((&call["axes"], &call["motors"]), (&json!(N), &json!(M)));
            done(machine.start())
        }
        "in_force" => match machine.in_force() {
            Ok(in_force) => json!({ "axes": axes(&in_force) }),
            Err(error) => json!({ "error": error.to_string() }),
        },
        "read" => match machine.read(call["elapsed"].as_u64().unwrap()) {
            Ok(reading) => measurements(
                &reading,
                machine.drives().map(|all| all.map(|one| one.name())),
            ),
            Err(error) => json!({ "error": error.to_string() }),
        },
        "write" => {
            let (motors, axes) = (&call["motors"], &call["axes"]);
            let references = std::array::from_fn(|motor| Reference {
                position: PositionNm(integer(&motors["position_mm"][motor], 1e6)),
                velocity_offset: VelocityUmS(small(&motors["velocity_mm_s"][motor], 1e3)),
                torque_offset: TorquePermille(small(&motors["torque_permille"][motor], 1.0)),
            });
            let parts = std::array::from_fn(|axis| InForce {
                nominal: PositionNm(integer(&axes["nominal_mm"][axis], 1e6)),
                offsets: Offsets {
                    position: OffsetNm(small(&axes["offset_um"][axis], 1e3)),
                    velocity: VelocityUmS(small(&axes["velocity_mm_s"][axis], 1e3)),
                    torque: TorquePermille(small(&axes["torque_permille"][axis], 1.0)),
                },
            });
            done(machine.write(&references, &parts))
        }
        "reset" => {
            machine.reset();
            json!({})
        }
        other => json!({ "error": format!("unknown call {other}") }),
    }
}

fn axes<const N: usize>(in_force: &[InForce; N]) -> Value {
    let offsets = in_force.map(|one| one.offsets);
    json!({
        "nominal_mm": in_force.map(|one| one.nominal.0 as f64 / 1e6).to_vec(),
        "offset_um": offsets.map(|one| f64::from(one.position.0) / 1e3).to_vec(),
        "velocity_mm_s": offsets.map(|one| f64::from(one.velocity.0) / 1e3).to_vec(),
        "torque_permille": offsets.map(|one| one.torque.0).to_vec(),
    })
}

fn measurements<const N: usize>(reading: &Reading<N>, drives: Option<[&str; N]>) -> Value {
    let mm = |nm: PositionNm| nm.0 as f64 / 1e6;
    let mut answer = json!({
        "nominal_mm": reading.nominal.map(mm).to_vec(),
        "actual_mm": reading.actual.map(|one| mm(one.position)).to_vec(),
        "velocity_mm_s": reading.actual.map(|one| f64::from(one.velocity.0) / 1e3).to_vec(),
        "torque_permille": reading.actual.map(|one| one.torque.0).to_vec(),
    });
    if let Some(drives) = drives {
        answer["drives"] = json!(drives.to_vec());
    }
    if let Some(tool) = &reading.tool {
        answer["tool"] = json!({
            "force_n": tool.sensor[..3],
            "moment_nm": tool.sensor[3..],
            "age": tool.sensor_age,
            "load_force_n": tool.load[..3],
            "load_moment_nm": tool.load[3..],
            "displacement_um": tool.displacement_m.map(|m| m * 1e6),
            "turn_urad": tool.turn_rad.map(|rad| rad * 1e6),
        });
        if let Some(acceleration) = tool.acceleration {
            answer["tool"]["acceleration_m_s2"] = json!(acceleration[..3]);
            answer["tool"]["angular_acceleration_rad_s2"] = json!(acceleration[3..]);
        }
    }
    answer
}

fn integer(number: &Value, factor: f64) -> i64 {
    (number.as_f64().unwrap() * factor).round() as i64
}

fn small<T: TryFrom<i64>>(number: &Value, factor: f64) -> T {
    T::try_from(integer(number, factor)).ok().unwrap()
}
