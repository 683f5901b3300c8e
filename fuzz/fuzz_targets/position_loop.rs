//! [`gantry_tau_tests::fuzzed::position_loop`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| gantry_tau_tests::fuzzed::position_loop(data));
