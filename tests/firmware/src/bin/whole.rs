//! The whole core: the server, and kinematics, statics and compensation of both machines. Its size
//! is measured; it is not run. (`firmware` also has what plays recordings.)
#![no_std]
#![no_main]
#![allow(
    dead_code,
    reason = "the machine is that of the firmware, which uses all of it"
)]

use core::hint::black_box;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use cortex_m::singleton;
use cortex_m_rt::entry;
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::Capabilities;
use gantry_tau_core::units::PositionNm;

#[cfg_attr(feature = "keyed", path = "../keys.rs")]
#[cfg_attr(not(feature = "keyed"), path = "../no_keys.rs")]
mod keys;
#[path = "../machine/mod.rs"]
mod machine;

use machine::{AXES, ControlCycle, CycleInput, Machine, Motion, Parts, Unmeasured};

/// Input of a board: positions of the axes, bytes, input of a cycle.
struct Board {
    nominal: [PositionNm; AXES],
    transport: Transport,
    bytes: [u8; 300],
    input: CycleInput,
}

/// A board at rest.
const BOARD: Board = Board {
    nominal: [PositionNm(0); AXES],
    transport: Transport::Stream,
    bytes: [0; 300],
    input: CycleInput::on_time(Motion::L2, [0.0; 6]),
};

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}

#[entry]
fn main() -> ! {
    if let (Some(board), Some(machine)) = (
        singleton!(: Board = BOARD),
        singleton!(: MaybeUninit<Machine> = MaybeUninit::uninit()),
    ) {
        serve(board, machine);
    }
    loop {
        cortex_m::asm::wfi();
    }
}

/// Starts the server; then opens, feeds, closes and runs cycles for ever. Behind a black box the
/// compiler must assume that the board's memory changes and that references and frames are read.
fn serve(board: &mut Board, machine: &mut MaybeUninit<Machine>) -> Option<()> {
    let board = black_box(board);
    let cycle =
        ControlCycle::write(singleton!(: MaybeUninit<ControlCycle> = MaybeUninit::uninit())?)
            .ok()?;
    let parts = Parts::new(cycle, Capabilities::NONE, board.nominal).ok()?;
    let machine = machine.write(Machine::new(parts, keys::server));
    loop {
        let seen = black_box(&mut *board);
        let server = machine.server();
        if let Ok(connection) = server.open(seen.transport) {
            server.feed(connection, &seen.bytes);
            server.close(black_box(connection));
        }
        black_box(machine.compute(&seen.input, &mut Unmeasured));
        black_box(
            machine.serve(&seen.input, &mut Unmeasured, &mut |_, frame| {
                black_box(frame);
            }),
        );
        while let Some(connection) = machine.server().poll_close() {
            black_box(connection);
        }
    }
}
