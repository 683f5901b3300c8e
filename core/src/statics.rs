//! Line matrix, link forces, cart loads.
