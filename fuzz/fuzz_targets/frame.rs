//! [`gantry_tau_tests::fuzzed::frame`].
#![no_main]

use gantry_tau_tests::fuzzed::frame;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| frame(data));
