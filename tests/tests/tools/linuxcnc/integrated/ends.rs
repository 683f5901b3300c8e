//! Ends of sessions.

use super::super::record::{FAULT, LISTENING, OBTAIN, SAFE_DISCONNECT};
use super::super::run::Machine;
use super::judged::{Row, ends, judge, read};
use super::session::{Client, Session};
use super::{CLIENT_LATE, GOODBYE, STOP, end, l2, l2_part, variant};

/// Exit codes of the client.
const REFUSED: i32 = 4;
const INCOMPATIBLE: i32 = 5;
const ENDED: i32 = 6;
const VANISHED: i32 = 7;
const SILENT: i32 = 8;

/// Starts the program if asked to, and a client whose offsets act.
fn compensated(session: &mut Session, runs: bool) -> Client {
    if runs {
        session.ask("run");
    }
    let client = session.obtain("l2");
    session.load(60.0);
    session.pass(300);
    client
}

/// On again after an end by the machine: the client knows it, references are with their drives, and
/// the operator re-arms.
fn again(session: &mut Session, client: Client) {
    session.wait("not p('motion.motion-enabled')");
    assert_eq!(client.end(), Some(ENDED));
    session.wait("p('gantry-tau.permit')");
    session.ask("on");
    session.rearm();
}

/// Machine off at speed, emergency stop, program abort (which ends nothing), machine off at rest,
/// Stop (the program goes on), and a path that leaves the reach, and a drive that cannot be read:
/// all in Obtain.
pub(super) fn by_the_machine() {
    let machine = Machine::obeying("l2", "machine", "lockstep=1").unwrap();
    machine.program(&l2_part(9)).unwrap();
    let mut session = Session::begin(&machine);
    session.switch_on();
    session.rearm();
    for command in ["off", "estop"] {
        let client = compensated(&mut session, true);
        session.ask(command);
        again(&mut session, client);
    }

    let client = compensated(&mut session, true);
    session.ask("abort");
    session.wait("s.interp_state == linuxcnc.INTERP_IDLE and s.inpos");
    session.pass(200);
    assert_eq!(
        session.ask("pins gantry-tau.phase"),
        "3.0",
        "an abort of the program ends no session"
    );
    session.ask("off");
    again(&mut session, client);

    let client = compensated(&mut session, true);
    session.ask("sets stop 1");
    assert_eq!(client.end(), Some(ENDED));
    session.ask("sets stop 0");
    assert_eq!(
        session.ask("wait 0 s.interp_state != linuxcnc.INTERP_IDLE and p('motion.motion-enabled')"),
        "done",
        "the program goes on"
    );
    session.rearm();
    session.ask("abort");
    session.wait("s.interp_state == linuxcnc.INTERP_IDLE and s.inpos");

    let client = compensated(&mut session, false);
    machine
        .program("G21 G90 G19\nG0 Y560 Z850\nG4 P0.1\nG3 Y560 Z850 J60 K-20 F600\nM2\n")
        .unwrap();
    session.ask("errors");
    session.ask("run");
    again(&mut session, client);
    assert!(session.ask("errors").contains("kinematicsInverse failed"));

    // A drive whose position is not a number any more; away from the end of the reach, where
    // nothing can be compensated.
    machine.program(&l2_part(9)).unwrap();
    let client = compensated(&mut session, true);
    session.ask("errors");
    session.ask("try hal.set_p('lowpass.0.gain', 'nan')");
    session.wait("not p('motion.motion-enabled') and not p('gantry-tau.permit')");
    assert_eq!(client.end(), Some(ENDED));
    // Messages pass through LinuxCNC's task.
    session.ask("try time.sleep(0.5)");
    let shown = session.ask("errors");
    let line =
        "gantry_tau: a measurement of a drive, or a command, is not a number in range: stopped";
    assert_eq!(
        shown.matches(line).count(),
        1,
        "the operator sees it once: {shown}"
    );
    session.pass(100);

    session.end();
    let rows = read(&machine.file(""), &l2());
    let lost = rows
        .iter()
        .position(|row| row.position[0].is_nan())
        .unwrap();
    judge(&rows[..lost], &l2());
    let (last, after) = (&rows[lost - 1], &rows[lost..]);
    let moved = after.iter().map(|row| {
        row.reference[0] - to_f64(row.offset[0]) - last.reference[0] + to_f64(last.offset[0])
    });
    assert!(
        moved.map(f64::abs).fold(0.0, f64::max) < 2.0,
        "the nominal position stands"
    );
    assert_eq!(ends(&rows), [[FAULT, STOP]; 6]);
    assert!(
        rows.iter()
            .filter(|row| row.phase == OBTAIN)
            .all(|row| row.missed == 0)
    );
    first_disabled_periods(&rows[..lost]);
}

fn to_f64(nm: i64) -> f64 {
    f64::from(i32::try_from(nm).unwrap())
}

/// In the first period without the drives LinuxCNC steps onto its last reference, by lag times
/// speed; the reference does not.
fn first_disabled_periods(rows: &[Row<3>]) {
    let mut largest = (0.0_f64, 0.0_f64);
    let mut number = 0;
    for pair in rows
        .windows(2)
        .filter(|pair| pair[0].is_on && !pair[1].is_on)
    {
        number += 1;
        for joint in 0..3 {
            let snap = pair[1].nominal[joint] - pair[0].nominal[joint];
            let step = pair[1].reference[joint] - pair[0].reference[joint];
            largest = (largest.0.max(snap.abs()), largest.1.max(step.abs()));
        }
    }
    println!(
        "first disabled period: LinuxCNC's step {:.0} nm, the reference's {:.0} nm",
        largest.0, largest.1
    );
    assert_eq!(number, 4, "times that the machine was switched off");
    assert!(largest.0 > 100_000.0, "LinuxCNC steps: {}", largest.0);
    assert!(
        largest.1 < largest.0 / 20.0,
        "the reference does not: {} of {}",
        largest.1,
        largest.0
    );
}

/// Clients of other machines, no sample, a pulled cable, a client that stands, a sample that is not
/// a number.
pub(super) fn by_the_client() {
    let machine = Machine::obeying("l2", "client", "lockstep=1").unwrap();
    machine.program(&l2_part(9)).unwrap();
    let other = variant(
        &machine,
        "other.toml",
        "\nL = [1.0, 1.1, 1.0]",
        "\nL = [1.0, 1.1, 1.001]",
    );
    let mut session = Session::begin(&machine);
    session.switch_on();
    session.rearm();
    session.ask("run");
    for robot in [other.as_str(), "f1"] {
        let code = session.client(robot).end();
        assert!(
            code == Some(REFUSED) || code == Some(INCOMPATIBLE),
            "a client of {robot}: {code:?}"
        );
    }
    session.ask("sets wrench-valid 0");
    assert_eq!(
        session.client("l2").end(),
        Some(SILENT),
        "no sample is published"
    );
    session.ask("sets wrench-valid 1");
    session.wait_phase(LISTENING);

    let client = compensated(&mut session, false);
    assert!(session.run(&["ip", "link", "set", "lo", "down"]).success());
    session.wait_phase(SAFE_DISCONNECT);
    let code = client.end();
    assert!(session.run(&["ip", "link", "set", "lo", "up"]).success());
    assert!(code == Some(VANISHED), "{code:?}");

    let client = compensated(&mut session, false);
    client.signal("STOP");
    session.wait_phase(SAFE_DISCONNECT);
    client.signal("CONT");
    let code = client.end();
    assert!(code == Some(ENDED) || code == Some(VANISHED), "{code:?}");

    let client = compensated(&mut session, false);
    session.ask("errors");
    session.ask("sets wrench-1 nan");
    assert_eq!(client.end(), Some(SILENT));
    session.load(0.0);
    session.wait_phase(LISTENING);
    // Messages pass through LinuxCNC's task.
    session.ask("try time.sleep(0.5)");
    let shown = session.ask("errors");
    assert_eq!(
        shown, "gantry_tau: gantry-tau.wrench-N is not a number: no force is published",
        "the operator sees it once"
    );

    let rows = end(session, &machine, &l2());
    assert_eq!(
        ends(&rows),
        [
            [SAFE_DISCONNECT, CLIENT_LATE],
            [SAFE_DISCONNECT, CLIENT_LATE],
            [SAFE_DISCONNECT, GOODBYE]
        ]
    );
}

/// LinuxCNC and all its processes are killed in mid-path, in Obtain. The drives stand, with the
/// offset in their positions; LinuxCNC starts again there, stopped, and nothing jumps.
pub(super) fn by_a_kill() {
    let machine = Machine::obeying("l2", "kill", "lockstep=1").unwrap();
    machine.program(&l2_part(9)).unwrap();
    let mut session = Session::begin(&machine);
    session.switch_on();
    session.rearm();
    let client = compensated(&mut session, true);
    session.kill();
    assert_eq!(client.end(), Some(VANISHED));
    let rows = read(&machine.file(""), &l2());
    judge(&rows, &l2());
    let last = rows.last().unwrap();
    assert!(
        last.phase == OBTAIN && last.offset[1].abs() > 50_000,
        "{last:?}"
    );
    let epochs = machine.epochs();

    let stand: String = (0..3)
        .map(|joint| {
            format!(
                "unlinkp mux2.{at}.in0\nsetp mux2.{at}.in0 {:.6}\n",
                last.position[joint] / 1e6,
                at = 2 * joint
            )
        })
        .collect();
    std::fs::write(machine.file("stand.tcl"), stand).unwrap();
    machine
        .edit(
            "HALFILE = judged.tcl",
            "HALFILE = judged.tcl\nHALFILE = stand.tcl",
        )
        .unwrap();
    let mut session = Session::begin(&machine);
    session.switch_on();
    session.pass(100);
    assert_eq!(
        session.ask("pins gantry-tau.phase gantry-tau.1.offset"),
        "5.0 0.0",
        "a start is a stop"
    );
    assert_ne!(session.client("l2").end(), Some(0));
    session.rearm();
    drop(compensated(&mut session, true));
    let again = end(session, &machine, &l2());
    for joint in 0..3 {
        let error = again[0].reference[joint] - last.position[joint];
        assert!(
            error.abs() < 2.0,
            "references start where the drives stand: {error} nm"
        );
    }
    assert!(machine.epochs() > epochs, "no epoch is granted twice");
}
