//! The maths seam and small linear solves.
