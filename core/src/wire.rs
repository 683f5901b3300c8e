//! Messages as frames of bytes.
