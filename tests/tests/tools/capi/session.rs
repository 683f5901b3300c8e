//! `examples/session.c` and core, fed the same bytes: every reference and every frame agree, and so
//! does the black box.

use std::fmt::Write as _;
use std::process::Command;

use gantry_tau::replay::Findings;
use gantry_tau_core::control::axis::Actual;
use gantry_tau_core::control::endpoint::{Endpoint, MotorMap, Transport};
use gantry_tau_core::control::session::config::{AxisConfig, Config, Parameters, Travel};
use gantry_tau_core::control::session::{BlackBox, Reading, Session, Start, TickInput};
use gantry_tau_core::units::{Epoch, EpochRange, PositionNm};
use gantry_tau_server::black_box::Window;
use gantry_tau_tests::server_fixture::{limits, on_time, taken};
use libtest_mimic::Failed;

use super::tools::{Program, assert_lines, from_hex, hex, motor_line, run};

const AXES: usize = 3;
const MOTORS: usize = 4;
const TICKS: usize = 700;

pub(crate) fn agrees(compiler: &str, flags: &[&str]) -> Result<(), Failed> {
    let program = Program::compile("examples/session.c", compiler, flags)?;
    let (trace, black_box) = (program.file("trace"), program.file("gtbb"));
    let said = program.run(&[&trace, &black_box])?;
    assert!(said.ends_with("all bounds held over 700 ticks\n"), "{said}");
    compare(&std::fs::read_to_string(trace)?, &std::fs::read(black_box)?);
    Ok(())
}

/// A server with a black box has half a megabyte; it is built in place, without a copy on the
/// stack.
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
    let inputs: Vec<&str> = trace
        .lines()
        .filter_map(|line| line.strip_prefix("in "))
        .collect();
    assert_eq!(inputs.len(), TICKS);
    let mut endpoint = core();
    let motors = MotorMap::<AXES, MOTORS>::new([0, 0, 1, 2]).unwrap();
    let client = endpoint.open(Transport::Stream).unwrap();
    let mut recorder = Box::new(BlackBox::<AXES, 64>::new());
    let mut here = String::new();
    for (tick, bytes) in (1..).zip(inputs) {
        endpoint.feed(client, &from_hex(bytes));
        let references = taken(endpoint.tick_recorded(&input(tick), &mut *recorder));
        writeln!(here, "tick {tick}\nin {bytes}").unwrap();
        here.extend(motors.spread(&references).unwrap().iter().map(motor_line));
        while let Some((_, frame)) = endpoint.poll_transmit() {
            writeln!(here, "out {}", hex(frame)).unwrap();
        }
        while endpoint.poll_close().is_some() {}
    }
    assert_lines(trace, &here);
    let read = gantry_tau_record::black_box::decode::<AXES>("the black box", black_box).unwrap();
    assert!(Some(&read) == Window::of(&recorder).as_ref());
    let findings = Findings::of(&read);
    assert_eq!(findings.difference, None);
    assert_eq!(findings.cause, Some("ClientLate"));
    assert_eq!(findings.cause_tick, 251);
}

/// The server of the program.
fn core() -> Endpoint<AXES> {
    let travel = Travel::around_zero(1_000_000_000);
    let axis = AxisConfig::position_only(limits(2_000_000, 5_000, 10_000, 100), travel, 2_000_000);
    let config = Config::new(Parameters::thesis([axis; AXES])).unwrap();
    let session = Session::new(config, &Start::at_rest([PositionNm(0); AXES]));
    let epochs = EpochRange {
        first: Epoch(1),
        last: Epoch(1),
    };
    Endpoint::new(session.unwrap(), epochs)
}

/// The program's input of a tick.
fn input(tick: i64) -> TickInput<AXES> {
    let nominal = [1, 2, 3].map(|axis| PositionNm(tick * 1_000 * axis));
    let actual = nominal.map(|nominal| Actual {
        position: PositionNm(nominal.0 - 50),
        ..Actual::ZERO
    });
    TickInput {
        reading: Some(Reading { nominal, actual }),
        ..on_time(nominal)
    }
}
