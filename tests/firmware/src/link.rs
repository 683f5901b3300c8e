//! Lock-step server of a real client over TCP. Emulated time is not real time: a cycle is due when
//! the timer's interrupt came AND the owner has answered the last State, or was silent for too
//! long.

use core::mem::MaybeUninit;

use cortex_m::singleton;
use gantry_tau_core::control::message::{Capabilities, Phase};
use gantry_tau_core::control::monitor::{Monitor, Violation};
use gantry_tau_core::control::session::Output;
use gantry_tau_core::units::PositionNm;

use crate::board::timer::Ticks;
use crate::board::{clock, stack};
use crate::keys;
use crate::machine::{
    AXES, AXIS_OF_MOTOR, ControlCycle, CycleInput, Machine, Motion, MotorReferences, Parts, Pose6,
    Unmeasured,
};
use crate::net::lan9118::{Lan9118, LanError};
use crate::net::tcp::{Place, Server, Storage};
use crate::session_log::SessionLog;

/// Guest of the emulator's network.
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
/// Length of the tool's path, to and fro at 1 µm per tick, µm.
const PATH_UM: u64 = 1_000;
/// Position of the tool at home, m.
const HOME_M: [f64; 3] = [0.1, 0.0, 0.3];
/// Sample of the unloaded force sensor, N and N m, its axes; a client tares it.
const UNLOADED: [f64; 6] = [1.5, -0.8, -16.0, 0.05, 0.08, 0.02];
/// Force against y of the sensor, N, which acts after this number of ticks in Obtain.
const PULL_N: f64 = 50.0;
const PULL_AFTER: u32 = 100;
/// Longest run, ms: ends a firmware whose test has died.
const MAX_MS: u32 = 600_000;

/// Error at the start of the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
enum LinkError {
    /// The controller.
    Lan(LanError),
    /// A constant of the machine, or its home.
    Machine,
    /// A second start: there is one machine.
    Twice,
}

/// References that broke a rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
enum Broken {
    /// A rule of the monitor.
    Rule(Violation),
    /// Motors of one axis have different references, or another reference than their axis.
    Motors,
    /// Withheld, though every write was accepted.
    Withheld,
}

/// Serves until `sessions` have ended and all connections are closed. Returns true if every
/// reference of every tick was within its bounds.
pub(crate) fn run(ticks: Ticks, sessions: Option<&[u8]>) -> bool {
    let Some(sessions) = sessions.and_then(number) else {
        defmt::error!("usage: link SESSIONS");
        return false;
    };
    match serve(ticks, sessions) {
        Ok(well) => well,
        Err(error) => {
            defmt::error!("error={}", error);
            false
        }
    }
}

fn serve(mut ticks: Ticks, sessions: u32) -> Result<bool, LinkError> {
    let place =
        singleton!(: MaybeUninit<ControlCycle> = MaybeUninit::uninit()).ok_or(LinkError::Twice)?;
    let cycle = ControlCycle::write(place).map_err(|_| LinkError::Machine)?;
    let home = cycle
        .run(&CycleInput::on_time(Motion::F1, pose(0)))
        .nominal()
        .ok_or(LinkError::Machine)?;
    let parts = Parts::new(cycle, Capabilities::LOCKSTEP, home).map_err(|_| LinkError::Machine)?;
    let place =
        singleton!(: MaybeUninit<Machine> = MaybeUninit::uninit()).ok_or(LinkError::Twice)?;
    let machine = place.write(Machine::new(parts, keys::server));
    let lan = Lan9118::new(PLACE.hardware).map_err(LinkError::Lan)?;
    let storage = singleton!(: Storage = Storage::new()).ok_or(LinkError::Twice)?;
    let mut tcp = Server::new(lan, &PLACE, storage, clock::now().into());
    let axes = &machine.server().session().config().parameters().axes;
    let mut monitor = Monitor::new(
        axes.map(|axis| axis.limits),
        Some(axes.map(|axis| axis.machine_travel)),
    );
    let mut log = SessionLog::new();
    let mut broken_ticks: u32 = 0;
    defmt::info!("listening={=u16}", PLACE.port);

    let mut now_ms: u32 = 0;
    let mut last_tick_ms: u32 = 0;
    let mut obtained: u32 = 0;
    while now_ms < MAX_MS {
        now_ms = now_ms.saturating_add(ticks.wait());
        tcp.visit(now_ms.into(), machine.server());
        if !is_due(machine, now_ms.saturating_sub(last_tick_ms)) {
            continue;
        }
        last_tick_ms = now_ms;
        let mut input = CycleInput::on_time(Motion::F1, pose(log.ticks.into()));
        input.load = sample(obtained);
        machine.compute(&input, &mut Unmeasured);
        let motors = machine.serve(&input, &mut Unmeasured, &mut |to, frame| {
            tcp.send(to, frame)
        });
        while let Some(connection) = machine.server().poll_close() {
            tcp.close(connection);
        }
        tcp.flush();
        tcp.ticked();
        if let Err(broken) = check(&mut monitor, machine.output(), &motors) {
            broken_ticks = broken_ticks.saturating_add(1);
            defmt::error!("broken={}", broken);
        }
        if let Some(output) = machine.output() {
            log.note(output);
            obtained = match output.state.phase {
                Phase::Obtain => obtained.saturating_add(1),
                _ => 0,
            };
            for (_, refusal) in &output.refusals {
                defmt::info!("tick={=u64} refused={}", output.state.tick.0, refusal);
            }
        }
        if log.sessions >= sessions && tcp.is_idle() {
            break;
        }
    }
    defmt::info!(
        "ticks={=u32} ms={=u32} sessions={=u32} broken_ticks={=u32} stack={=usize}",
        log.ticks,
        now_ms,
        log.sessions,
        broken_ticks,
        stack::high_water()
    );
    Ok(log.sessions >= sessions && broken_ticks == 0)
}

/// Checks State and references of the last tick, from outside of the session.
fn check(
    monitor: &mut Monitor<AXES>,
    output: Option<&Output<AXES>>,
    motors: &MotorReferences,
) -> Result<(), Broken> {
    let (Some(output), Some(motors)) = (output, motors) else {
        return Err(Broken::Withheld);
    };
    monitor
        .check_tick(&output.state, &output.references)
        .map_err(Broken::Rule)?;
    let mut motors = motors.iter().zip(AXIS_OF_MOTOR);
    if motors.all(|(motor, axis)| output.references.get(axis) == Some(motor)) {
        Ok(())
    } else {
        Err(Broken::Motors)
    }
}

/// True if the cycle need not wait any longer for the owner's answer, `waited_ms` after the last
/// State.
fn is_due(machine: &mut Machine, waited_ms: u32) -> bool {
    let server = machine.server();
    let patience_ms = match server.session().phase() {
        Phase::Submit | Phase::Obtain => PATIENCE_MS,
        Phase::Handshake => HANDSHAKE_PATIENCE_MS,
        Phase::Listening | Phase::SafeDisconnect | Phase::Fault => return true,
    };
    server.owner_has_answered() || waited_ms >= patience_ms
}

/// Returns the sample of the force sensor after this number of ticks in Obtain.
fn sample(obtained: u32) -> [f64; 6] {
    let [fx, fy, fz, mx, my, mz] = UNLOADED;
    let pull_n = if obtained > PULL_AFTER { PULL_N } else { 0.0 };
    [fx, fy - pull_n, fz, mx, my, mz]
}

/// Returns a pose on the tool's path, along x, to and fro.
fn pose(step: u64) -> Pose6 {
    let along = step
        .checked_rem(PATH_UM.saturating_mul(2))
        .unwrap_or_default();
    let away = along.min(PATH_UM.saturating_mul(2).saturating_sub(along));
    let away_m = f64::from(u32::try_from(away).unwrap_or_default()) * 1e-6;
    let [x, y, z] = HOME_M;
    [x + away_m, y, z, 0.0, 0.0, 0.0]
}

/// Reads a decimal number. (That of a `str` links a panic.)
fn number(digits: &[u8]) -> Option<u32> {
    digits.iter().try_fold(0_u32, |number, digit| {
        let digit = digit.checked_sub(b'0').filter(|digit| *digit < 10)?;
        number.checked_mul(10)?.checked_add(digit.into())
    })
}
