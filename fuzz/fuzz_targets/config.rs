//! [`gantry_tau_tests::fuzzed::config`].
#![no_main]

use gantry_tau_tests::fuzzed::config;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| config(data));
