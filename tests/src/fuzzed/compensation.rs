//! Wrenches of any bits, one after the other, through the sensor and both compensations, 3 and 6
//! axes (T12 to T14).

use arbitrary::Arbitrary;
use gantry_tau_core::model::compensation::CompensatorConfig;
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::linalg::rotation_from_vector;
use gantry_tau_core::model::load_filter::{MAX_NOTCHES, Notch};
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::sensor::{ForceSensor, LowPass, Reading, SensorConfig, Tool};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::model::{f1, l2, presets};
use gantry_tau_core::units::OffsetNm;
use gantry_tau_proofs::properties::compensation::{
    correction_is_bounded, cycle_is_bounded, sensor_stays_valid, sensor_takes_good_readings,
};
use gantry_tau_proofs::properties::{kinematics, six_link};
use gantry_tau_proofs::robots;

/// A machine's position, a configuration, and readings of the sensor.
#[derive(Arbitrary, Clone, Debug, PartialEq)]
pub struct Loads {
    /// Gain; in quarters of the largest.
    pub gain: u8,
    /// Cut-off of the sensor, Hz.
    pub cutoff_hz: u16,
    /// Notches, tenths of a hertz, 0 for none, behind a low-pass of second order.
    pub notches: Option<[u16; MAX_NOTCHES]>,
    /// Limits of the offsets, nm.
    pub limits: [i32; 6],
    /// Metres per unit of `q`; of any bits.
    pub scales: [f64; 6],
    /// Distance of the machine from home, in tenths of a millimetre and of a milliradian.
    pub step: [i16; 6],
    /// Positions of any bits, instead.
    pub lost: Option<[f64; 6]>,
    /// Readings of the sensor.
    pub wrenches: Vec<[f64; 6]>,
}

/// [`Loads`].
pub fn compensation(data: &[u8]) {
    if let Some(loads) = super::input(data) {
        three_axes(&loads);
        six_axes(&loads);
    }
}

impl Loads {
    fn config<const N: usize>(&self, scales: [f64; N]) -> CompensatorConfig<N> {
        CompensatorConfig {
            gain: f64::from(self.gain % 8) / 4.0,
            limits: std::array::from_fn(|axis| OffsetNm(self.limits[axis])),
            metres_per_q: scales,
        }
    }

    fn scales<const N: usize>(&self) -> [f64; N] {
        std::array::from_fn(|axis| self.scales[axis])
    }

    fn step(&self, axis: usize) -> f64 {
        f64::from(self.step[axis]) * 1e-4
    }

    fn notches(&self) -> [Option<Notch>; MAX_NOTCHES] {
        self.notches.unwrap_or_default().map(|tenths| {
            let hz = f64::from(tenths.min(4_500)) * 0.1;
            (tenths > 0).then_some(Notch { hz, q: 0.7 })
        })
    }

    /// Loads of the compensation: the readings, raw and as the sensor passes them.
    fn loads(&self) -> Vec<Wrench> {
        let mut sensor = ForceSensor::new(SensorConfig {
            rotation: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]].into(),
            lever_m: [0.02, 0.0, -0.08].into(),
            tool: Tool {
                weight_n: [0.0, 0.0, -49.0].into(),
                centre_m: [0.01, 0.0, -0.12].into(),
            },
            low_pass: if self.notches.is_some() {
                LowPass::SecondOrder
            } else {
                LowPass::FirstOrder
            },
            cutoff_hz: if self.notches.is_some() {
                f64::from(self.cutoff_hz.clamp(1, 450))
            } else {
                f64::from(self.cutoff_hz.max(1))
            },
            cycle_s: 1e-3,
            tare_samples: 1,
        })
        .unwrap();
        let turn = [3, 4, 5].map(|axis| 100.0 * self.step(axis));
        let platform = rotation_from_vector(&turn.into()).unwrap_or_default();
        let mut loads = Vec::new();
        for (number, raw) in self.wrenches.iter().copied().enumerate() {
            let raw = Wrench::from_array(raw);
            // While it is tared, and again when it runs.
            if number < 4 {
                sensor.set_notches(&self.notches()).unwrap();
            }
            sensor_stays_valid(&sensor, &raw, &platform);
            sensor_takes_good_readings(&sensor, &raw, &platform);
            loads.push(raw);
            if let Ok(Reading::Load(load)) = sensor.update(&raw, &platform) {
                loads.push(load);
            }
        }
        loads
    }
}

fn three_axes(loads: &Loads) {
    let (robot, nominal) = robots::l2(robots::l2_geometry()).unwrap();
    let mut tcp = robots::l2_home();
    for (axis, place) in tcp.iter_mut().enumerate() {
        *place += loads.step(axis);
    }
    let at_rest = nominal.inverse(&tcp.into());
    let q = match loads.lost {
        Some([q1, q2, q3, ..]) => [q1, q2, q3],
        None => at_rest.unwrap_or_default(),
    };
    let compliances = presets::l2_compliances();
    let any_scales = loads.config::<3>(loads.scales());
    correction_is_bounded(&any_scales, &q, &at_rest.unwrap_or_default());
    let pose = Pose::at(tcp.into());
    for load in loads.loads() {
        if let Ok(command) = l2::exact_command(&robot, &compliances, &pose, &q, &load) {
            correction_is_bounded(&any_scales, &q, &command.value);
            let finite = command.value.iter().all(|q| q.is_finite());
            assert!(finite && load.is_finite(), "T13: finite");
        }
    }
    for config in [any_scales, loads.config([1.0; 3])] {
        let Ok(compensator) = l2::Compensator::new(&nominal, &compliances, config) else {
            continue;
        };
        for load in loads.loads() {
            cycle_is_bounded(&config, compensator.correct_q(&q, &load), &load);
            cycle_is_bounded(
                &config,
                compensator.correct_exact_at(&pose, &q, &load),
                &load,
            );
            kinematics::statics_are_finite(&robot, &nominal, tcp, q, &load);
        }
    }
}

fn six_axes(loads: &Loads) {
    let kinematics = robots::f1(robots::f1_geometry()).unwrap();
    let (mut place, mut turn) = (robots::f1_home(), [0.0; 3]);
    for axis in 0..3 {
        place[axis] += loads.step(axis);
        turn[axis] += loads.step(axis + 3);
    }
    let Some(rotation) = rotation_from_vector(&turn.into()) else {
        return;
    };
    let pose = Pose {
        position_m: place.into(),
        rotation,
    };
    let at_rest = kinematics.inverse(&pose, None).map(|found| found.value);
    let q = loads.lost.unwrap_or(at_rest.unwrap_or_default());
    let links = *presets::l2_compliances().link_m_per_n();
    let machine = f1::Elastic::new(&kinematics, &Compliances::new(links, [4e-8; 6]).unwrap());
    for config in [loads.config(loads.scales()), loads.config([1.0; 6])] {
        let compensator = f1::Compensator::new(&kinematics, machine.compliances(), config);
        for load in loads.loads() {
            six_link::statics_are_finite(&machine, &pose, &q, &load);
            if let Ok(compensator) = &compensator {
                six_link::cycles_are_bounded(compensator, &pose, &q, &load);
            }
        }
    }
}
