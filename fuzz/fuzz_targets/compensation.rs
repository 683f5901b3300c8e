//! [`gantry_tau_tests::fuzzed::compensation`].
#![no_main]

use gantry_tau_tests::fuzzed::compensation;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| compensation(data));
