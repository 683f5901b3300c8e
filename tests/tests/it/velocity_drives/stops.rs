//! Stops of a machine in motion, and the way that each takes:
//! `M x watchdog + M^2 / (2 quick stop)`, and a millimetre.

use gantry_tau_core::control::message::Cause;
use gantry_tau_record::black_box::loops as loops_file;
use gantry_tau_server::record::EventKind;
use gantry_tau_server::server::event_log::EventLog;
use gantry_tau_sim::load_generator::Load;

use super::*;

/// Longest way of a stop, mm: 3 cycles at the velocity limit, its ramp of 10 m/s^2, and 1 mm.
const MAX_MM: f64 = MAX_M_PER_S * 3.0 + MAX_M_PER_S * MAX_M_PER_S / (2.0 * 10.0) * 1e3 + 1.0;
/// The same from the 0.5 m/s of the path.
const FROM_PATH_MM: f64 = 0.5 * 3.0 + 0.5 * 0.5 / (2.0 * 10.0) * 1e3 + 1.0;

/// Ticks until the machine has stood for 20 of them; returns the rows.
fn until_rest(server: &mut Server, operator: OperatorInputs) -> Vec<TickRecord<N>> {
    let (mut rows, mut still, mut before) = (Vec::new(), 0, server.positions_m());
    while still < 20 {
        rows.push(server.step(operator));
        let now = server.positions_m();
        still = if farthest_mm(&before, &now) < 1e-4 {
            still + 1
        } else {
            0
        };
        before = now;
        assert!(
            rows.len() < 2_000,
            "it does not come to rest: {:?}",
            rows.last()
        );
    }
    rows
}

/// Re-arms until the server listens. Returns the rows.
fn rearm(server: &mut Server) -> Vec<TickRecord<N>> {
    server.tick();
    let mut rows = Vec::new();
    for _ in 0..20_000 {
        rows.push(server.step(OperatorInputs {
            stop: false,
            rearm: true,
            ..OperatorInputs::default()
        }));
        if rows.last().unwrap().state.phase == Phase::Listening {
            return rows;
        }
    }
    panic!("not re-armed: {:?}", rows.last());
}

/// It follows its path again, from where it stands, and no reference and no axis makes a step.
/// Returns its way, mm.
fn goes_on(server: &mut Server) -> f64 {
    let stood_m = server.positions_m();
    let (mut last, mut before_m, mut way_mm) = (server.tick(), stood_m, 0.0_f64);
    for _ in 0..8_000 {
        let row = server.tick();
        assert!(
            !row.plant_failed && row.state.phase == Phase::Listening,
            "{row:?}"
        );
        for (now, last) in row.references.iter().zip(&last.references) {
            assert!((now.position.0 - last.position.0).abs() <= 500_002);
        }
        let now_m = server.positions_m();
        assert!(farthest_mm(&before_m, &now_m) < 0.51);
        way_mm = way_mm.max(farthest_mm(&stood_m, &now_m));
        (last, before_m) = (row, now_m);
    }
    way_mm
}

#[test]
fn a_stop_brakes_the_axes_and_a_rearm_goes_on_from_there() {
    for with_session in [false, true] {
        let mut server = Server::moving();
        let mut client = with_session.then(|| server.client());
        if let Some(client) = &mut client {
            for _ in 0..300 {
                server.answered(client, Mode::Submit, 0);
            }
            for _ in 0..200 {
                server.answered(client, Mode::Obtain, 100_000);
            }
        }
        for _ in 0..2 {
            if client.is_none() {
                server.at_full_speed();
            }
            let from_m = server.positions_m();
            let first = server.step(OperatorInputs {
                stop: true,
                rearm: false,
                ..OperatorInputs::default()
            });
            assert_eq!(
                (first.state.phase, first.ended),
                (Phase::Fault, Some(Cause::Stop))
            );
            let rows = until_rest(
                &mut server,
                OperatorInputs {
                    stop: true,
                    rearm: false,
                    ..OperatorInputs::default()
                },
            );
            let way_mm = farthest_mm(&from_m, &server.positions_m());
            assert!(
                way_mm < FROM_PATH_MM && (client.is_some() || way_mm > 10.0),
                "{way_mm} mm"
            );
            // Asked for: nothing has failed.
            assert!(
                rows.iter()
                    .all(|row| row.state.phase == Phase::Fault && !row.plant_failed)
            );
            let last = rows.last().unwrap();
            assert!(
                last.state
                    .axes
                    .iter()
                    .all(|axis| axis.offsets.position.0 == 0),
                "{last:?}"
            );
            // A stop that is held holds.
            for _ in 0..50 {
                assert_eq!(
                    server
                        .step(OperatorInputs {
                            stop: true,
                            rearm: true,
                            ..OperatorInputs::default()
                        })
                        .state
                        .phase,
                    Phase::Fault
                );
            }
            rearm(&mut server);
            client = None;
            assert!(goes_on(&mut server) > 100.0);
        }
    }
}

#[test]
fn a_killed_server_leaves_the_axes_to_the_watchdog() {
    let mut server = Server::moving();
    server.at_full_speed();
    let (bus, from_m) = (server.bus.clone(), server.positions_m());
    drop(server.cycle);
    let mut failed = None;
    for cycle in 0..200 {
        if bus.machine().read(1).is_err() {
            failed = failed.or(Some(cycle));
        }
    }
    let way_mm = farthest_mm(&from_m, &bus.machine().positions_m());
    // A cycle of latency runs before the watchdog's three.
    assert!(way_mm < FROM_PATH_MM && way_mm > 12.0, "{way_mm} mm");
    assert_eq!(failed, Some(3), "three cycles without data");
    assert_eq!(bus.machine().drives(), Some([DriveState::Fault; N]));
}

#[test]
fn a_lost_bus_stops_and_comes_back_without_a_step() {
    let mut server = Server::moving();
    server.at_full_speed();
    let from_m = server.positions_m();
    server.bus.is_lost.store(true, Ordering::Relaxed);
    let mut rows = until_rest(&mut server, OperatorInputs::default());
    let way_mm = farthest_mm(&from_m, &server.positions_m());
    assert!(way_mm < FROM_PATH_MM, "{way_mm} mm");
    assert_eq!(
        (rows[0].state.phase, rows[0].ended),
        (Phase::Fault, Some(Cause::Stop)),
        "as with positions"
    );
    // For ten seconds.
    rows.extend((0..10_000).map(|_| server.tick()));
    let rest_m = server.positions_m();
    server.bus.is_lost.store(false, Ordering::Relaxed);
    rows.extend((0..500).map(|_| server.tick()));
    assert!(
        farthest_mm(&rest_m, &server.positions_m()) < 0.001,
        "nothing moves without a re-arm"
    );
    let mut log = EventLog::default();
    let logged: Vec<_> = rows
        .iter()
        .flat_map(|row| log.see(row))
        .filter(|e| e.kind == EventKind::MachineFailed)
        .collect();
    assert_eq!(logged.len(), 1, "{logged:?}");
    assert!(
        logged[0].text.contains("the bus is lost"),
        "{}",
        logged[0].text
    );
    rearm(&mut server);
    assert!(goes_on(&mut server) > 100.0);
}

/// The client's cable: the session ends as with positions, and the path goes on.
#[test]
fn a_pulled_cable_ramps_the_offsets_and_the_path_goes_on() {
    let mut server = Server::moving();
    let mut client = server.client();
    for _ in 0..10 {
        server.answered(&mut client, Mode::Submit, 0);
    }
    for _ in 0..1_000 {
        server.answered(&mut client, Mode::Obtain, 50_000);
    }
    let rows: Vec<_> = (0..600).map(|_| server.tick()).collect();
    assert_eq!(rows[0].state.phase, Phase::Obtain, "one miss is tolerated");
    assert_eq!(
        (rows[1].state.phase, rows[1].ended.is_some()),
        (Phase::SafeDisconnect, true)
    );
    let offsets = rows
        .iter()
        .map(|row| row.state.axes[0].offsets.position.0)
        .collect::<Vec<_>>();
    for pair in offsets[1..].windows(2) {
        assert_eq!(pair[0] - pair[1], pair[0].min(100));
    }
    assert_eq!(rows.last().unwrap().state.phase, Phase::Listening);
    assert!(rows.iter().all(|row| !row.plant_failed));
}

/// A load beyond the drives' torque: the loop trips, and brakes along its own ramp.
#[test]
fn an_overload_trips_the_loop_and_only_a_rearm_brings_it_back() {
    let (axis, rows, failed) = an_overload_trips(3_150.0, "the following error of a position loop");
    let offs = rows[..=failed].iter().rev().map(|row| {
        (row.references[axis].position.0 - row.state.axes[axis].actual.position.0).abs()
    });
    let outside = offs.take_while(|off| *off > 2_000_000).count();
    assert_eq!(outside, 10, "in the tenth tick outside the window");
}

/// One that moves the cart faster than the loop may answer is seen before the cart has left the
/// window for as long.
#[test]
fn an_overload_beyond_the_limits_trips_the_loop_before() {
    let (_, _, failed) = an_overload_trips(4_000.0, "the limits of a position loop");
    assert!(failed < 20, "{failed}");
}

/// Returns the axis that a load of so many newtons moves, the ticks from its beginning, and the
/// place of the one that trips for this reason.
fn an_overload_trips(load_n: f64, expected: &str) -> (usize, Vec<TickRecord<N>>, usize) {
    let mut server = Server::on(
        &robot("command_delay_cycles = 0\nactual_delay_cycles = 0"),
        0.0,
    );
    server
        .hand
        .set(&Load {
            step: 1,
            force_n: [100.0, 0.0, 0.0],
            moment_nm: [0.0; 3],
        })
        .unwrap();
    let settled = (0..200).map(|_| server.tick()).last().unwrap();
    let (axis, torque) = settled
        .state
        .axes
        .iter()
        .map(|axis| f64::from(axis.actual.torque.0).abs())
        .enumerate()
        .max_by(|one, other| one.1.total_cmp(&other.1))
        .unwrap();
    let overload = 100.0 * load_n / torque;
    server
        .hand
        .set(&Load {
            step: 1,
            force_n: [overload, 0.0, 0.0],
            moment_nm: [0.0; 3],
        })
        .unwrap();
    let rows: Vec<_> = (0..100).map(|_| server.tick()).collect();
    server.hand.release();
    let failed = rows.iter().position(|row| row.plant_failed).unwrap();
    let reason = rows[failed].failure.unwrap().to_string();
    assert!(reason.contains(expected), "{reason}");
    assert!(
        rows[failed + 1..]
            .iter()
            .all(|row| row.state.phase == Phase::Fault)
    );
    until_rest(&mut server, OperatorInputs::default());
    assert_eq!(
        server.bus.machine().drives(),
        Some([DriveState::Operating; N]),
        "the drives know nothing of it"
    );
    rearm(&mut server);
    // Back to where the path holds.
    assert!((1.0..100.0).contains(&goes_on(&mut server)));
    (axis, rows, failed)
}

#[test]
fn the_way_of_a_stop_is_within_the_travel_that_the_file_must_leave() {
    let robot = robot("");
    let server = Server::on(&robot, 0.0);
    let own = server.bus.quick_stop().unwrap();
    assert!((own.stopping_distance_m(MAX_M_PER_S) * 1e3 + 1.0 - MAX_MM).abs() < 1e-9);
    for limits in &robot.limits {
        let margin = limits.machine_travel.upper.0 - limits.nominal_travel.upper.0;
        assert!(f64::from(i32::try_from(margin).unwrap()) * 1e-6 > MAX_MM);
    }
}

/// The box of the loops has the ticks of the session's, and both replay bit for bit; an edited
/// digit is found.
#[test]
fn the_black_box_of_a_stop_replays() {
    use gantry_tau_core::control::session::replay;
    use gantry_tau_server::black_box::swap_channel;

    let mut server = Server::moving();
    let (sender, mut windows) = swap_channel::channel();
    server.cycle = server.cycle.with_black_box(sender);
    server.at_full_speed();
    server.step(OperatorInputs {
        stop: true,
        rearm: false,
        ..OperatorInputs::default()
    });
    until_rest(&mut server, OperatorInputs::default());
    for _ in 0..100 {
        server.tick();
    }
    let window = windows.receive().unwrap();
    assert_eq!(
        replay(&window.before, &window.entries).agreeing,
        window.entries.len()
    );
    let loops = window.loops.clone().unwrap();
    assert_eq!(loops.ticks.len(), window.entries.len());
    for (tick, entry) in loops.ticks.iter().zip(&window.entries) {
        assert_eq!(
            tick.input.axes.map(|axis| axis.reference),
            entry.output.references
        );
        let read = entry.input.tick.reading.unwrap();
        assert_eq!(
            tick.input.axes.map(|axis| axis.actual),
            read.actual.map(|axis| Some(axis.position))
        );
    }
    assert_eq!(loops.replay(), (loops.ticks.len(), None));
    let moved = loops
        .ticks
        .iter()
        .filter(|tick| tick.output[0].velocity.0 > 400_000)
        .count();
    let stopped = loops
        .ticks
        .iter()
        .filter(|tick| tick.output[0].velocity.0 == 0)
        .count();
    assert!(moved > 10 && stopped > 10, "{moved}, {stopped}");

    let text = loops_file::encode(&loops);
    assert_eq!(loops_file::decode("x", text.as_bytes()), Ok(loops.clone()));
    assert!(
        window.file_name().ends_with("-Stop.jsonl"),
        "{}",
        window.file_name()
    );
    let mut edited = loops.clone();
    edited.ticks[40].input.axes[1].reference.position.0 += 1_000;
    let (agreeing, differing) = edited.replay();
    assert!(
        (40..45).contains(&agreeing) && differing.is_some(),
        "{agreeing}"
    );
    for (from, to, reason) in [
        (
            "\"version\":1",
            "\"version\":2",
            "x, line 1: version is 2; this program reads version 1",
        ),
        (
            "position loops",
            "posts",
            "x, line 1: this is not a black box of position loops",
        ),
        (
            "\"axes\":3",
            "\"axes\":6",
            "x, line 1: axes is 6, expected 3",
        ),
        (
            "\"outside\":0,",
            "\"outside\":10,",
            "x, line 2: the state of the position loops",
        ),
        ("\"accepted\":true,", "", "x, line 3"),
    ] {
        let error = loops_file::decode::<N>("x", text.replacen(from, to, 1).as_bytes())
            .unwrap_err()
            .to_string();
        assert!(error.starts_with(reason), "{error}");
    }
}

/// A reference that is not where its axis is: the loops do not take it up, and say so.
#[test]
fn a_rearm_away_from_the_axis_moves_nothing_and_names_the_reason() {
    for misread in [Misread::Wrong, Misread::Swapped, Misread::Stale] {
        for of_actual in [false, true] {
            let mut server = Server::moving();
            server.at_full_speed();
            server.step(OperatorInputs {
                stop: true,
                rearm: false,
                ..OperatorInputs::default()
            });
            until_rest(&mut server, OperatorInputs::default());
            let place = if of_actual {
                &server.bus.actual_misread
            } else {
                &server.bus.in_force_misread
            };
            let place = Arc::clone(place);
            *place.lock().unwrap() = misread;
            // What is in force at axes that stand is read back in every tick, for the next.
            server.step(OperatorInputs::default());
            let stands_m = server.positions_m();
            for _ in 0..500 {
                let row = server.step(OperatorInputs {
                    stop: false,
                    rearm: true,
                    ..OperatorInputs::default()
                });
                assert_eq!(row.state.phase, Phase::Fault, "{misread:?}, {of_actual}");
            }
            let row = server.step(OperatorInputs {
                stop: false,
                rearm: true,
                ..OperatorInputs::default()
            });
            let said = row.failure.unwrap().to_string();
            assert!(
                said.contains("further from its reference than its window"),
                "{misread:?}, {of_actual}: {said}"
            );
            assert!(farthest_mm(&stands_m, &server.positions_m()) < 0.001);
            *place.lock().unwrap() = Misread::Rightly;
            rearm(&mut server);
            assert!(goes_on(&mut server) > 100.0);
        }
    }
}

/// The loops stand while the values in force are unknown, re-armed or not.
#[test]
fn a_rearm_while_what_is_in_force_is_unknown_moves_nothing() {
    let mut server = Server::moving();
    server.at_full_speed();
    server.step(OperatorInputs {
        stop: true,
        rearm: false,
        ..OperatorInputs::default()
    });
    until_rest(&mut server, OperatorInputs::default());
    *server.bus.in_force_misread.lock().unwrap() = Misread::Missing;
    server.step(OperatorInputs::default());
    let stands_m = server.positions_m();
    for _ in 0..500 {
        let row = server.step(OperatorInputs {
            stop: false,
            rearm: true,
            ..OperatorInputs::default()
        });
        assert_eq!(row.state.phase, Phase::Fault);
    }
    assert_eq!(*server.bus.in_force.lock().unwrap(), [0; N]);
    assert!(farthest_mm(&stands_m, &server.positions_m()) < 0.001);
    *server.bus.in_force_misread.lock().unwrap() = Misread::Rightly;
    rearm(&mut server);
    assert!(goes_on(&mut server) > 100.0);
}

/// The loops begin by themselves where the axes stand, and nowhere else.
#[test]
fn a_start_away_from_the_axis_moves_nothing_until_it_is_rearmed() {
    // Nothing has moved yet, so that no position is stale.
    for misread in [Misread::Wrong, Misread::Swapped] {
        let mut server = Server::moving();
        *server.bus.actual_misread.lock().unwrap() = misread;
        let stands_m = server.positions_m();
        let rows: Vec<_> = (0..500).map(|_| server.tick()).collect();
        assert!(
            rows.iter()
                .skip(2)
                .all(|row| row.state.phase == Phase::Fault),
            "{misread:?}: {:?}",
            rows[2]
        );
        assert!(
            farthest_mm(&stands_m, &server.positions_m()) < 0.001,
            "{misread:?}"
        );
        *server.bus.actual_misread.lock().unwrap() = Misread::Rightly;
        rearm(&mut server);
        assert!(goes_on(&mut server) > 100.0);
    }
}
