//! Samples over LabComm around a session in lock-step: readers of any conduct, clients that take
//! their force from a stream, monitors.

mod failure;
mod lockstep;
mod monitors;
mod reader;
mod readers;
mod sensor;
mod stream;
