//! [`gantry_tau_tests::fuzzed::kinematics`].
#![no_main]

use gantry_tau_tests::fuzzed::kinematics;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| kinematics(data));
