//! The network: a driver for the board's Ethernet controller, and a TCP server on top of it.
//! Polled; no allocation.

pub(crate) mod lan9118;
mod registers;
pub(crate) mod tcp;
