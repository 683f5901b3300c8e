//! What client and server say to each other, as types; no bytes.
