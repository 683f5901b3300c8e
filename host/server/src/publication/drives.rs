//! Sample of the drives' states. (Its place is beside the samples of the machine that
//! `gantry-tau-labcomm` has; drives are the host's.)

use gantry_tau_labcomm::{Sample, structure};

structure! {
    /// States of the drives of `N` axes after a tick.
    pub struct DriveStates<const N: usize> {
        /// Number of the tick.
        pub tick: i64,
        /// Code of the state of each axis' drives: 0 not ready, 1 ready, 2 operating, 3 quick stop,
        /// 4 fault.
        pub state: [u8; N],
    }
}

impl<const N: usize> Sample for DriveStates<N> {
    const NAME: &'static str = "drives";
}
