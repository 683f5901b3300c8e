//! Kani harnesses of the compensation's last step and of the force sensor.

use gantry_tau_core::model::compensation::CompensatorConfig;
use gantry_tau_core::model::load_filter::SectionState;
use gantry_tau_core::model::sensor::{LowPass, SensorConfig, SensorState, Tool};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::{Metres, OffsetNm};

use super::kani;
use crate::properties::compensation::{
    correction_is_bounded, offset_is_within, sensor_check_admits_finite,
};

/// Any configuration, even one that is refused, and any numbers.
fn any_correction_is_bounded<const N: usize>() {
    let config = CompensatorConfig {
        gain: kani::any(),
        limits: kani::any(),
        metres_per_q: kani::any(),
    };
    correction_is_bounded::<N>(&config, &kani::any(), &kani::any());
}

fn any_section() -> SectionState {
    SectionState {
        band: Wrench::from_array(kani::any()),
        low: Wrench::from_array(kani::any()),
    }
}

harnesses! {
    compensation_offset_is_within [minisat] {
        let (metres, limit) = (kani::any(), kani::any());
        offset_is_within(metres, limit);
        let crossed = OffsetNm::from_metres_within(Metres(metres), limit);
        kani::cover!(crossed == Ok((OffsetNm(-7), true)), "some floats are cut");
    }
    compensation_is_bounded [minisat, unwind 5] {
        any_correction_is_bounded::<3>();
        kani::cover!(true, "some correction passes");
    }
    compensation_of_six_is_bounded [minisat, unwind 8] {
        any_correction_is_bounded::<6>();
        kani::cover!(true, "some correction passes");
    }
    sensor_check_is_right [minisat, unwind 10] {
        // The sensor of robots/l2.toml.
        let config = SensorConfig {
            rotation: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]].into(),
            lever_m: [0.0, 0.0, -0.08].into(),
            tool: Tool { weight_n: [0.0, 0.0, -18.0].into(), centre_m: [0.01, 0.0, -0.12].into() },
            low_pass: LowPass::FirstOrder,
            cutoff_hz: 20.0,
            cycle_s: 1e-3,
            tare_samples: 1000,
        };
        let state = SensorState {
            tare_remaining: kani::any(),
            tare: Wrench::from_array(kani::any()),
            filtered: Wrench::from_array(kani::any()),
            sections: [any_section(), any_section(), any_section(), any_section()],
        };
        let admitted = sensor_check_admits_finite(config, state);
        kani::cover!(admitted, "some states are valid");
    }
}
