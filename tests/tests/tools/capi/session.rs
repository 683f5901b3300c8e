//! `examples/session.c` and core, fed the same bytes: every reference and every frame agree, and so does the black box.

use std::process::Command;

use gantry_tau::black_box::Window;
use gantry_tau::replay::Findings;
use gantry_tau_core::control::axis::{Actual, Reference};
use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::endpoint::{Endpoint, MotorMap, Transport};
use gantry_tau_core::control::session::config::{AxisConfig, Config, Parameters, Travel};
use gantry_tau_core::control::session::{BlackBox, LastWrite, Session, Start, TickInput};
use gantry_tau_core::units::{Epoch, EpochRange, PositionNm, TorquePermille, VelocityUmS};
use libtest_mimic::Failed;

use super::tools::{Program, from_hex, run};

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
    let (trace, black_box) = (program.file("trace"), program.file("gtbb"));
    let said = program.run(&[&trace, &black_box])?;
    assert!(said.ends_with("all bounds held over 700 ticks\n"), "{said}");
    compare(&std::fs::read_to_string(trace)?, &std::fs::read(black_box)?);
    Ok(())
}

/// A server with a black box has half a megabyte; it is built in place, without a copy on the stack.
pub(crate) fn on_a_small_stack() -> Result<(), Failed> {
    let program = Program::compile("examples/session.c", "gcc", &["-O2"])?;
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -s 128 && exec \"$0\""]);
    let said = run(command.arg(program.path()))?;
    assert!(said.ends_with("all bounds held over 700 ticks\n"), "{said}");
    Ok(())
}

/// Compares the trace and the black box of the program with core's.
pub(crate) fn compare(trace: &str, black_box: &[u8]) {
    let mut endpoint = core();
    let client = endpoint.open(Transport::Stream).unwrap();
    let traced = read(trace);
    assert_eq!(traced.len(), 700);
    let mut recorder = Box::new(BlackBox::<AXES, HALF>::new());
    for (index, there) in traced.iter().enumerate() {
        endpoint.feed(client, &there.input);
        let input = input(i64::try_from(index).unwrap() + 1);
        let references = endpoint.tick_recorded(&input, &mut *recorder);
        assert_eq!(there.motors, references.unwrap(), "references of tick {}", index + 1);
        let mut frames = Vec::new();
        while let Some((_, frame)) = endpoint.poll_transmit() {
            frames.push(frame.to_vec());
        }
        assert_eq!(there.frames, frames, "frames of tick {}", index + 1);
        while endpoint.poll_close().is_some() {}
    }
    let read = Window::<AXES>::decode("the black box", black_box).unwrap();
    assert!(Some(&read) == Window::of(&recorder).as_ref());
    let findings = Findings::of(&read);
    assert_eq!(findings.difference, None);
    assert_eq!(findings.cause, Some("ClientLate"));
    assert_eq!(findings.cause_tick, 251);
}

/// The server of the program.
fn core() -> Endpoint<AXES, MOTORS> {
    let limits = Limits::new(LimitValues { max: 2_000_000, step: 5_000, accel: 10_000, ramp: 100 });
    let travel = Travel::around_zero(1_000_000_000);
    let axis = AxisConfig::position_only(limits.unwrap(), travel, 2_000_000);
    let config = Config::new(Parameters::thesis([axis; AXES])).unwrap();
    let session = Session::new(config, &Start::at_rest([PositionNm(0); AXES]));
    let epochs = EpochRange { first: Epoch(1), last: Epoch(1) };
    Endpoint::new(session.unwrap(), MotorMap::new([0, 0, 1, 2]).unwrap(), epochs)
}

/// The program's input of a tick.
fn input(tick: i64) -> TickInput<AXES> {
    let nominal = [1, 2, 3].map(|axis| PositionNm(tick * 1_000 * axis));
    TickInput {
        elapsed_cycles: 1,
        nominal,
        actual: nominal.map(|nominal| Actual { position: PositionNm(nominal.0 - 50), ..Actual::default() }),
        stop: false,
        rearm: false,
        last_write: LastWrite::Accepted,
        arrival_us: 0,
    }
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
            "in" => tick.input = from_hex(rest),
            "out" => tick.frames.push(from_hex(rest)),
            "motor" => tick.motors.push(reference(rest)),
            _ => panic!("{line}"),
        }
    }
    ticks
}

fn reference(numbers: &str) -> Reference {
    let mut numbers = numbers.split(' ').map(|number| number.parse::<i64>().unwrap());
    let mut next = || numbers.next().unwrap();
    Reference {
        position: PositionNm(next()),
        velocity_offset: VelocityUmS(i32::try_from(next()).unwrap()),
        torque_offset: TorquePermille(i16::try_from(next()).unwrap()),
    }
}
