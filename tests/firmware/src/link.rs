//! The link: the firmware serves a real client over TCP, in lock-step. Emulated time is not real time: a tick is due when the timer
//! says so AND the answer to the last State has come, or patience has run out.

mod audit;
mod journal;

use core::mem::MaybeUninit;

use cortex_m::singleton;
use gantry_tau_core::control::endpoint::Turn;
use gantry_tau_core::control::message::{Capabilities, Phase};
use gantry_tau_core::units::{Epoch, PositionNm};

use crate::board::timer::Ticks;
use crate::machine::{AXES, MOTORS, Machine, Meter, Moment, Motion, Part, Parts, Pose6, Work};
use crate::net::lan9118::{Lan9118, LanError};
use crate::net::tcp::{Place, Server, Storage};
use audit::Audit;
use journal::Journal;

/// Where the emulator's network has its guest, and what it calls itself.
const PLACE: Place = Place {
    hardware: [0x02, 0x00, 0x00, 0x00, 0x00, 0x01],
    address: [10, 0, 2, 15],
    network_bits: 24,
    router: [10, 0, 2, 2],
    port: 7_000,
};
/// Silence that counts as a miss, ms.
const PATIENCE_MS: u32 = 1_000;
/// Silence that counts as a tick of the handshake, ms; a thousand of them end it.
const HANDSHAKE_PATIENCE_MS: u32 = 10;
/// The tool goes this far to and fro, µm, at 1 µm per tick.
const PATH_UM: u64 = 1_000;
/// Where the tool is at home, m.
const HOME_M: [f64; 3] = [0.1, 0.0, 0.3];
/// The longest run, ms; a test that forgot its firmware.
const LONGEST_MS: u32 = 600_000;

/// Why the link cannot be served.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
enum Trouble {
    /// The controller.
    Lan(LanError),
    /// A constant of the machine, or its home.
    Machine,
    /// It was served before: there is one machine.
    Twice,
}

/// Serves until `sessions` have ended and nobody is connected. Whether every reference of every tick was within its bounds.
pub(crate) fn run(ticks: Ticks, sessions: Option<&[u8]>) -> bool {
    let Some(sessions) = sessions.and_then(number) else {
        defmt::error!("usage: link SESSIONS");
        return false;
    };
    match serve(ticks, sessions) {
        Ok(well) => well,
        Err(trouble) => {
            defmt::error!("link trouble={}", trouble);
            false
        }
    }
}

fn serve(mut ticks: Ticks, sessions: u32) -> Result<bool, Trouble> {
    let home = home().ok_or(Trouble::Machine)?;
    let parts = Parts::new(Capabilities::LOCKSTEP, home).map_err(|_| Trouble::Machine)?;
    let place = singleton!(: MaybeUninit<Machine> = MaybeUninit::uninit()).ok_or(Trouble::Twice)?;
    let machine = place.write(Machine::new(parts));
    let lan = Lan9118::new(PLACE.hardware).map_err(Trouble::Lan)?;
    let storage = singleton!(: Storage = Storage::new()).ok_or(Trouble::Twice)?;
    let seed = u64::from(crate::board::clock::now());
    let mut link = Link {
        tcp: Server::new(lan, &PLACE, storage, seed),
        next_epoch: Epoch(1),
        path: 0,
    };
    let turn = link.tick(machine);
    let parameters = machine.server().session().config().parameters();
    let limits = parameters.axes.map(|axis| axis.limits);
    let mut audit = Audit::new(limits, &turn);
    let mut journal = Journal::new(sessions);
    journal.listening(PLACE.port, &turn);

    let mut now_ms: u32 = 0;
    let mut state_left_ms: u32 = 0;
    while now_ms < LONGEST_MS {
        now_ms = now_ms.saturating_add(ticks.wait());
        link.tcp.visit(now_ms.into(), machine.server());
        if !is_due(machine, now_ms.saturating_sub(state_left_ms)) {
            continue;
        }
        let turn = link.tick(machine);
        state_left_ms = now_ms;
        let checked = audit.check(&turn);
        journal.note(&turn, checked);
        if journal.is_complete() && link.tcp.is_idle() {
            break;
        }
    }
    journal.close(now_ms, &audit);
    Ok(journal.is_complete() && audit.broken_ticks == 0)
}

/// The server in lock-step, and the machine's path.
struct Link {
    tcp: Server,
    next_epoch: Epoch,
    path: u64,
}

impl Link {
    /// One tick, and what is to be sent and closed after it.
    fn tick(&mut self, machine: &mut Machine) -> Turn<AXES, MOTORS> {
        let moment = moment(pose(self.path), self.next_epoch);
        self.path = self.path.saturating_add(1);
        let tcp = &mut self.tcp;
        machine.compute(&moment, &mut Unmeasured);
        let turn = machine.serve(&moment, &mut Unmeasured, &mut |to, bytes| {
            tcp.send(to, bytes);
        });
        for connection in &turn.close {
            tcp.close(*connection);
        }
        tcp.flush();
        tcp.ticked();
        if turn.output.welcome.is_some() {
            // An emulated machine has nothing to persist it in; it never runs twice.
            self.next_epoch = Epoch(self.next_epoch.0.saturating_add(1));
        }
        turn
    }
}

/// Whether the tick need not wait any longer for the owner's answer, `waited_ms` after the last State left.
fn is_due(machine: &mut Machine, waited_ms: u32) -> bool {
    let server = machine.server();
    let patience_ms = match server.session().phase() {
        Phase::Submit | Phase::Obtain => PATIENCE_MS,
        Phase::Handshake => HANDSHAKE_PATIENCE_MS,
        Phase::Listening | Phase::SafeDisconnect | Phase::Fault => return true,
    };
    server.owner_has_answered() || waited_ms >= patience_ms
}

/// The tool along x, to and fro.
fn pose(step: u64) -> Pose6 {
    let along = step
        .checked_rem(PATH_UM.saturating_mul(2))
        .unwrap_or_default();
    let away = along.min(PATH_UM.saturating_mul(2).saturating_sub(along));
    let away_m = f64::from(u32::try_from(away).unwrap_or_default()) * 1e-6;
    let [x, y, z] = HOME_M;
    [x + away_m, y, z, 0.0, 0.0, 0.0]
}

/// The axes at home.
fn home() -> Option<[PositionNm; AXES]> {
    let (mut work, _) = Work::new().ok()?;
    work.answer(&moment(pose(0), Epoch(0))).nominal()
}

/// What a tick depends on beside the bytes: nobody stops, nobody pulls at the tool but the client's sensor.
const fn moment(pose: Pose6, next_epoch: Epoch) -> Moment {
    Moment {
        elapsed: 1,
        stop: false,
        rearm: false,
        next_epoch,
        arrival_us: 0,
        motion: Motion::F1,
        pose,
        load: [0.0; 6],
    }
}

/// A decimal number. (That of a `str` links a panic.)
fn number(digits: &[u8]) -> Option<u32> {
    digits.iter().try_fold(0_u32, |number, digit| {
        let digit = digit.checked_sub(b'0').filter(|digit| *digit < 10)?;
        number.checked_mul(10)?.checked_add(digit.into())
    })
}

/// Nobody measures here: time that passes on the network is not the core's.
struct Unmeasured;

impl Meter for Unmeasured {
    fn begin(&mut self) {}
    fn end(&mut self, _part: Part) {}
}
