//! Force sensor: tare, frame, low-pass.
