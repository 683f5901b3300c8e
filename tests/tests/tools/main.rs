//! Tests that need compilers for C, Valgrind, an emulator, Python, engines of rigid bodies, Wine,
//! LinuxCNC, a browser, the reader of MCAP, another MainDevice of EtherCAT, systemd, Debian's tools or
//! Coq: the C interface, the firmware, the client in Python and on Windows, what `solve` says of
//! machines with masses, the units of FMI, the modules for LinuxCNC, the page of the monitor, recordings, the EtherCAT
//! bus, the service, the package, the composition of the proofs. A test whose tool is missing is
//! reported as ignored, with the name of the tool.

mod capi;
mod composition;
mod engines;
#[cfg(target_os = "linux")]
mod ethercat;
mod firmware;
mod fmi;
#[cfg(target_os = "linux")]
mod linuxcnc;
mod mcap;
mod monitor;
mod needing;
#[cfg(target_os = "linux")]
mod package;
mod python;
mod python_packages;
#[cfg(target_os = "linux")]
mod service;
mod session;
mod windows;

use libtest_mimic::Arguments;

fn main() {
    let mut arguments = Arguments::from_args();
    // As Rust's own harness.
    let threads = std::env::var("RUST_TEST_THREADS").ok();
    arguments.test_threads = arguments
        .test_threads
        .or(threads.and_then(|threads| threads.parse().ok()));
    let mut trials = firmware::trials();
    trials.extend(capi::trials());
    trials.extend(composition::trials());
    trials.extend(engines::trials());
    trials.extend(fmi::trials());
    trials.extend(mcap::trials());
    trials.extend(monitor::trials());
    trials.extend(python::trials());
    trials.extend(windows::trials());
    #[cfg(target_os = "linux")]
    trials.extend(linuxcnc::trials());
    #[cfg(target_os = "linux")]
    trials.extend(ethercat::trials());
    #[cfg(target_os = "linux")]
    trials.extend(service::trials());
    #[cfg(target_os = "linux")]
    trials.extend(package::trials());
    let conclusion = libtest_mimic::run(&arguments, trials);
    #[cfg(target_os = "linux")]
    linuxcnc::remove_folder();
    conclusion.exit();
}
