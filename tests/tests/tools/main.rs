//! Tests that need compilers for C, Valgrind or an emulator: the C interface and the firmware. A test whose tool is missing is reported
//! as ignored, with the name of the tool.

mod capi;
mod firmware;

use libtest_mimic::Arguments;

fn main() {
    let arguments = Arguments::from_args();
    let trials = firmware::trials().into_iter().chain(capi::trials());
    libtest_mimic::run(&arguments, trials.collect()).exit();
}
