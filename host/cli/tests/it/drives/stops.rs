//! A server that dies in motion.

use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::units::VelocityUmS;
use gantry_tau_machine::robot_file::Interface;
use gantry_tau_server::plant::DriveState;
use gantry_tau_sim::drive::supervision::{Limits, Trip};
use gantry_tau_sim::drive::{Drive, Settings};

use super::{accelerating, at, close, ideal, um};

const WIDE: Limits = Limits {
    watchdog_cycles: 3,
    window_nm: 1 << 40,
    window_cycles: 10,
};

/// Reference of a cycle on the way to 0.5 m/s.
fn reference(interface: Interface, cycle: i64) -> Reference {
    match interface {
        Interface::Position => at(accelerating(cycle)),
        Interface::Velocity => {
            let velocity = i32::try_from((cycle * 2_000).min(500_000)).unwrap();
            Reference {
                velocity_offset: VelocityUmS(velocity),
                ..at(0)
            }
        }
    }
}

/// Brings a drive to 0.5 m/s and leaves it alone. Returns it, how far it is then from where the
/// last reference left it, and the farthest, mm.
fn killed(settings: &Settings) -> (Drive, f64, f64) {
    let mut drive = Drive::at_rest(&at(0), settings);
    for cycle in 1..=999 {
        drive.command(&reference(settings.interface, cycle));
        drive.advance(0.0);
    }
    let last_m = match settings.interface {
        Interface::Position => um(accelerating(999)) * 1e-6,
        Interface::Velocity => drive.position_m(),
    };
    let ways = (0..1_000).map(|_| {
        drive.advance(0.0);
        (drive.position_m() - last_m) * 1e3
    });
    let farthest = ways.fold(0.0, f64::max);
    (drive, (drive.position_m() - last_m) * 1e3, farthest)
}

#[test]
fn with_positions_it_stops_near_the_last_reference() {
    let (drive, way_mm, farthest_mm) = killed(&ideal());
    assert_eq!((drive.state(), drive.trip()), (DriveState::Operating, None));
    assert!(
        way_mm.abs() < 0.001 && close(farthest_mm, 1.67, 0.01),
        "without a watchdog: {way_mm} mm, {farthest_mm} mm"
    );
    let (drive, way_mm, farthest_mm) = killed(&Settings {
        limits: Some(WIDE),
        ..ideal()
    });
    assert_eq!(
        (drive.state(), drive.trip()),
        (DriveState::Fault, Some(Trip::Watchdog))
    );
    assert!(
        close(way_mm, 1.3, 0.05) && farthest_mm < 1.68,
        "with one: {way_mm} mm, {farthest_mm} mm"
    );
}

/// By v t + v^2 / (2 a): the way until the watchdog, and that of the ramp.
#[test]
fn with_velocities_it_runs_on_until_the_watchdog() {
    for (watchdog_cycles, quick_stop_m_per_s2, expected_mm) in
        [(3, 10.0, 14.0), (3, 20.0, 7.75), (100, 10.0, 62.5)]
    {
        let limits = Some(Limits {
            watchdog_cycles,
            ..WIDE
        });
        let settings = Settings {
            interface: Interface::Velocity,
            limits,
            quick_stop_m_per_s2,
            ..ideal()
        };
        let (drive, way_mm, _) = killed(&settings);
        assert_eq!(
            (drive.state(), drive.trip()),
            (DriveState::Fault, Some(Trip::Watchdog))
        );
        assert!(
            close(way_mm, expected_mm, 0.05),
            "{watchdog_cycles}, {quick_stop_m_per_s2}: {way_mm} mm"
        );
    }
    // After the reset it waits for its next velocity; the old one is not data.
    let settings = Settings {
        interface: Interface::Velocity,
        limits: Some(WIDE),
        ..ideal()
    };
    let (mut drive, _, _) = killed(&settings);
    drive.reset();
    drive.command(&reference(Interface::Velocity, 0));
    drive.advance(0.0);
    assert_eq!(drive.state(), DriveState::Ready);
    // Nor is it while nothing comes at all.
    let (mut drive, _, _) = killed(&settings);
    let stands_m = drive.position_m();
    drive.reset();
    for _ in 0..100 {
        drive.advance(0.0);
    }
    assert_eq!(drive.state(), DriveState::Ready);
    assert!((drive.position_m() - stands_m).abs() < 1e-9);
    // Without a watchdog nothing stops it.
    let (_, way_mm, _) = killed(&Settings {
        interface: Interface::Velocity,
        ..ideal()
    });
    assert!(close(way_mm, 500.0, 0.01), "{way_mm} mm");
}
