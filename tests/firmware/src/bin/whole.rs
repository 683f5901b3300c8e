//! How large the whole is: the server, and the kinematics, statics and compensation of both machines. It is measured, not run: what
//! `firmware` has beside it plays recordings.
#![no_std]
#![no_main]
#![allow(
    dead_code,
    reason = "the machine is that of the firmware, which makes all of its values"
)]

use core::hint::black_box;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use cortex_m::singleton;
use cortex_m_rt::entry;
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::Capabilities;
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::units::{Epoch, PositionNm};

#[path = "../machine/mod.rs"]
mod machine;

use machine::{AXES, Machine, Meter, Moment, Motion, Part, Parts};

/// What a board would put there: where the axes are, bytes, what a tick depends on.
struct Board {
    nominal: [PositionNm; AXES],
    transport: Transport,
    connection: Connection,
    bytes: [u8; 300],
    moment: Moment,
}

/// A board before anybody has written to it.
const BOARD: Board = Board {
    nominal: [PositionNm(0); AXES],
    transport: Transport::Stream,
    connection: Connection(0),
    bytes: [0; 300],
    moment: Moment {
        elapsed: 1,
        stop: false,
        rearm: false,
        next_epoch: Epoch(1),
        arrival_us: 0,
        motion: Motion::L2,
        pose: [0.0; 6],
        load: [0.0; 6],
    },
};

/// Nobody measures time here.
struct Unmeasured;

impl Meter for Unmeasured {
    fn begin(&mut self) {}
    fn end(&mut self, _part: Part) {}
}

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

/// Start; then open, feed, close and tick for ever. Behind a black box, the compiler has to believe that somebody else writes to the
/// board and reads what is sent.
fn serve(board: &mut Board, machine: &mut MaybeUninit<Machine>) -> Option<()> {
    let board = black_box(board);
    let parts = Parts::new(Capabilities::NONE, board.nominal).ok()?;
    let machine = machine.write(Machine::new(parts));
    loop {
        let seen = black_box(&mut *board);
        let server = machine.server();
        Unmeasured.begin();
        let _full = server.open(seen.transport);
        server.feed(seen.connection, &seen.bytes);
        server.close(seen.connection);
        Unmeasured.end(Part::Feed);
        black_box(machine.compute(&seen.moment, &mut Unmeasured));
        let turn = machine.serve(&seen.moment, &mut Unmeasured, &mut |_, bytes| {
            black_box(bytes);
        });
        black_box(&turn);
    }
}
