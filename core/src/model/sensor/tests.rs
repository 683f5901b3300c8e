use super::*;
use crate::model::l2::tests::close;
use crate::model::linalg::rotation_from_vector;

fn config() -> SensorConfig {
    SensorConfig {
        // x of the sensor points along y of the world.
        rotation: Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        lever_m: Vector3::new(0.0, 0.0, -0.08),
        tool: Tool::weightless(),
        low_pass: LowPass::FirstOrder,
        cutoff_hz: 20.0,
        cycle_s: 1e-3,
        tare_samples: 4,
    }
}

fn turned(x: f64, y: f64, z: f64) -> Matrix3<f64> {
    rotation_from_vector(&Vector3::new(x, y, z)).unwrap()
}

/// Reading of the sensor under a load, by transfer of moments in world axes, with a zero error.
fn reading(config: &SensorConfig, rotation: &Matrix3<f64>, load: &Wrench, bias: &Wrench) -> Wrench {
    let centre_m = rotation * config.tool.centre_m;
    let lever_m = rotation * config.lever_m;
    let weight_nm = centre_m.cross(&config.tool.weight_n);
    let force_n = load.force_n + config.tool.weight_n;
    let moment_nm = load.moment_nm + weight_nm - lever_m.cross(&force_n);
    let axes = (rotation * config.rotation).transpose();
    Wrench {
        force_n: axes * force_n + bias.force_n,
        moment_nm: axes * moment_nm + bias.moment_nm,
    }
}

fn settled(sensor: &mut ForceSensor, raw: [f64; 6]) -> [f64; 6] {
    let mut load = Wrench::zero();
    for _ in 0..2000 {
        let reading = sensor
            .update(&Wrench::from_array(raw), &Matrix3::identity())
            .unwrap();
        if let Reading::Load(wrench) = reading {
            load = wrench;
        }
    }
    load.to_array()
}

#[test]
fn tares_turns_and_shifts() {
    let mut sensor = ForceSensor::new(config()).unwrap();
    let bias = [3.0, -2.0, 40.0, 0.5, 0.1, -0.2];
    for (index, noise) in [0.3, -0.3, 0.1, -0.1].into_iter().enumerate() {
        let raw = Wrench::from_array(bias.map(|value| value + noise));
        let reading = sensor.update(&raw, &Matrix3::identity()).unwrap();
        let remaining = u32::try_from(3 - index).unwrap();
        assert_eq!(reading, Reading::Taring { remaining });
    }
    close(&sensor.state().tare.to_array(), &bias, 1e-14, "mean");
    // 100 N along x of the sensor, that is y of the world, 80 mm below the tool centre point:
    // M_x = 0.08 * 100.
    let mut raw = bias;
    raw[0] += 100.0;
    let load = settled(&mut sensor, raw);
    close(&load, &[0.0, 100.0, 0.0, 8.0, 0.0, 0.0], 1e-12, "load");
    // A moment is turned, not shifted.
    let mut raw = bias;
    raw[3] += 5.0;
    let load = settled(&mut sensor, raw);
    close(&load, &[0.0, 0.0, 0.0, 0.0, 5.0, 0.0], 1e-12, "moment");
    sensor.restart_tare();
    assert_eq!(sensor, ForceSensor::new(config()).unwrap());
}

#[test]
fn the_load_is_the_same_however_the_platform_is_turned() {
    let tool = Tool {
        weight_n: Vector3::new(0.5, -1.0, -49.0),
        centre_m: Vector3::new(0.03, -0.02, -0.2),
    };
    // Nearly no filter, so that one sample is enough.
    let config = SensorConfig {
        tool,
        cutoff_hz: 1e5,
        cycle_s: 10.0,
        ..config()
    };
    let bias = Wrench::from_array([3.0, -2.0, 40.0, 0.5, 0.1, -0.2]);
    let poses = [
        turned(0.0, 0.0, 0.0),
        turned(0.3, 0.0, 0.0),
        turned(0.3, -0.3, 0.1),
        turned(-1.0, 2.0, 0.5),
    ];
    let loads = [
        Wrench::zero(),
        Wrench::from_array([300.0, -100.0, 50.0, 4.0, -8.0, 15.0]),
    ];
    let mut sensor = ForceSensor::new(config).unwrap();
    // The tare may even be taken while the platform turns.
    for pose in &poses {
        sensor
            .update(&reading(&config, pose, &Wrench::zero(), &bias), pose)
            .unwrap();
    }
    close(
        &sensor.state().tare.to_array(),
        &bias.to_array(),
        1e-12,
        "bias",
    );
    for (pose, load) in poses.iter().flat_map(|pose| loads.map(|load| (pose, load))) {
        let raw = reading(&config, pose, &load, &bias);
        let Reading::Load(found) = sensor.update(&raw, pose).unwrap() else {
            panic!("still taring")
        };
        // The filter keeps 2e-7 of the load before.
        let off = (found.force_n - load.force_n)
            .amax()
            .max((found.moment_nm - load.moment_nm).amax());
        assert!(off < 1e-4, "{found:?} {load:?}");
    }
}

#[test]
fn what_is_no_rotation_is_refused() {
    let mut sensor = ForceSensor::new(config()).unwrap();
    let before = sensor;
    let mirrored = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    for wrong in [
        mirrored,
        Matrix3::identity() * 1.001,
        Matrix3::zeros(),
        Matrix3::repeat(f64::NAN),
    ] {
        assert_eq!(
            sensor.update(&Wrench::zero(), &wrong),
            Err(SensorError::PlatformNotRotation)
        );
        assert_eq!(sensor, before);
    }
}

#[test]
fn the_low_pass_has_its_time_constant_and_never_overshoots() {
    for cutoff_hz in [1e-3, 1.0, 20.0, 500.0, 1e5] {
        let mut sensor = ForceSensor::new(SensorConfig {
            cutoff_hz,
            tare_samples: 1,
            ..config()
        })
        .unwrap();
        assert!(matches!(sensor.filter, Filter::FirstOrder(share) if share > 0.0 && share < 1.0));
        sensor
            .update(&Wrench::zero(), &Matrix3::identity())
            .unwrap();
        let step = Wrench::from_array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        let mut last = 0.0;
        for k in 1..2000 {
            let Reading::Load(load) = sensor.update(&step, &Matrix3::identity()).unwrap() else {
                panic!("still taring");
            };
            assert!(load.force_n.z >= last && load.force_n.z <= 1.0 + 1e-12);
            last = load.force_n.z;
            let time_constants = f64::from(k) * 1e-3 * core::f64::consts::TAU * cutoff_hz;
            if cutoff_hz <= 1.0 && (time_constants - 1.0).abs() < 0.004 {
                assert!((last - 0.632).abs() < 0.005, "{last}");
            }
        }
    }
}

fn of_second_order(cutoff_hz: f64, notches: &[Notch]) -> ForceSensor {
    let mut sensor = ForceSensor::new(SensorConfig {
        rotation: Matrix3::identity(),
        lever_m: Vector3::zeros(),
        low_pass: LowPass::SecondOrder,
        cutoff_hz,
        tare_samples: 1,
        ..config()
    })
    .unwrap();
    sensor
        .set_notches(&core::array::from_fn(|place| notches.get(place).copied()))
        .unwrap();
    let reading = sensor.update(&Wrench::zero(), &Matrix3::identity());
    assert_eq!(reading, Ok(Reading::Taring { remaining: 0 }));
    sensor
}

/// Load in z after a sample.
fn next(sensor: &mut ForceSensor, force_n: f64) -> f64 {
    let raw = Wrench::from_array([0.0, 0.0, force_n, 0.0, 0.0, 0.0]);
    let Ok(Reading::Load(load)) = sensor.update(&raw, &Matrix3::identity()) else {
        panic!("no load");
    };
    load.force_n.z
}

/// Amplitude of the load under a sine of 1 N, after a second.
fn amplitude(sensor: &mut ForceSensor, hz: f64) -> f64 {
    let mut most: f64 = 0.0;
    for sample in 0..4000 {
        let turn = core::f64::consts::TAU * hz * f64::from(sample) * 1e-3;
        let load = next(sensor, crate::model::linalg::sin(turn));
        if sample >= 1000 {
            most = most.max(load.abs());
        }
    }
    most
}

/// 1 / sqrt(2) at its corner, 40 dB per decade, one at rest.
#[test]
fn the_second_order_is_butterworth() {
    let sensor = || of_second_order(6.0, &[]);
    assert!((amplitude(&mut sensor(), 6.0) - core::f64::consts::FRAC_1_SQRT_2).abs() < 1e-3);
    assert!((amplitude(&mut sensor(), 60.0) - 0.01).abs() < 1e-3);
    let mut stepped = sensor();
    let settled = (0..1000).map(|_| next(&mut stepped, 5.0)).last();
    assert!((settled.unwrap() - 5.0).abs() < 1e-9);
}

#[test]
fn a_notch_takes_its_frequency_out_and_leaves_the_mean() {
    let notch = Notch { hz: 20.0, q: 0.7 };
    let sensor = || of_second_order(450.0, &[notch]);
    assert!(amplitude(&mut sensor(), 20.0) < 1e-3);
    assert!((amplitude(&mut sensor(), 0.5) - 1.0).abs() < 0.01);
    assert!((amplitude(&mut sensor(), 200.0) - 1.0).abs() < 0.1);
}

/// A load that is at rest stays so while notches come, move and go, and none of them makes a
/// step.
#[test]
fn notches_glide() {
    let mut sensor = of_second_order(6.0, &[]);
    for _ in 0..1000 {
        next(&mut sensor, 300.0);
    }
    let notch = |hz| Some(Notch { hz, q: 0.7 });
    for notches in [
        [notch(20.7), None, notch(47.6)],
        [notch(8.0), notch(9.0), None],
        [None; MAX_NOTCHES],
    ] {
        sensor.set_notches(&notches).unwrap();
        for _ in 0..200 {
            let load = next(&mut sensor, 300.0);
            assert!((load - 300.0).abs() < 1e-6, "{load}");
        }
    }
    // Under a load that swings the output moves on without a jump.
    let mut last = 300.0;
    for sample in 0..2000 {
        if sample % 500 == 100 {
            let hz = 5.0 + f64::from(sample) * 0.02;
            sensor
                .set_notches(&[notch(hz), notch(3.0 * hz), None])
                .unwrap();
        }
        let turn = core::f64::consts::TAU * 3.0 * f64::from(sample) * 1e-3;
        let load = next(&mut sensor, 300.0 + 50.0 * crate::model::linalg::sin(turn));
        // 50 N at 3 Hz change by 0.94 N per ms.
        assert!((load - last).abs() < 2.0, "{sample}: {last} {load}");
        last = load;
    }
}

/// A notch that is set while the sensor is tared is there at once; one that is set later comes.
#[test]
fn notches_glide_only_after_the_tare() {
    let notches = [Some(Notch { hz: 20.7, q: 0.7 }), None, None];
    let mut whole = of_second_order(6.0, &[]);
    whole.restart_tare();
    whole.set_notches(&notches).unwrap();
    let mut given = of_second_order(6.0, &[Notch { hz: 20.7, q: 0.7 }]);
    given.restart_tare();
    let mut late = of_second_order(6.0, &[]);
    late.restart_tare();
    while late.state().tare_remaining > 0 {
        for sensor in [&mut whole, &mut given, &mut late] {
            let still = Wrench::zero();
            sensor.update(&still, &Matrix3::identity()).unwrap();
        }
    }
    late.set_notches(&notches).unwrap();
    let [whole, given, late] =
        [&mut whole, &mut given, &mut late].map(|sensor| next(sensor, 300.0));
    assert_eq!(whole.to_bits(), given.to_bits());
    assert!((late - given).abs() > 1e-3, "{late} {given}");
}

/// The energy of the integrators of a resonant notch never grows without input, however its
/// frequency moves.
#[test]
fn moving_notches_do_not_pump() {
    let mut sensor = of_second_order(450.0, &[Notch { hz: 20.0, q: 10.0 }]);
    for _ in 0..3 {
        next(&mut sensor, 1000.0);
    }
    let energy = |sensor: &ForceSensor| {
        let section = sensor.state().sections[1];
        section.band.force_n.norm_squared() + section.low.force_n.norm_squared()
    };
    let (mut low_pass, mut before) = (f64::MAX, energy(&sensor));
    for sample in 0..5000_u32 {
        if sample % 7 == 0 {
            let hz = if sample % 2 == 0 { 15.0 } else { 25.0 };
            sensor
                .set_notches(&[Some(Notch { hz, q: 10.0 }), None, None])
                .unwrap();
        }
        next(&mut sensor, 0.0);
        let now = energy(&sensor);
        // Until the low-pass is empty.
        assert!(low_pass > 1e-9 || now <= before * (1.0 + 1e-12), "{sample}");
        low_pass = crate::model::linalg::norm(&sensor.state().sections[0].low.force_n);
        before = now;
    }
    assert!(before < 1e-3, "{before}");
}

#[test]
fn notches_out_of_range_are_refused_and_change_nothing() {
    let mut sensor = of_second_order(6.0, &[Notch { hz: 20.0, q: 0.7 }]);
    let before = sensor;
    for (hz, q, parameter) in [
        (f64::NAN, 0.7, "notch.hz"),
        (0.0, 0.7, "notch.hz"),
        (451.0, 0.7, "notch.hz"),
        (20.0, 0.0, "notch.q"),
        (20.0, f64::INFINITY, "notch.q"),
    ] {
        let refused = sensor.set_notches(&[None, Some(Notch { hz, q }), None]);
        assert!(
            matches!(refused, Err(SensorError::OutOfRange { parameter: named, .. }) if named == parameter),
            "{refused:?}"
        );
        assert_eq!(sensor, before);
    }
    let mut first_order = ForceSensor::new(config()).unwrap();
    let notch = Some(Notch { hz: 20.0, q: 0.7 });
    assert!(first_order.set_notches(&[notch, None, None]).is_err());
    assert_eq!(first_order.set_notches(&[None; MAX_NOTCHES]), Ok(()));
    let too_high = SensorConfig {
        low_pass: LowPass::SecondOrder,
        cutoff_hz: 451.0,
        ..config()
    };
    assert!(ForceSensor::new(too_high).is_err());
}

#[test]
fn configurations_are_refused_by_name() {
    let lever_m = Vector3::new(0.0, f64::NAN, 0.0);
    let heavy = Tool {
        weight_n: Vector3::new(0.0, 0.0, -1.1e5),
        ..Tool::weightless()
    };
    let far = Tool {
        centre_m: Vector3::new(11.0, 0.0, 0.0),
        ..Tool::weightless()
    };
    let one_each = [
        (
            SensorConfig {
                lever_m,
                ..config()
            },
            "lever_m",
        ),
        (
            SensorConfig {
                tool: heavy,
                ..config()
            },
            "tool.weight_n",
        ),
        (
            SensorConfig {
                tool: far,
                ..config()
            },
            "tool.centre_m",
        ),
        (
            SensorConfig {
                tare_samples: 0,
                ..config()
            },
            "tare_samples",
        ),
    ];
    let wild = [f64::NAN, f64::INFINITY, -1.0, 0.0].map(|bad| {
        let cutoff = (
            SensorConfig {
                cutoff_hz: bad,
                ..config()
            },
            "cutoff_hz",
        );
        [
            cutoff,
            (
                SensorConfig {
                    cycle_s: bad,
                    ..config()
                },
                "cycle_s",
            ),
        ]
    });
    for (wrong, name) in one_each.into_iter().chain(wild.into_iter().flatten()) {
        let refused = ForceSensor::new(wrong);
        let named =
            matches!(refused, Err(SensorError::OutOfRange { parameter, .. }) if parameter == name);
        assert!(named, "{name}: {refused:?}");
    }
    let rotation = config().rotation * 1.001;
    assert_eq!(
        ForceSensor::new(SensorConfig {
            rotation,
            ..config()
        }),
        Err(SensorError::NotRotation)
    );
    for (remaining, value) in [(5, 0.0), (0, 1.0e7), (4, 1.0), (0, f64::NAN)] {
        let mut state = *ForceSensor::new(config()).unwrap().state();
        state.tare_remaining = remaining;
        state.tare.force_n.x = value;
        let refused = ForceSensor::from_parts(config(), state);
        assert_eq!(refused, Err(SensorError::InvalidState));
    }
}
