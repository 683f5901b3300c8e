//! The compensation and the force sensor: T14.

use gantry_tau_core::model::compensation::{CompensatorConfig, Correction};
use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::nalgebra::Matrix3;
use gantry_tau_core::model::sensor::{
    ForceSensor, MAX_READING, Reading, SensorConfig, SensorError, SensorState,
};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::{Metres, OffsetNm};
use gantry_tau_core::verification::model::bounded;

/// T14, for one axis: for any float, the offset is within the limit or the float was NaN.
pub fn offset_is_within(metres: f64, limit: OffsetNm) {
    match OffsetNm::from_metres_within(Metres(metres), limit) {
        Ok((offset, cut)) => {
            is_within(offset, limit);
            let at_limit = offset.0.abs() == limit.0.max(0);
            assert!(at_limit || !cut, "T14: what is cut is at the limit");
            let same_side = offset.0 == 0 || (offset.0 > 0) == (metres > 0.0);
            assert!(same_side, "T14: on the side that was asked for");
        }
        Err(_) => assert!(metres.is_nan(), "T14: only NaN is refused"),
    }
}

/// T14, for the last step of every correction: any numbers, any configuration.
pub fn correction_is_bounded<const N: usize>(
    config: &CompensatorConfig<N>,
    q: &[f64; N],
    command: &[f64; N],
) {
    if let Ok(correction) = bounded(config, q, command) {
        offsets_are_within(&correction, config);
    }
}

/// T14, for a whole cycle of any compensator: its result under this load. Tested.
pub fn cycle_is_bounded<const N: usize>(
    config: &CompensatorConfig<N>,
    answer: Result<Correction<N>, KinematicsError>,
    load: &Wrench,
) {
    if let Ok(correction) = answer {
        offsets_are_within(&correction, config);
        assert!(
            load.is_finite(),
            "T14: no correction of a load that is not finite"
        );
    }
}

fn offsets_are_within<const N: usize>(correction: &Correction<N>, config: &CompensatorConfig<N>) {
    for axis in 0..N {
        is_within(correction.offsets[axis], config.limits[axis]);
    }
}

fn is_within(offset: OffsetNm, limit: OffsetNm) {
    assert!(
        offset.0.unsigned_abs() <= limit.0.max(0).unsigned_abs(),
        "T14: within the limit"
    );
}

/// T14, for the load the compensation is fed: the check that every state of the sensor passes
/// before it is kept admits finite numbers only. Returns true if it admitted these.
pub fn sensor_check_admits_finite(config: SensorConfig, state: SensorState) -> bool {
    let sensor = ForceSensor::from_parts(config, state);
    if let Ok(sensor) = &sensor {
        let state = sensor.state();
        assert!(state.filtered.is_finite(), "T14: a load is finite");
        assert!(state.tare.is_finite(), "T14: a tare is finite");
        for section in &state.sections {
            let is_finite = section.band.is_finite() && section.low.is_finite();
            assert!(is_finite, "T14: a filter is finite");
        }
        assert!(
            state.tare_remaining <= config.tare_samples,
            "T14: no more samples to go than there are"
        );
    }
    sensor.is_ok()
}

/// T14, for the load the compensation is fed: valid, and any reading, one update, valid; a load is
/// finite; an error changes nothing. Tested.
pub fn sensor_stays_valid(before: &ForceSensor, raw: &Wrench, platform: &Matrix3<f64>) {
    let mut after = *before;
    let reading = after.update(raw, platform);
    assert!(after.is_valid(), "T14: the sensor stays valid");
    match reading {
        Ok(Reading::Load(load)) => assert!(load.is_finite(), "T14: a load is finite"),
        Ok(Reading::Taring { remaining }) => {
            assert!(
                remaining.checked_add(1) == Some(before.state().tare_remaining),
                "T14: one sample less to go"
            );
        }
        Err(_) => assert!(
            after.state() == before.state(),
            "T14: a bad reading changes nothing"
        ),
    }
}

/// A reading within its range is never refused by a valid sensor, however the platform is turned.
/// Tested.
pub fn sensor_takes_good_readings(before: &ForceSensor, raw: &Wrench, platform: &Matrix3<f64>) {
    let good = raw
        .to_array()
        .iter()
        .all(|value| value.abs() <= MAX_READING);
    let mut after = *before;
    assert!(
        good == (after.update(raw, platform) != Err(SensorError::BadReading)),
        "T14: refused for its own sake only"
    );
}
