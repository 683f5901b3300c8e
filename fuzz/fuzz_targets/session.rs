//! [`gantry_tau_tests::fuzzed::session`].
#![no_main]

use gantry_tau_tests::fuzzed::session;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| session(data));
