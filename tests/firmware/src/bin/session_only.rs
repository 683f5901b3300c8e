//! How large the server is by itself: session, wire and channels of six axes, without kinematics. It is measured, not run.
#![no_std]
#![no_main]
#![allow(
    unsafe_code,
    reason = "input that the compiler cannot foresee; each block says why it is sound"
)]

use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use cortex_m::singleton;
use cortex_m_rt::entry;
use gantry_tau_core::axis::Offsets;
use gantry_tau_core::endpoint::{Cycle, Endpoint, MotorMap, Transport};
use gantry_tau_core::session::Session;
use gantry_tau_core::session::config::{Config, Parameters};
use gantry_tau_core::session::decide::Connection;
use gantry_tau_core::units::{Epoch, PositionNm, Tick};

/// The server.
type Server = Endpoint<6, 9, 8>;

/// What a board would put there: configuration, cycle, bytes; and what it would read.
struct Board {
    parameters: Parameters<6>,
    in_force: [Offsets; 6],
    cycle: Cycle<6>,
    transport: Transport,
    connection: Connection,
    bytes: [u8; 64],
    sent: u8,
    position: PositionNm,
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}

#[entry]
fn main() -> ! {
    if let (Some(board), Some(server)) = (
        singleton!(: MaybeUninit<Board> = MaybeUninit::zeroed()),
        singleton!(: MaybeUninit<Server> = MaybeUninit::uninit()),
    ) {
        serve(board.as_mut_ptr(), server);
    }
    loop {
        cortex_m::asm::wfi();
    }
}

/// Start; then open, feed, close and tick for ever.
fn serve(board: *mut Board, server: &mut MaybeUninit<Server>) -> Option<()> {
    // SAFETY: zeros are a value of every field of the board, and nothing else uses it; volatile, for the compiler knows of no one who
    // writes there.
    let look = || unsafe { board.read_volatile() };
    let Board {
        parameters,
        in_force,
        cycle,
        ..
    } = look();
    let config = Config::new(parameters).ok()?;
    let session = Session::new(config, &in_force, cycle.nominal, Tick(0), Epoch(0)).ok()?;
    let motors = MotorMap::new([0, 0, 1, 1, 2, 2, 3, 4, 5]).ok()?;
    let server = server.write(Server::new(session, motors));
    loop {
        let mut seen = look();
        let _full = server.open(seen.transport);
        server.feed(seen.connection, &seen.bytes);
        server.close(seen.connection);
        let turn = server.tick(&seen.cycle, &mut |_, bytes| {
            seen.sent ^= bytes.first().copied().unwrap_or(0);
        });
        for motor in &turn.motors {
            seen.position.0 ^= motor.position.0;
        }
        // SAFETY: as above.
        unsafe { board.write_volatile(seen) };
    }
}
