//! [`gantry_tau_tests::fuzzed::steering`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| gantry_tau_tests::fuzzed::steering(data));
