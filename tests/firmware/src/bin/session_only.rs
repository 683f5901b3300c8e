//! How large the server is by itself: session, wire and channels of six axes, without kinematics. It is measured, not run.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use cortex_m::singleton;
use cortex_m_rt::entry;
use gantry_tau_core::control::axis::{Actual, Offsets};
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::endpoint::{Cycle, Endpoint, MotorMap, Transport};
use gantry_tau_core::control::session::Session;
use gantry_tau_core::control::session::config::{AxisConfig, Config, Parameters, Travel};
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::units::{Epoch, PositionNm, Tick};

/// The server.
type Server = Endpoint<6, 9, 8>;

/// What a board would put there: configuration, cycle, bytes.
struct Board {
    parameters: Parameters<6>,
    in_force: [Offsets; 6],
    cycle: Cycle<6>,
    transport: Transport,
    connection: Connection,
    bytes: [u8; 64],
}

impl Board {
    /// Before anybody has written to it.
    fn new() -> Option<Self> {
        let limits = Limits::new(2_000_000, 5_000, 10_000, 100).ok()?;
        let axis = AxisConfig::position_only(limits, Travel::around_zero(1_000_000_000), 2_000_000);
        let nominal = [PositionNm(0); 6];
        Some(Self {
            parameters: Parameters::thesis([axis; 6]),
            in_force: [Offsets::default(); 6],
            cycle: Cycle::on_time(nominal, [Actual::default(); 6], Epoch(1)),
            transport: Transport::Stream,
            connection: Connection(0),
            bytes: [0; 64],
        })
    }
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}

#[entry]
fn main() -> ! {
    if let (Some(board), Some(server)) = (
        Board::new().and_then(|board| singleton!(: Board = board)),
        singleton!(: MaybeUninit<Server> = MaybeUninit::uninit()),
    ) {
        serve(board, server);
    }
    loop {
        cortex_m::asm::wfi();
    }
}

/// Start; then open, feed, close and tick for ever. Behind a black box, the compiler has to believe that somebody else writes to the
/// board and reads what is sent.
fn serve(board: &mut Board, server: &mut MaybeUninit<Server>) -> Option<()> {
    let board = black_box(board);
    let config = Config::new(board.parameters).ok()?;
    let nominal = board.cycle.nominal;
    let session = Session::new(config, &board.in_force, nominal, Tick(0), Epoch(0)).ok()?;
    let motors = MotorMap::new([0, 0, 1, 1, 2, 2, 3, 4, 5]).ok()?;
    let server = server.write(Server::new(session, motors));
    loop {
        let seen = black_box(&mut *board);
        let _full = server.open(seen.transport);
        server.feed(seen.connection, &seen.bytes);
        server.close(seen.connection);
        let turn = server.tick(&seen.cycle, &mut |_, bytes| {
            black_box(bytes);
        });
        black_box(&turn);
    }
}
