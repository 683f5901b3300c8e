//! The server's state machine on messages.
