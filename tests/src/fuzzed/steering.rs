//! The steering of a bus' cycle by any settings, times and delays: shift and phase stay within their
//! bounds, and a reference that goes on steadily is followed.

use gantry_tau_ethercat::steering::{Steering, SteeringConfig, SteeringFault};

/// Bytes of the settings: cycle, time before SYNC0, first pulse, drift in ppm.
pub const SETTINGS: usize = 18;
/// Bytes of a sample: its kind, the time, the delay.
pub const SAMPLE: usize = 17;
/// Largest drift that must be followed, ppm.
const DRIFT_PPM: i64 = 400;
/// Cycles in which a reference must be followed from a right phase.
const CYCLES: u32 = 600;

/// Panics when the steering leaves its bounds, or does not follow.
pub fn steering(data: &[u8]) {
    let Some((settings, samples)) = data.split_at_checked(SETTINGS) else {
        return;
    };
    let config = SteeringConfig {
        cycle_ns: u32::from_le_bytes(field(settings, 0)),
        frame_to_sync0_ns: u32::from_le_bytes(field(settings, 4)),
    };
    let start_ns = u64::from_le_bytes(field(settings, 8));
    any_samples(config, start_ns, samples);
    let drift_ppm = i64::from(i16::from_le_bytes(field(settings, 16))) % (DRIFT_PPM + 1);
    steady_reference(config.frame_to_sync0_ns, start_ns, drift_ppm);
}

fn field<const L: usize>(bytes: &[u8], at: usize) -> [u8; L] {
    bytes
        .get(at..at + L)
        .and_then(|bytes| bytes.try_into().ok())
        .unwrap_or([0; L])
}

/// Bounds that hold for any times and delays.
fn any_samples(config: SteeringConfig, start_ns: u64, samples: &[u8]) {
    let mut steering = Steering::new(config, start_ns);
    let cycle = i64::from(config.cycle_ns.max(1));
    for sample in samples.chunks_exact(SAMPLE) {
        let is_missing = sample.first() == Some(&0);
        let time_ns = (!is_missing).then(|| u64::from_le_bytes(field(sample, 1)));
        let step = steering.step(time_ns, u64::from_le_bytes(field(sample, 9)));
        assert!(step.shift_ns.abs() <= cycle / 1_000, "{step:?}");
        assert_eq!(step.phase_ns.is_some(), time_ns.is_some());
        let phase_ns = step.phase_ns.unwrap_or(0);
        assert!(phase_ns.abs() <= cycle / 2 + 1, "{step:?}");
        if let Some(SteeringFault::Phase { phase_us }) = step.fault {
            assert_eq!(i64::from(phase_us), phase_ns / 1_000);
        }
    }
}

/// A cycle of 1 ms that begins in phase stays there, and never reports a fault.
fn steady_reference(frame_to_sync0_ns: u32, start_ns: u64, drift_ppm: i64) {
    const CYCLE_NS: u32 = 1_000_000;
    let config = SteeringConfig {
        cycle_ns: CYCLE_NS,
        frame_to_sync0_ns: frame_to_sync0_ns % CYCLE_NS,
    };
    let start_ns = start_ns % (1 << 60);
    let mut steering = Steering::new(config, start_ns);
    // Time of the reference, ns; each shift moves the next frame.
    let mut time_ns = start_ns + 3 * u64::from(CYCLE_NS) - u64::from(config.frame_to_sync0_ns);
    assert_eq!(steering.phase(time_ns), 0);
    for cycle in 0..2 * CYCLES {
        let step = steering.step(Some(time_ns), 0);
        assert_eq!(step.fault, None, "{drift_ppm} ppm, cycle {cycle}");
        if cycle > CYCLES {
            assert!(steering.is_locked(), "{drift_ppm} ppm, cycle {cycle}");
            let phase_ns = step.phase_ns.unwrap_or(i64::MAX);
            assert!(
                phase_ns.abs() <= 5_000,
                "{drift_ppm} ppm, cycle {cycle}: {step:?}"
            );
        }
        // A millionth of 1 ms is 1 ns.
        let passed_ns = i64::from(CYCLE_NS) + step.shift_ns + drift_ppm;
        time_ns = time_ns.saturating_add_signed(passed_ns);
    }
}
