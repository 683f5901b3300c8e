//! [`gantry_tau_tests::fuzzed::deframer`].
#![no_main]

use gantry_tau_tests::fuzzed::deframer;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| deframer(data));
