//! `solve`: JSON lines in, JSON lines out.
