//! The server by itself: session, wire and channels of six axes, without kinematics. Its size is
//! measured; it is not run.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use cortex_m::singleton;
use cortex_m_rt::entry;
use gantry_tau_core::control::session::BlackBox;
#[cfg(feature = "keyed")]
use gantry_tau_core::control::{
    endpoint::Budget,
    keys::{Key, Keyring, Role},
};
use gantry_tau_core::units::Epoch;
use gantry_tau_core::{
    AxisConfig, Config, Endpoint, EpochRange, LimitValues, Limits, MotorMap, Parameters,
    PositionNm, Reading, Session, Start, TickInput, Transport, Travel, Write,
};

/// The server, and storage for its black box.
type Server = (Endpoint<6>, BlackBox<6, 8>);

/// Input of a board: configuration, start, cycle, bytes.
struct Board {
    parameters: Parameters<6>,
    start: Start<6>,
    epochs: EpochRange,
    tick: TickInput<6>,
    transport: Transport,
    bytes: [u8; 64],
    /// Secrets of this start, and of the key.
    #[cfg(feature = "keyed")]
    secrets: [[u8; 32]; 2],
}

impl Board {
    /// A board at rest.
    fn new() -> Option<Self> {
        let limits = Limits::new(LimitValues {
            max: 2_000_000,
            step: 5_000,
            accel: 10_000,
            ramp: 100,
        });
        let travel = Travel::around_zero(1_000_000_000);
        let axis = AxisConfig::position_only(limits.ok()?, travel, 2_000_000);
        let nominal = [PositionNm(0); 6];
        Some(Self {
            parameters: Parameters::thesis([axis; 6]),
            start: Start::at_rest(nominal),
            epochs: EpochRange {
                first: Epoch(1),
                last: Epoch(4_096),
            },
            tick: TickInput {
                elapsed_cycles: 1,
                reading: Some(Reading::unmeasured(nominal)),
                sensor: None,
                stop: false,
                quit: false,
                rearm: false,
            },
            transport: Transport::Stream,
            bytes: [0; 64],
            #[cfg(feature = "keyed")]
            secrets: [[0x5a; 32], [0xa5; 32]],
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

/// Returns the server of a session.
#[cfg(not(feature = "keyed"))]
#[inline(always)]
fn endpoint(board: &Board, session: Session<6>) -> Endpoint<6> {
    Endpoint::new(session, board.epochs)
}

/// Returns the server of a session, with the key of the board.
#[cfg(feature = "keyed")]
#[inline(always)]
fn endpoint(board: &Board, session: Session<6>) -> Endpoint<6> {
    let [start_secret, secret] = &board.secrets;
    let mut keyring = Keyring::new(start_secret);
    // An empty keyring has room.
    keyring.add(Key::new(secret, Role::Control)).unwrap_or(());
    let budget = Budget {
        tags: 4,
        greetings: 1,
    };
    Endpoint::keyed(session, board.epochs, keyring, budget)
}

/// Starts the server; then opens, feeds, closes and ticks for ever. Behind a black box the compiler
/// must assume that the board's memory changes and that references and frames are read.
fn serve(board: &mut Board, server: &mut MaybeUninit<Server>) -> Option<()> {
    let board = black_box(board);
    let config = Config::new(board.parameters).ok()?;
    let session = Session::new(config, &board.start).ok()?;
    let motors = MotorMap::<6, 9>::new([0, 0, 1, 1, 2, 2, 3, 4, 5]).ok()?;
    let (server, recorder) = server.write((endpoint(board, session), BlackBox::new()));
    loop {
        let seen = black_box(&mut *board);
        if let Ok(connection) = server.open(seen.transport) {
            server.feed(connection, &seen.bytes);
            server.close(black_box(connection));
        }
        match server.tick_recorded(&seen.tick, recorder) {
            Write::Due(write) => {
                black_box(motors.spread(write.references()));
                write.accepted();
            }
            Write::Withheld(drives) => drives.read_back(seen.start.in_force),
        }
        while let Some(frame) = server.poll_transmit() {
            black_box(frame);
        }
        while let Some(connection) = server.poll_close() {
            black_box(connection);
        }
    }
}
