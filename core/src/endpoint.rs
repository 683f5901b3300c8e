//! Bytes in, bytes and drive references out.
