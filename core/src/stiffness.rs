//! From compliances to displacement.
