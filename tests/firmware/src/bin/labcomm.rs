//! LabComm by itself: a decoder of eight definitions, and the two samples of the thesis in both
//! directions. Its size is measured; it is not run.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::panic::PanicInfo;

use cortex_m::singleton;
use cortex_m_rt::entry;
use gantry_tau_labcomm::samples::{Data, ForceSensor};
use gantry_tau_labcomm::{Collector, Decoded, Decoder, Encoder, Event, Version};

/// What has come and is not decoded, the decoder, and a buffer to encode into.
struct Board {
    version: Version,
    chunk: [u8; 64],
    collector: Collector<512>,
    decoder: Decoder<8, 512>,
    data: Data,
    force: ForceSensor,
    sent: [u8; 256],
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}

#[entry]
fn main() -> ! {
    let board = Board {
        version: Version::V2006,
        chunk: [0; 64],
        collector: Collector::new(),
        decoder: Decoder::new(512),
        data: Data([0; 3]),
        force: ForceSensor([0.0; 6]),
        sent: [0; 256],
    };
    if let Some(board) = singleton!(: Board = board) {
        loop {
            let board = black_box(&mut *board);
            receive(board);
            black_box(send(board));
        }
    }
    loop {
        cortex_m::asm::wfi();
    }
}

/// Decodes a chunk; keeps the samples whose definitions are those of the thesis.
fn receive(board: &mut Board) {
    board.collector.append(&board.chunk);
    while let Ok(Decoded::Event { event, used }) = board.decoder.decode(board.collector.held()) {
        if let Event::Data { definition, value } = event {
            if definition.is::<Data>() {
                board.data = value.read().unwrap_or(board.data);
            } else if definition.is::<ForceSensor>() {
                board.force = value.read().unwrap_or(board.force);
            }
        }
        board.collector.drop_front(used);
    }
}

/// Encodes a stream of both samples; its length.
fn send(board: &mut Board) -> Option<usize> {
    let mut encoder = Encoder::new(board.version, &mut board.sent);
    encoder.version().ok()?;
    encoder.define::<Data>(0x80).ok()?;
    encoder.define::<ForceSensor>(0x81).ok()?;
    encoder.data(0x80, &board.data).ok()?;
    encoder.data(0x81, &board.force).ok()?;
    Some(encoder.len())
}
