//! A program's session with the server.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::client::{Event, Requirements};
use gantry_tau_core::control::message::{
    AxisFlags, Capabilities, Mode, Phase, Refusal, State, Welcome,
};
use gantry_tau_core::control::pacer::{Paced, Pacer, Settings, Target, TargetError};
use gantry_tau_core::units::{OffsetNm, Tick};
use gantry_tau_system::dial::LOOK;

use super::line::{self, Row};
use super::program::{Program, Programs};
use super::{Left, PaceOptions, PaceReport};
use crate::ClientError;
use crate::connection::Connection;
use crate::run::{PATIENCE, ended};

/// Longest time between now and that of a target.
const HORIZON: Duration = Duration::from_secs(10);
/// States after a new beginning that tell nothing of it: commands were under way.
const UNDER_WAY: u64 = 3;

/// Session of a program.
pub(super) struct Session<'a, const N: usize> {
    link: Connection<'a, N>,
    welcome: Welcome<N>,
    program: &'a mut Program,
    quit: &'a AtomicBool,
    settings: Settings,
    cycle_s: f64,
    /// Of a server in lock-step: shortest time between two answers, and the last one.
    pause: Duration,
    answered: Instant,
    /// Ticks between two lines to the program.
    row_ticks: u64,
    /// Mode that the program wants, and the one that was asked for last.
    wanted: Mode,
    asked: Mode,
    /// Absent until the first target, so that a program may listen first.
    pacer: Option<Pacer<N>>,
    /// Tick of the last State.
    now: Tick,
    /// First tick whose limits count.
    judged_from: u64,
    late: u64,
}

impl<'a, const N: usize> Session<'a, N> {
    /// Opens a session with the server.
    ///
    /// # Errors
    /// [`ClientError`].
    pub(super) fn open(
        options: &PaceOptions,
        program: &'a mut Program,
        quit: &'a AtomicBool,
    ) -> Result<Self, ClientError> {
        let requirements = Requirements {
            capabilities: Capabilities::LOCKSTEP,
            kinematics_checksum: Some(options.kinematics_checksum),
            ..Requirements::default()
        };
        let open = || {
            let (transport, server) = (options.transport, options.server.clone());
            let mut link =
                Connection::open_unless(quit, transport, server, PATIENCE, requirements)?
                    .with_key(options.key.clone())?;
            Ok((link.greet()?, link))
        };
        let (welcome, link) = loop {
            match open() {
                // The offsets of the program before are not zero yet.
                Err(ClientError::Refused(Refusal::Ramping { .. })) => thread::sleep(LOOK),
                opened => break opened?,
            }
        };
        if let Err(denied) = gantry_tau_server::realtime::raise_priority() {
            tracing::warn!("pacer: no {}: {}", denied.privilege, denied.reason);
        }
        let cycle_s = f64::from(welcome.cycle_us) * 1e-6;
        let is_lockstep = welcome.capabilities.contains(Capabilities::LOCKSTEP);
        let pause = if is_lockstep && !options.is_hurried {
            // The switch is looked at between two answers, however long a server says its cycle is.
            Duration::from_micros(welcome.cycle_us.into()).min(LOOK)
        } else {
            Duration::ZERO
        };
        let ticks = |time: Duration| (time.as_secs_f64() / cycle_s).round() as u32;
        Ok(Self {
            link,
            welcome,
            program,
            quit,
            settings: Settings {
                latency_ticks: ticks(options.latency),
                hold_ticks: ticks(options.hold),
                give_up_ticks: ticks(options.give_up),
                horizon_ticks: ticks(HORIZON),
            },
            cycle_s,
            pause,
            answered: Instant::now(),
            row_ticks: u64::from(ticks(options.period)).max(1),
            wanted: Mode::Submit,
            asked: Mode::Submit,
            pacer: None,
            now: welcome.tick,
            judged_from: 0,
            late: 0,
        })
    }

    /// Answers every State, until the program leaves or is silent for too long.
    ///
    /// # Errors
    /// [`ClientError`]: the server's ends.
    pub(super) fn hold(
        mut self,
        programs: &mut Programs,
        report: &mut PaceReport,
    ) -> Result<Left, ClientError> {
        loop {
            let state = match self.link.next_event() {
                Ok(Event::State(state)) => state,
                Ok(Event::Ended(state)) => return Err(ended(&state)),
                Ok(_) => continue,
                Err(ClientError::Quit) => return self.leave(Left::Quit),
                Err(error) => return Err(error),
            };
            if self.quit.load(Ordering::Relaxed) {
                return self.leave(Left::Quit);
            }
            if self.link.has_unread_bytes() {
                // A newer State is waiting: an answer to this one would be late.
                continue;
            }
            self.await_cycle();
            self.now = state.tick;
            self.hear(report)?;
            self.keep_up(&state);
            let Some(targets) = self.targets(state.phase) else {
                return self.leave(Left::Silent);
            };
            self.link.answer(self.wanted, &targets)?;
            // Behind the answer there is the rest of the cycle. The first row is of Submit, also of a
            // session that began in a tick with a row.
            if state.phase != Phase::Handshake && state.tick.0 % self.row_ticks == 0 {
                let row = Row::of(&state, self.cycle_s, self.late);
                self.program.send(&row);
            }
            self.program.flush();
            programs.send_away();
            if self.program.has_ended() {
                return self.leave(Left::Gone);
            }
        }
    }

    /// Waits until an answer to a server in lock-step is due.
    fn await_cycle(&mut self) {
        let due = self.answered + self.pause;
        thread::sleep(due.saturating_duration_since(Instant::now()));
        // What this process has missed is not made up for.
        let now = Instant::now();
        self.answered = if now < due + self.pause { due } else { now };
    }

    fn leave(mut self, left: Left) -> Result<Left, ClientError> {
        self.link.leave()?;
        Ok(left)
    }

    /// Takes what the program has sent.
    fn hear(&mut self, report: &mut PaceReport) -> Result<(), ClientError> {
        let mut lines = Vec::new();
        let (cycle_s, limits) = (self.cycle_s, &self.welcome.limits);
        self.program.lines(|line| {
            lines.push(match line {
                Ok(line) => line::read(line, cycle_s, limits),
                Err(error) => Err(error),
            });
        });
        for line in lines {
            let taken = match line {
                Ok((mode, target)) => self.take(mode, target)?,
                Err(error) => Err(error),
            };
            match taken {
                Ok(()) => report.targets = report.targets.saturating_add(1),
                Err(error) => {
                    report.refused = report.refused.saturating_add(1);
                    self.program.refuse(&error);
                }
            }
        }
        Ok(())
    }

    /// Takes a target, or says why not.
    fn take(&mut self, mode: Mode, target: Target<N>) -> Result<Result<(), String>, ClientError> {
        let is_first = self.pacer.is_none();
        let pacer = match &mut self.pacer {
            Some(pacer) => pacer,
            none => {
                let limits = self.welcome.limits.map(|axis| axis.position);
                let pacer = Pacer::new(limits, self.settings, self.now)
                    .map_err(|error| ClientError::Setup(error.to_string()))?;
                none.insert(pacer)
            }
        };
        let Err(error) = pacer.push(target) else {
            self.wanted = mode;
            return Ok(Ok(()));
        };
        if is_first {
            self.pacer = None;
        }
        if matches!(error, TargetError::Late { .. }) {
            self.late = self.late.saturating_add(1);
        }
        Ok(Err(format!("t: {error}")))
    }

    /// Begins again from what is in force, if the server is not where the pacer believes.
    fn keep_up(&mut self, state: &State<N>) {
        let Some(pacer) = &mut self.pacer else { return };
        let is_limited =
            (state.axes.iter()).any(|axis| axis.flags.contains(AxisFlags::POSITION_LIMITED));
        if !is_limited || state.tick.0 < self.judged_from {
            return;
        }
        self.judged_from = state.tick.0.saturating_add(UNDER_WAY);
        pacer.restart(&state.axes.map(|axis| match state.phase {
            Phase::Submit => axis.shadow.position,
            _ => axis.offsets.position,
        }));
    }

    /// Targets of the next command; `None` if the program is given up.
    fn targets(&mut self, phase: Phase) -> Option<[Offsets; N]> {
        let Some(pacer) = &mut self.pacer else {
            return Some([Offsets::ZERO; N]);
        };
        let zero = [OffsetNm(0); N];
        // No channel follows the first command, nor those that lead from Obtain back to Submit.
        let follows = !matches!(
            (phase, self.wanted),
            (Phase::Handshake, _) | (Phase::Obtain, Mode::Submit)
        );
        // Submit and Obtain begin at zero.
        if self.asked != self.wanted {
            pacer.restart(&zero);
        }
        self.asked = self.wanted;
        let Paced::Targets(targets) = pacer.tick(self.now) else {
            return None;
        };
        if follows {
            return Some(targets.map(Offsets::position));
        }
        pacer.restart(&zero);
        Some([Offsets::ZERO; N])
    }
}
