//! Not in lock-step: a thread that is late, and a flood.

use super::super::run::Machine;
use super::session::Session;
use super::{end, l2, l2_part};

/// The thread stands for 50 ms, three times, while a program runs: the periods that follow in a burst have no tick. Then both ports are
/// flooded with connections and garbage, over TCP and over UDP: every period is there, and no socket can block.
pub(super) fn bursts_and_flood() {
    for (name, parameters, times) in [("late", "lockstep=0", 3), ("late-udp", "udp=1", 0)] {
        let machine = Machine::obeying("l2", name, parameters).unwrap();
        machine.program(&l2_part(9)).unwrap();
        let mut session = Session::begin(&machine);
        session.switch_on();
        session.rearm();
        session.ask("run");
        for _ in 0..times {
            let script = "app=$(pidof rtapi_app); kill -STOP $app; sleep 0.05; kill -CONT $app";
            assert!(session.run_mounted(&["sh", "-c", script]).success());
            session.pass(200);
        }
        assert!(times == 0 || session.ask("pins gantry-tau.lateness-max").parse::<f64>().unwrap() > 40e6);
        let flood = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/tools/linuxcnc/flood.py");
        session.ask("try hal.set_p('gantry-tau.write.tmax', '0')");
        assert!(session.run_mounted(&["python3", flood]).success(), "flood.py says why");
        let largest = session.ask("pins gantry-tau.write.tmax gantry-tau.lateness-max gantry-tau.held");
        println!("flooded: cycles of the processor, ns late, periods held: {largest}");
        assert_eq!(session.ask("wait 0 s.interp_state != linuxcnc.INTERP_IDLE and p('motion.motion-enabled')"), "done");
        let rows = end(session, &machine, &l2());
        let held = (1..rows.len()).filter(|at| rows[*at].tick == rows[at - 1].tick).count();
        assert!(held >= times * 40, "{held}");
        // The next tick counts those that were skipped: its number is that of the period.
        for at in (1..rows.len()).filter(|at| rows[*at].tick != rows[at - 1].tick) {
            assert_eq!(usize::try_from(rows[at].tick - rows[0].tick).unwrap(), at, "{:?}", rows[at]);
        }
        assert!(rows.iter().all(|row| row.offset == [0; 3]));
    }
}
