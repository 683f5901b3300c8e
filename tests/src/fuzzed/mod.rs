//! Bodies of the targets of `../fuzz`: each makes its input of the bytes and checks the properties
//! of `gantry_tau_proofs`.
//!
//! Here and not in the targets, so that stable Rust can replay seeds and corpora:
//! `tests/fuzz_seeds`.

mod compensation;
mod config;
mod deframer;
mod frame;
mod greeting;
mod kinematics;
mod labcomm;
mod measurements;
mod position_loop;
mod session;
mod solve;
mod steering;

pub use compensation::{Loads, compensation};
pub use config::config;
pub use deframer::deframer;
pub use frame::{Sealed, frame};
pub use greeting::{ACT, acts, greeting};
pub use kinematics::{Problem, kinematics};
pub use labcomm::{labcomm, labcomm_json};
pub use measurements::{BETWEEN, kinds_of_file, measurements};
pub use position_loop::{CONFIG as LOOP_CONFIG, TICK as LOOP_TICK, position_loop};
pub use session::session;
pub use solve::solve;
pub use steering::{SAMPLE, SETTINGS, steering};

use arbitrary::{Arbitrary, Unstructured};

/// Panics when a property does not hold for the bytes.
pub type Target = fn(&[u8]);

/// Every target by its name, which is that of its folder of seeds.
pub const TARGETS: [(&str, Target); 13] = [
    ("compensation", compensation),
    ("config", config),
    ("deframer", deframer),
    ("frame", frame),
    ("greeting", greeting),
    ("kinematics", kinematics),
    ("labcomm", labcomm),
    ("labcomm_json", labcomm_json),
    ("measurements", measurements),
    ("position_loop", position_loop),
    ("session", session),
    ("solve", solve),
    ("steering", steering),
];

/// The input that bytes stand for; none for a few too short ones.
#[must_use]
pub fn input<'a, T: Arbitrary<'a>>(data: &'a [u8]) -> Option<T> {
    T::arbitrary(&mut Unstructured::new(data)).ok()
}
