//! `examples/session.c` and core, fed the same bytes: every reference and every frame agree, and so does the black box.

use std::process::Command;

use gantry_tau::black_box::Window;
use gantry_tau::replay::Findings;
use gantry_tau_core::control::axis::{Actual, Offsets, Reference};
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::endpoint::{Cycle, Endpoint, MotorMap, Transport};
use gantry_tau_core::control::session::Session;
use gantry_tau_core::control::session::config::{AxisConfig, Config, Parameters, Travel};
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::units::{Epoch, PositionNm, Tick, TorquePermille, VelocityUmS};
use libtest_mimic::Failed;

use super::tools::{Program, run};

const AXES: usize = 3;
const MOTORS: usize = 4;
const HALF: usize = 64;

/// One tick of the program's trace.
#[derive(Debug, Default)]
pub(crate) struct Traced {
    input: Vec<u8>,
    motors: Vec<Reference>,
    frames: Vec<Vec<u8>>,
}

pub(crate) fn agrees(compiler: &str, flags: &[&str]) -> Result<(), Failed> {
    let program = Program::compile("examples/session.c", compiler, flags)?;
    let (trace, black_box) = (program.file("trace"), program.file("jsonl"));
    let said = program.run(&[&trace, &black_box])?;
    assert!(said.ends_with("all bounds held over 700 ticks\n"), "{said}");
    compare(&std::fs::read_to_string(trace)?, &std::fs::read(black_box)?);
    Ok(())
}

/// A server with a black box is half a megabyte: made where it stays, it needs no stack.
pub(crate) fn on_a_small_stack() -> Result<(), Failed> {
    let program = Program::compile("examples/session.c", "gcc", &["-O2"])?;
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -s 128 && exec \"$0\""]);
    let said = run(command.arg(program.path()))?;
    assert!(said.ends_with("all bounds held over 700 ticks\n"), "{said}");
    Ok(())
}

/// The trace and the black box of the program against core.
pub(crate) fn compare(trace: &str, black_box: &[u8]) {
    let mut endpoint = core();
    let client = endpoint.open(Transport::Stream).unwrap();
    let traced = read(trace);
    assert_eq!(traced.len(), 700);
    let mut welcomed = 0;
    let mut window = None;
    for (index, there) in traced.iter().enumerate() {
        endpoint.feed(client, &there.input);
        let mut frames = Vec::new();
        let cycle = cycle(i64::try_from(index).unwrap() + 1, welcomed);
        let turn = endpoint.tick(&cycle, &mut |_: Connection, bytes| {
            frames.push(bytes.to_vec())
        });
        assert_eq!(
            there.motors,
            turn.motors,
            "references of tick {}",
            index + 1
        );
        assert_eq!(there.frames, frames, "frames of tick {}", index + 1);
        if turn.output.welcome.is_some() {
            welcomed = turn.output.state.epoch.0;
        }
        window = Window::of(endpoint.black_box());
    }
    let window = window.unwrap();
    assert_eq!(
        String::from_utf8_lossy(black_box),
        window.encode(),
        "the black box"
    );
    let read = Window::<AXES>::decode("the black box", black_box).unwrap();
    let findings = Findings::of(&read);
    assert_eq!(findings.difference, None);
    assert_eq!(findings.cause, Some("ClientLate"));
    assert_eq!(findings.cause_tick, 251);
}

/// The server of the program.
fn core() -> Endpoint<AXES, MOTORS, HALF> {
    let limits = Limits::new(2_000_000, 5_000, 10_000, 100).unwrap();
    let axis = AxisConfig::position_only(limits, Travel::around_zero(1_000_000_000), 2_000_000);
    let config = Config::new(Parameters::thesis([axis; AXES])).unwrap();
    let start = [PositionNm(0); AXES];
    let session = Session::new(
        config,
        &[Offsets::default(); AXES],
        start,
        Tick(0),
        Epoch(0),
    );
    Endpoint::new(session.unwrap(), MotorMap::new([0, 0, 1, 2]).unwrap())
}

/// What the program gives to a tick. Its client learns its epoch from the Welcome, and the next one is one more.
fn cycle(tick: i64, welcomed: u64) -> Cycle<AXES> {
    let nominal = [1, 2, 3].map(|axis| PositionNm(tick * 1_000 * axis));
    let actual = nominal.map(|nominal| Actual {
        position: PositionNm(nominal.0 - 50),
        ..Actual::default()
    });
    Cycle::on_time(nominal, actual, Epoch(welcomed + 1))
}

fn read(trace: &str) -> Vec<Traced> {
    let mut ticks: Vec<Traced> = Vec::new();
    for line in trace.lines() {
        let (what, rest) = line.split_once(' ').unwrap();
        if what == "tick" {
            ticks.push(Traced::default());
            continue;
        }
        let tick = ticks.last_mut().unwrap();
        match what {
            "in" => tick.input = bytes(rest),
            "out" => tick.frames.push(bytes(rest)),
            "motor" => tick.motors.push(reference(rest)),
            _ => panic!("{line}"),
        }
    }
    ticks
}

fn reference(numbers: &str) -> Reference {
    let mut numbers = numbers
        .split(' ')
        .map(|number| number.parse::<i64>().unwrap());
    let mut next = || numbers.next().unwrap();
    Reference {
        position: PositionNm(next()),
        velocity_offset: VelocityUmS(i32::try_from(next()).unwrap()),
        torque_offset: TorquePermille(i16::try_from(next()).unwrap()),
    }
}

fn bytes(digits: &str) -> Vec<u8> {
    let pairs = digits.as_bytes().chunks(2);
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap();
    pairs.map(byte).collect()
}
