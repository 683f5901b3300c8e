//! T21 where velocities are in force: under any pattern of refused writes and failed readings,
//! stops and re-arms, the velocity at a drive changes by at most its limit per accepted write, and
//! no session is granted while the loops do not follow.

use gantry_tau_tests::client::Noise;

use super::*;

/// Velocity step of the loops, µm/s per tick: 20 m/s^2.
const STEP_UM_S: i32 = 20_000;

#[test]
fn the_velocity_in_force_makes_no_step() {
    for seed in 1..=4 {
        let mut server = Server::moving();
        let mut noise = Noise::new(seed);
        let (mut trouble, mut operator) = (0_usize, OperatorInputs::default());
        let (mut failed, mut listened, mut largest) = (0, 0, 0);
        for tick in 0..20_000 {
            if trouble == 0 && noise.below(300) == 0 {
                trouble = 1 + noise.below(4);
                let [refuses, is_deaf] =
                    [[true, false], [false, true], [true, true]][noise.below(3)];
                server.bus.refuses.store(refuses, Ordering::Relaxed);
                server.bus.is_deaf.store(is_deaf, Ordering::Relaxed);
            } else {
                trouble = trouble.saturating_sub(1);
            }
            if trouble == 0 {
                server.bus.refuses.store(false, Ordering::Relaxed);
                server.bus.is_deaf.store(false, Ordering::Relaxed);
            }
            // A stop now and then; re-armed for a while, and released.
            operator.stop = noise.below(2_000) == 0 || operator.stop && noise.below(20) != 0;
            operator.rearm = if operator.rearm {
                noise.below(400) != 0
            } else {
                noise.below(100) == 0
            };
            let before = *server.bus.in_force.lock().unwrap();
            let row = server.step(operator);
            let after = *server.bus.in_force.lock().unwrap();
            for (before, after) in before.iter().zip(after) {
                let step = (after - before).abs();
                largest = largest.max(step);
                assert!(
                    step <= STEP_UM_S,
                    "seed {seed}, tick {tick}: {before} to {after} um/s"
                );
            }
            failed += i32::from(row.plant_failed);
            listened += i32::from(row.state.phase == Phase::Listening);
            assert!(!row.plant_failed || row.failure.is_some(), "{row:?}");
        }
        assert!(
            failed > 1_000 && listened > 1_000 && largest >= 10_000,
            "{failed}, {listened}, {largest}"
        );
    }
}

#[test]
fn nobody_is_granted_a_session_while_the_axes_stand() {
    let mut server = Server::moving();
    server.at_full_speed();
    server.step(OperatorInputs {
        stop: true,
        rearm: false,
        ..OperatorInputs::default()
    });
    let mut client = Client::<N>::connect(server.cycle.address().unwrap());
    client.say_hello();
    wait_for("the refusal", || server.tick().refused > 0);
    assert_eq!(
        client.refusal(),
        gantry_tau_core::Refusal::Faulted { ticks_left: 0 }
    );
    for _ in 0..200 {
        assert_eq!(server.tick().state.phase, Phase::Fault);
    }
}
