//! Everything that can reach a drive: integers only, no float arithmetic, no allocation. Builds
//! without nalgebra and libm.
//!
//! | module | contents |
//! |---|---|
//! | [`agitation`] | budget for the second differences of an offset |
//! | [`axis`] | commands and reports of one axis |
//! | [`channel`] | one bounded reference value |
//! | [`position_loop`] | position loop outside a drive that takes velocities `[T 6.2.2]`; feature `position-loop`, default |
//! | [`message`] | messages between client and server, as types |
//! | [`wire`] | messages as frames of bytes |
//! | [`session`] | the server's state machine `[T 5.1.1]` |
//! | [`endpoint`] | session, deframers and motors: bytes in, drive references and bytes out |
//! | [`keys`] | tags of frames under shared keys; feature `keyed`, default |
//! | [`client`] | the client's half of the protocol: bytes in, events and bytes out |
//! | [`pacer`] | targets of a slow program, as one target per tick; feature `pacer`, default |
//! | [`monitor`] | independent run-time check of States and references against limits |

pub mod agitation;
pub mod axis;
pub mod channel;
pub mod client;
pub mod endpoint;
#[cfg(test)]
mod fixture;
#[cfg(feature = "keyed")]
pub mod keys;
pub mod message;
pub mod monitor;
#[cfg(feature = "pacer")]
pub mod pacer;
#[cfg(feature = "position-loop")]
pub mod position_loop;
pub mod session;
pub mod wire;
