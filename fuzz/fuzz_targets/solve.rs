//! [`gantry_tau_tests::fuzzed::solve`].
#![no_main]

use gantry_tau_tests::fuzzed::solve;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| solve(data));
