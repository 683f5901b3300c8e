//! Hostile traffic over a real socket. For any traffic, the references of the machine obey
//! `docs/design.md` 6: the first miss holds, from the second on positions fall by exactly 100 nm
//! per tick, and no peer is let in before zero. (The server asserts the bounds in every tick; the
//! tests say what must happen beside that.)

mod content;
mod endings;
mod exhaustion;
mod frames;
mod hellos;
mod machine;
mod non_owners;

/// Offsets to fall from: 124 ticks, with rests; 71 ticks; one.
const AT: [i32; 3] = [12_345, -7_050, 30];
