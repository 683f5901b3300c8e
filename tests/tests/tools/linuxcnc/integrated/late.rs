//! Not in lock-step: a thread that is late, and a flood.

use super::super::record::{LISTENING, SAFE_DISCONNECT};
use super::super::run::Machine;
use super::judged::Row;
use super::session::Session;
use super::{end, l2, l2_part};

/// The thread stands for 50 ms.
const DELAY: &[&str] = &[
    "sh",
    "-c",
    "app=$(pidof rtapi_app); kill -STOP $app; sleep 0.05; kill -CONT $app",
];
/// Periods of a burst after it, at least.
const BURST: usize = 40;

/// Delays on the way of an offset to zero, while a program runs: periods of a burst have no tick,
/// the offset is held in them, and the reference follows the path.
pub(super) fn bursts() {
    let machine = Machine::obeying("l2", "burst", "lockstep=1").unwrap();
    machine.program(&l2_part(9)).unwrap();
    let mut session = Session::begin(&machine);
    session.switch_on();
    session.rearm();
    session.ask("run");
    let client = session.obtain("l2");
    session.load(300.0);
    session.pass(300);
    client.signal("KILL");
    session.wait_phase(SAFE_DISCONNECT);
    for _ in 0..3 {
        assert!(session.run_mounted(DELAY).success());
        session.pass(100);
    }
    session.wait_phase(LISTENING);
    let lateness: f64 = session.ask("pins gantry-tau.lateness-max").parse().unwrap();
    assert!(lateness > 40e6, "{lateness} ns");
    let rows = end(session, &machine, &l2());
    let held: Vec<_> = rows
        .windows(2)
        .filter(|pair| pair[0].tick == pair[1].tick)
        .collect();
    let moved = held.iter().filter(|pair| {
        let path = pair[1].nominal[0] - pair[0].nominal[0];
        pair[1].phase == SAFE_DISCONNECT && pair[1].offset[1] != 0 && path.abs() > 1_000.0
    });
    assert!(moved.count() > 3 * BURST, "{}", held.len());
    numbers_are_those_of_periods(&rows);
}

/// The port is flooded with connections and garbage, over TCP and over UDP: every period is there, and
/// no socket can block.
pub(super) fn flood() {
    // With streams at least one connection beside the listener; with datagrams the one socket.
    for (name, parameters, sockets) in [("flood", "", "2"), ("flood-udp", "udp=1", "1")] {
        let machine = Machine::obeying("l2", name, parameters).unwrap();
        machine.program(&l2_part(9)).unwrap();
        let mut session = Session::begin(&machine);
        session.switch_on();
        session.rearm();
        session.ask("run");
        let flood = machine.bring("flood.py").unwrap();
        session.ask("try hal.set_p('gantry-tau.write.tmax', '0')");
        session.ask("try hal.set_p('gantry-tau.lateness-max', '0')");
        assert!(
            session
                .run_mounted(&["python3", flood.to_str().unwrap(), sockets])
                .success(),
            "flood.py says why"
        );
        let largest =
            session.ask("pins gantry-tau.write.tmax gantry-tau.lateness-max gantry-tau.held");
        println!("flooded: cycles of the processor, ns late, periods held: {largest}");
        let runs = "s.interp_state != linuxcnc.INTERP_IDLE and p('motion.motion-enabled')";
        assert_eq!(session.ask(&format!("wait 0 {runs}")), "done");
        let rows = end(session, &machine, &l2());
        numbers_are_those_of_periods(&rows);
        assert!(rows.iter().all(|row| row.offset == [0; 3]));
    }
}

/// A tick after a burst counts the periods that were skipped.
fn numbers_are_those_of_periods(rows: &[Row<3>]) {
    for at in (1..rows.len()).filter(|at| rows[*at].tick != rows[at - 1].tick) {
        assert_eq!(
            usize::try_from(rows[at].tick - rows[0].tick).unwrap(),
            at,
            "{:?}",
            rows[at]
        );
    }
}
