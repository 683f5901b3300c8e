//! Configurations that are refused, each with motor and reason.

use gantry_tau_ethercat::{BringUpError, BusError, DevicePlace, Drives, Settings};

use crate::bench::{SETTINGS, VENDOR, configs, setups, wire};

/// The error of a bring-up in words.
fn refusal(
    change: impl FnOnce(
        &mut [gantry_tau_ethercat::emulation::DriveSetup],
        &mut [gantry_tau_ethercat::DriveConfig; 3],
    ),
    settings: Settings,
) -> (BringUpError, String) {
    let mut setups = setups(3);
    let mut configs = configs();
    change(&mut setups, &mut configs);
    let error = Drives::bring_up(wire(&setups), &configs, settings).unwrap_err();
    (error, error.to_string())
}

#[test]
fn watchdogs_that_are_too_long_off_or_not_taken() {
    for watchdog_cycles in [0, 11, 100] {
        let (error, text) = refusal(
            |_, _| {},
            Settings {
                watchdog_cycles,
                ..SETTINGS
            },
        );
        assert_eq!(
            error,
            BringUpError::Watchdog {
                cycles: watchdog_cycles
            }
        );
        assert!(text.contains("1 to 10"), "{text}");
    }
    let (error, _) = refusal(|drives, _| drives[1].watchdog_is_writable = false, SETTINGS);
    assert_eq!(
        error,
        BringUpError::WatchdogTime {
            motor: 1,
            wanted_us: 5_000,
            found_us: 100_000
        }
    );
    let (error, text) = refusal(|drives, _| drives[2].has_watchdog = false, SETTINGS);
    assert_eq!(error, BringUpError::WatchdogOff { motor: 2 });
    assert!(text.contains("would not stop by itself"), "{text}");
}

#[test]
fn missing_objects() {
    for (object, words) in [
        (0x60B1, "axes.velocity.max_um_s"),
        (0x60B2, "axes.torque.max_permille"),
        (0x608F, "counts_per_turn"),
        (0x607A, "needs"),
        (0x6061, "needs"),
    ] {
        let (error, text) = refusal(|drives, _| drives[1].missing.push(object), SETTINGS);
        assert!(
            matches!(error, BringUpError::MissingObject { motor: 1, object: found, .. } if found == object),
            "{text}"
        );
        assert!(text.contains(words) && text.contains("motor 1"), "{text}");
    }
    // Not needed, so not missed.
    let mut drives = setups(3);
    let mut wanted = configs::<3>();
    drives[1].missing = vec![0x60B1, 0x60B2, 0x603F, 0x608F, 0x607D];
    (
        wanted[1].needs_velocity_offset,
        wanted[1].needs_torque_offset,
        wanted[1].counts_per_turn,
    ) = (false, false, None);
    Drives::bring_up(wire(&drives), &wanted, SETTINGS).unwrap();
}

#[test]
fn another_encoder_and_narrow_software_limits() {
    let (error, _) = refusal(|drives, _| drives[0].encoder = (1 << 20, 2), SETTINGS);
    assert_eq!(
        error,
        BringUpError::Encoder {
            motor: 0,
            expected: 1 << 20,
            found: 1 << 19
        }
    );
    for limits in [(-9_999_999, 20_000_000), (-20_000_000, 9_999_999)] {
        let (error, text) = refusal(|drives, _| drives[2].software_limits = limits, SETTINGS);
        let travel = (-10_000_000, 10_000_000);
        assert_eq!(
            error,
            BringUpError::SoftwareLimits {
                motor: 2,
                travel,
                limits
            }
        );
        assert!(text.contains("607Dh"), "{text}");
    }
}

#[test]
fn drives_that_are_swapped_missing_or_ambiguous() {
    let (error, text) = refusal(
        |drives, configs| {
            drives.swap(0, 1);
            for (position, config) in (0..).zip(configs) {
                config.place = DevicePlace::Position(position);
            }
        },
        SETTINGS,
    );
    assert!(matches!(
        error,
        BringUpError::Identity {
            motor: 0,
            vendor: VENDOR,
            product: 1,
            found_product: 2,
            ..
        }
    ));
    assert!(text.contains("swapped"), "{text}");
    // By alias: the aliases were given to the wrong drives.
    let (error, _) = refusal(
        |drives, _| {
            let [first, second, _] = drives else {
                panic!("three drives")
            };
            std::mem::swap(&mut first.alias, &mut second.alias);
        },
        SETTINGS,
    );
    assert!(
        matches!(
            error,
            BringUpError::Identity {
                motor: 0,
                found_product: 2,
                ..
            }
        ),
        "{error}"
    );
    let (error, _) = refusal(
        |_, configs| configs[2].place = DevicePlace::Alias(77),
        SETTINGS,
    );
    assert_eq!(
        error,
        BringUpError::Missing {
            motor: 2,
            place: DevicePlace::Alias(77),
            found: 3
        }
    );
    let (error, _) = refusal(|drives, _| drives[1].alias = drives[0].alias, SETTINGS);
    assert!(
        matches!(error, BringUpError::Ambiguous { motor: 0, .. }),
        "{error}"
    );
    let (error, _) = refusal(|_, configs| configs[1] = configs[0], SETTINGS);
    assert!(
        matches!(error, BringUpError::Ambiguous { motor: 0, .. }),
        "{error}"
    );
}

#[test]
fn an_empty_bus_and_too_many_devices() {
    let empty = wire(&setups(3));
    empty.bench().chain.cut_behind(0);
    assert_eq!(
        Drives::bring_up(empty, &configs::<3>(), SETTINGS).unwrap_err(),
        BusError::Silent.into()
    );
    let many = wire(&setups(17));
    assert_eq!(
        Drives::bring_up(many, &configs::<3>(), SETTINGS).unwrap_err(),
        BusError::TooMany.into()
    );
    // Sixteen are not too many, be they drives of the file or others, which stay where they are.
    let most = wire(&setups(16));
    Drives::bring_up(most.clone(), &configs::<3>(), SETTINGS).unwrap();
    Drives::bring_up(most, &configs::<16>(), SETTINGS).unwrap();
}

/// Brings up equal drives of which two are swapped; `serials`: the file has serial numbers.
fn bring_up_swapped(serials: bool) -> Result<(), BringUpError> {
    let mut setups = setups(3);
    let mut configs = configs::<3>();
    for ((position, setup), config) in (0..).zip(&mut setups).zip(&mut configs) {
        setup.identity.product = 1;
        config.product = 1;
        config.place = DevicePlace::Position(position);
        config.serial = serials.then_some(setup.identity.serial);
    }
    setups.swap(0, 2);
    Drives::bring_up(wire(&setups), &configs, SETTINGS).map(|_| ())
}

/// Equal drives that are named by their position are distinguished by their serial numbers, if the
/// file has them.
#[test]
fn equal_drives_that_are_swapped() {
    assert_eq!(bring_up_swapped(false), Ok(()), "nothing tells them apart");
    let error = bring_up_swapped(true).unwrap_err();
    assert_eq!(
        error,
        BringUpError::Serial {
            motor: 0,
            place: DevicePlace::Position(0),
            expected: 100,
            found: 102
        }
    );
    assert!(
        error
            .to_string()
            .contains("serial number 102, expected 100"),
        "{error}"
    );
}

/// A drive whose application refuses SAFE-OP is named with its reason.
#[test]
fn a_state_that_a_drive_refuses() {
    let wire = wire(&setups(3));
    wire.bench()
        .chain
        .subdevice_mut(1)
        .unwrap()
        .refuse(4, 0x0024);
    let error = Drives::bring_up(wire, &configs::<3>(), SETTINGS).unwrap_err();
    assert!(
        matches!(
            error,
            BringUpError::Refused {
                motor: 1,
                state: 2,
                ..
            }
        ),
        "{error}"
    );
    assert!(
        error
            .to_string()
            .contains("refused to leave state 2: AL status code 0x0024"),
        "{error}"
    );
}
