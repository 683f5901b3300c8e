//! `labcomm`: streams of LabComm as JSON lines, JSON lines as streams, and the schema of
//! gantry-tau's own samples.
//!
//! One line per event, in the order of the stream; `at` is the offset in the stream, bytes:
//!
//! ```text
//! {"at":0,"version":"LabComm2014.v1"}
//! {"at":17,"define":"data","index":64,"type":["array",[3],"int"]}
//! {"at":50,"sample":"data","index":64,"value":[42,-7,2000000]}
//! {"at":64,"error":{"kind":"incomplete","message":"..."}}
//! ```

mod decode;
mod encode;
mod from_json;
mod incoming;
mod json_schema;
mod line_error;
mod schema;
mod to_json;

use gantry_tau_labcomm::{Registry, Type};

pub use decode::decode;
pub use encode::{EncodeError, encode};
pub use incoming::Incoming;
pub(crate) use json_schema::json_schema;
pub use line_error::LineError;
pub use schema::schema;
pub(crate) use to_json::{Floats, value as write_value};

/// Definitions that the program takes from one stream.
const DEFINITIONS: usize = 256;
/// Bytes of names and types that the program takes from one stream.
const DEFINITION_BYTES: usize = 1 << 16;

/// Stream with the limits of the program.
pub type Stream = Incoming<DEFINITIONS, DEFINITION_BYTES>;
/// Definitions of a stream that is encoded.
type StreamRegistry = Box<Registry<DEFINITIONS, DEFINITION_BYTES>>;

/// Type, as the lines have it.
pub fn type_text(ty: &Type<'_>) -> String {
    let mut text = String::new();
    to_json::ty(&mut text, ty);
    text
}
