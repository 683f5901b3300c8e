//! Saved states, resets, and several units at once.

use gantry_tau_fmi::instance::Instance;
use gantry_tau_fmi::kind::Kind;
use gantry_tau_machine::robot_file::AnyRobotFile;
use gantry_tau_sim::load_generator::Load;

use crate::named::{Coupled, Named};

fn l2() -> AnyRobotFile {
    AnyRobotFile::named("l2").unwrap()
}

/// Steps of a unit whose inputs change in every cycle, and its values after each, as bits.
fn run(unit: &mut Named, kind: Kind, from: u32, to: u32) -> Vec<Vec<u64>> {
    (from..to)
        .map(|tick| {
            let force = f64::from(tick % 97) - 40.0;
            match kind {
                Kind::Machine => {
                    unit.set("load_force[1]", force);
                    let offset = f64::from(tick % 50) * 1e-6;
                    let nominal = unit.get("nominal[2]");
                    unit.set("reference[2]", nominal + offset);
                    unit.set("offset[2]", offset);
                }
                Kind::Server | Kind::Compensator => {
                    unit.set("force[1]", force);
                    // Beyond 10 mm the notches of the filter are others.
                    unit.set(
                        "nominal[1]",
                        unit.start("nominal[1]") + f64::from(tick) * 3e-5,
                    );
                }
            }
            unit.step(1);
            unit.bits()
        })
        .collect()
}

#[test]
fn a_restored_unit_does_the_same_again_to_the_bit() {
    for kind in Kind::ALL {
        let mut unit = Named::begun(kind, &l2(), &[]);
        run(&mut unit, kind, 0, 1_500);
        let saved = unit.instance.save();
        let (time, before) = (unit.instance.time(), unit.bits());
        let first = run(&mut unit, kind, 1_500, 2_500);
        assert_ne!(first.last(), Some(&before));
        for _ in 0..2 {
            unit.instance.restore(&saved);
            assert_eq!(unit.instance.time().to_bits(), time.to_bits());
            assert_eq!(unit.bits(), before);
            let again = run(&mut unit, kind, 1_500, 2_500);
            assert!(again == first, "{kind}");
        }
    }
}

#[test]
fn a_copy_of_a_state_moves_nothing_of_the_unit() {
    for kind in Kind::ALL {
        let mut disturbed = Named::begun(kind, &l2(), &[]);
        let mut alone = Named::begun(kind, &l2(), &[]);
        let mut other = Named::begun(kind, &l2(), &[]);
        for tick in 0..1_200 {
            let [left, right] =
                [&mut disturbed, &mut alone].map(|unit| run(unit, kind, tick, tick + 1));
            assert!(left == right, "{kind}, tick {tick}");
            // Another unit, and a restored past of this one.
            run(&mut other, kind, tick * 3, tick * 3 + 1);
            if tick % 400 == 399 {
                let saved = disturbed.instance.save();
                run(&mut disturbed, kind, 5_000, 5_010);
                disturbed.instance.restore(&saved);
            }
        }
    }
}

#[test]
fn a_reset_unit_is_a_new_one() {
    for kind in Kind::ALL {
        let mut unit = Named::begun(kind, &l2(), &[]);
        let first = run(&mut unit, kind, 0, 300);
        unit.instance.reset();
        assert!(unit.instance.get(0).is_err(), "before its initialization");
        unit.instance.setup_experiment(0.0, None).unwrap();
        unit.instance.enter_initialization().unwrap();
        unit.instance.exit_initialization().unwrap();
        assert!(run(&mut unit, kind, 0, 300) == first, "{kind}");
    }
}

#[test]
fn a_long_step_is_many_short_ones_with_the_same_inputs() {
    for kind in Kind::ALL {
        let mut long = Named::begun(kind, &l2(), &[]);
        let mut short = Named::begun(kind, &l2(), &[]);
        for (round, cycles) in [1, 7, 1_000, 250].into_iter().enumerate() {
            for unit in [&mut long, &mut short] {
                let name = match kind {
                    Kind::Machine => "load_force[2]",
                    _ => "force[2]",
                };
                unit.set(name, 10.0 * round as f64);
            }
            long.step(cycles);
            (0..cycles).for_each(|_| short.step(1));
            assert_eq!(long.bits(), short.bits(), "{kind}, {cycles} cycles");
        }
    }
}

/// The notches of a filter follow the machine, in the cycle that needs them.
#[test]
fn the_filter_of_a_place_is_found_in_the_step() {
    let loads = [0.0, 0.1, 0.1].map(|by_m| {
        let mut unit = Named::begun(Kind::Compensator, &l2(), &[]);
        unit.step(1_001);
        let home_m = unit.start("nominal[1]");
        unit.set("nominal[1]", home_m + by_m);
        unit.step(1_000);
        assert_eq!((unit.get("held"), unit.get("tared")), (0.0, 1.0));
        unit.set("force[1]", 100.0);
        (0..30)
            .map(|_| {
                unit.step(1);
                unit.get("load_force[2]")
            })
            .collect::<Vec<_>>()
    });
    // With the same notches they differ by 1e-9, for the platform turns by as little.
    let apart = loads[0]
        .iter()
        .zip(&loads[1])
        .map(|(here, there)| (here - there).abs());
    assert!(
        apart.fold(0.0, f64::max) > 1e-3,
        "another place, another filter"
    );
    assert_eq!(loads[1], loads[2], "nothing depends on a thread");
}

#[test]
fn the_client_obtains_when_it_is_asked_to_and_not_before() {
    let mut coupled = Coupled::new(&l2(), 0.0);
    coupled.server.set("obtain", 0.0);
    let pull = Load {
        force_n: [200.0, 0.0, 0.0],
        ..Load::default()
    };
    coupled.server_step(true);
    steps(&mut coupled, 1_100, true);
    let pulled = |coupled: &mut Coupled, ticks: u32| {
        for _ in 0..ticks {
            coupled.machine_step(&pull);
            coupled.server_step(true);
        }
    };
    pulled(&mut coupled, 500);
    let row = coupled.row();
    assert_eq!(row.phase.name(), "Submit");
    assert!(row.computed_nm[0].abs() > 10_000, "{row:?}");
    assert_eq!(row.offsets_nm, [0; 3]);
    coupled.server.set("obtain", 1.0);
    pulled(&mut coupled, 500);
    let row = coupled.row();
    assert_eq!(row.phase.name(), "Obtain");
    assert!(row.offsets_nm[0].abs() > 10_000, "{row:?}");
    coupled.server.set("obtain", 0.0);
    pulled(&mut coupled, 3_000);
    let row = coupled.row();
    assert_eq!((row.phase.name(), row.offsets_nm), ("Submit", vec![0; 3]));
}

#[test]
fn a_compensator_says_what_it_holds_and_what_it_cuts() {
    let mut unit = Named::begun(Kind::Compensator, &l2(), &[]);
    unit.step(1_001);
    assert!(unit.get("tared") > 0.5);
    assert!(unit.get("held") < 0.5);
    unit.set("force[1]", 30_000.0);
    unit.step(2_000);
    assert!(unit.all("saturated", 3).contains(&1.0));
    let target = unit.all("target", 3);
    let home = unit.start("nominal[1]");
    unit.set("nominal[1]", home + 900.0);
    unit.step(1);
    assert!(unit.get("held") > 0.5);
    assert_eq!(unit.all("target", 3), target, "the last one stands");
    unit.set("nominal[1]", home);
    unit.set("force[1]", 0.0);
    unit.step(3_000);
    assert!(unit.get("held") < 0.5);
    assert_eq!(unit.all("saturated", 3), [0.0; 3]);
}

/// The reset of the machine, and its springs alone.
#[test]
fn a_machine_without_masses_stands_where_its_springs_let_it_at_once() {
    let displaced = |values: &[(&str, f64)], cycles| {
        let mut unit = Named::begun(Kind::Machine, &l2(), values);
        unit.step(10);
        unit.set("load_force[1]", 100.0);
        unit.step(cycles);
        unit.get("displacement[1]")
    };
    let still = displaced(&[("quasi_static", 1.0)], 2);
    assert!(still > 5e-5);
    assert!(displaced(&[], 2) < still / 4.0, "masses");
    assert!((displaced(&[], 20_000) - still).abs() < 1e-6);
}

/// Steps the coupled units.
fn steps(coupled: &mut Coupled, ticks: u32, cable: bool) {
    for _ in 0..ticks {
        coupled.machine_step(&Load::default());
        coupled.server_step(cable);
    }
}

#[test]
fn a_session_goes_on_after_one_lost_frame_and_ends_after_two() {
    let mut coupled = Coupled::new(&l2(), 0.0);
    coupled.server_step(true);
    steps(&mut coupled, 1_100, true);
    let phase = |coupled: &Coupled| coupled.row().phase.name();
    assert_eq!(phase(&coupled), "Obtain");
    for _ in 0..3 {
        steps(&mut coupled, 1, false);
        steps(&mut coupled, 10, true);
    }
    assert_eq!(phase(&coupled), "Obtain");
    assert_eq!(coupled.row().missed, 3);
    steps(&mut coupled, 2, false);
    assert_eq!(phase(&coupled), "SafeDisconnect");
    assert_eq!(coupled.row().cause.name(), "ClientLate");
    steps(&mut coupled, 20, true);
    assert_eq!(coupled.row().phase.name(), "Submit", "the cable was put in");
}

#[test]
fn a_new_session_needs_the_cable_to_be_put_in_and_a_stop_a_rearm() {
    let mut coupled = Coupled::new(&l2(), 0.0);
    coupled.server_step(true);
    steps(&mut coupled, 100, true);
    coupled.server.set("stop", 1.0);
    steps(&mut coupled, 1, true);
    assert_eq!(coupled.row().phase.name(), "Fault");
    assert_eq!(coupled.row().cause.name(), "Stop");
    assert!(coupled.server.get("latched") > 0.5);
    coupled.server.set("stop", 0.0);
    steps(&mut coupled, 50, true);
    assert_eq!(coupled.row().phase.name(), "Fault");
    coupled.server.set("rearm", 1.0);
    steps(&mut coupled, 2, true);
    coupled.server.set("rearm", 0.0);
    steps(&mut coupled, 50, true);
    assert_eq!(coupled.row().phase.name(), "Listening");
    assert!(coupled.server.get("latched") < 0.5);
    let session = coupled.server.get("session");
    steps(&mut coupled, 1, false);
    steps(&mut coupled, 5, true);
    let warnings = coupled.server.instance.take_warnings();
    assert_eq!(coupled.row().phase.name(), "Submit", "{warnings:?}");
    assert!(coupled.server.get("session") > session);
    // A machine that cannot be read stops.
    coupled.server.set("machine_ok", 0.0);
    coupled.server.step(1);
    assert_eq!(coupled.row().phase.name(), "Fault");
}

#[test]
fn an_l2_and_an_f1_have_units_of_their_own() {
    for kind in Kind::ALL {
        let [l2, f1] = ["l2", "f1"].map(|name| {
            let robot = AnyRobotFile::named(name).unwrap();
            Instance::new(kind, robot).unwrap().guid().to_owned()
        });
        assert_ne!(l2, f1);
        assert_eq!(Kind::of_guid(&l2), Ok(kind));
        assert_eq!(Kind::of_guid(&f1), Ok(kind));
    }
    assert!(Kind::of_guid("{8c4e810f-3df3-4a00-8276-176fa3c9f9e0}").is_err());
}
