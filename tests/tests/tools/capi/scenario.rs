//! Random traffic, kind and hostile, against `tests/play.c` and against core: everything that comes out agrees, for every kind of
//! server that C can have. The C program is told what to call; what it prints is compared letter by letter.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::Write as _;
use std::process::{Command, Stdio};

use gantry_tau::black_box::Window;
use gantry_tau_core::control::axis::{Actual, Offsets};
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::endpoint::{Cycle, Endpoint, MotorMap, Transport, Turn};
use gantry_tau_core::control::message::{
    AxisLimits, Capabilities, Cause, ClientMessage, Command as Wanted, Hello, Mode, Phase, State,
};
use gantry_tau_core::control::session::Session;
use gantry_tau_core::control::session::config::{
    AxisConfig, Config, MissBudget, Parameters, Travel,
};
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::control::wire::{encode_client, encode_state};
use gantry_tau_core::units::{
    Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS,
};
use libtest_mimic::Failed;

use super::tools::Program;

const MOTORS: usize = 9;
const TICKS: u32 = 4_000;

/// All four kinds of servers.
pub(crate) fn agrees(compiler: &str, flags: &[&str]) -> Result<(), Failed> {
    let program = Program::compile("tests/play.c", compiler, flags)?;
    compare(&program, &Play::<3, 0>::new(3).played())?;
    compare(&program, &Play::<3, 64>::new(4).played())?;
    compare(&program, &Play::<6, 0>::new(5).played())?;
    compare(&program, &Play::<6, 64>::new(6).played())
}

/// What is called, and what must come out.
struct Played {
    script: String,
    expected: String,
}

fn compare(program: &Program, played: &Played) -> Result<(), Failed> {
    let mut child = Command::new(program.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()?;
    let mut input = child.stdin.take().unwrap();
    let script = played.script.clone();
    let writer = std::thread::spawn(move || input.write_all(script.as_bytes()));
    let output = child.wait_with_output()?;
    writer.join().unwrap()?;
    let there = String::from_utf8(output.stdout)?;
    for (number, (there, here)) in there.lines().zip(played.expected.lines()).enumerate() {
        assert_eq!(there, here, "line {}", number + 1);
    }
    assert_eq!(there.lines().count(), played.expected.lines().count());
    assert!(output.status.success(), "{}", output.status);
    Ok(())
}

/// Core, and what is done to it.
struct Play<const N: usize, const HALF: usize> {
    endpoint: Endpoint<N, MOTORS, HALF>,
    open: Vec<Connection>,
    nominal: [i64; N],
    random: u64,
    /// Ticks in which nobody is heard.
    silent: u64,
    phases: BTreeSet<String>,
    causes: BTreeSet<String>,
    played: Played,
}

impl<const N: usize, const HALF: usize> Play<N, HALF> {
    fn new(seed: u64) -> Self {
        let limits = |max, step, accel, ramp| Limits::new(max, step, accel, ramp).unwrap();
        let position = limits(2_000_000, 5_000, 10_000, 100);
        let axis = AxisConfig {
            limits: AxisLimits {
                position,
                velocity: limits(5_000, 200, 400, 50),
                torque: limits(50, 5, 10, 1),
            },
            ..AxisConfig::position_only(position, Travel::around_zero(1_000_000_000), 2_000_000)
        };
        let config = Config::new(Parameters {
            handshake_ticks: 40,
            budget: Some(MissBudget {
                window: 100,
                allowed: 20,
            }),
            ..Parameters::thesis([axis; N])
        });
        let at_rest = [Offsets::default(); N];
        let session = Session::new(
            config.unwrap(),
            &at_rest,
            [PositionNm(0); N],
            Tick(0),
            Epoch(0),
        );
        let motors = MotorMap::new(std::array::from_fn(|motor| motor % N));
        Self {
            endpoint: Endpoint::new(session.unwrap(), motors.unwrap()),
            open: Vec::new(),
            nominal: [0; N],
            silent: 0,
            random: seed.wrapping_mul(0x9e37_79b9_7f4a_7c15),
            phases: BTreeSet::new(),
            causes: BTreeSet::new(),
            played: Played {
                script: format!("axes {N} black_box {HALF}\n"),
                expected: String::new(),
            },
        }
    }

    fn played(mut self) -> Played {
        for tick in 1..=TICKS {
            self.connections();
            for connection in self.open.clone() {
                self.speak(connection);
            }
            self.tick();
            if tick % 200 == 0 {
                self.black_box();
            }
        }
        // A play in which nothing happens shows nothing.
        assert_eq!(self.phases.len(), 6, "{:?}", self.phases);
        assert!(self.causes.len() >= 5, "{:?}", self.causes);
        self.played
    }

    /// xorshift64*.
    fn below(&mut self, end: u64) -> u64 {
        self.random ^= self.random >> 12;
        self.random ^= self.random << 25;
        self.random ^= self.random >> 27;
        (self.random.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) % end
    }

    fn one_in(&mut self, count: u64) -> bool {
        self.below(count) == 0
    }

    fn connections(&mut self) {
        if self.open.is_empty() || self.one_in(20) {
            let datagram = self.one_in(3);
            let transport = if datagram {
                Transport::Datagram
            } else {
                Transport::Stream
            };
            writeln!(self.played.script, "o {}", u8::from(datagram)).unwrap();
            let opened = self.endpoint.open(transport);
            let (code, number) = opened.map_or(("GT_CODE_FULL", 0), |connection| {
                ("GT_CODE_OK", connection.0)
            });
            self.open.extend(opened);
            writeln!(self.played.expected, "open {code} {number}").unwrap();
        }
        if self.one_in(150) {
            let index = usize::try_from(self.below(6)).unwrap();
            let connection = self.open.get(index).copied().unwrap_or(Connection(99_999));
            self.endpoint.close(connection);
            self.open.retain(|open| *open != connection);
            writeln!(self.played.script, "c {}", connection.0).unwrap();
        }
    }

    /// What a connection has to say in this tick: mostly what is right, else anything.
    fn speak(&mut self, connection: Connection) {
        let discrete = self.endpoint.session().parts().discrete;
        let owns = discrete.owner == Some(connection);
        if self.silent > 0 {
            return;
        }
        if !owns && !self.one_in(6) {
            return;
        }
        if owns && self.one_in(25) {
            return;
        }
        let mut bytes = if owns {
            self.command().to_vec()
        } else {
            self.hello()
        };
        if self.one_in(70) {
            bytes = self.anything(&bytes);
        }
        // Now and then in pieces, as a stream may come; a datagram that is cut is broken.
        if self.one_in(8) {
            let cut = usize::try_from(self.below(40)).unwrap();
            let (first, rest) = bytes.split_at(cut.min(bytes.len()));
            self.feed(connection, first);
            self.feed(connection, rest);
        } else {
            self.feed(connection, &bytes);
        }
    }

    fn feed(&mut self, connection: Connection, bytes: &[u8]) {
        let fed = self.endpoint.feed(connection, bytes);
        let text = if bytes.is_empty() {
            "-".to_owned()
        } else {
            hex(bytes)
        };
        writeln!(self.played.script, "f {} {text}", connection.0).unwrap();
        writeln!(self.played.expected, "fed {fed}").unwrap();
    }

    fn hello(&mut self) -> Vec<u8> {
        let axes = if self.one_in(10) {
            5
        } else {
            u8::try_from(N).unwrap()
        };
        let capabilities = Capabilities::NONE;
        encode_client(&ClientMessage::<N>::Hello(Hello { axes, capabilities })).to_vec()
    }

    /// The right answer to the last State, or nearly.
    fn command(&mut self) -> Vec<u8> {
        let discrete = self.endpoint.session().parts().discrete;
        let late = u64::from(self.one_in(30));
        let beyond = if self.one_in(40) { 1_000 } else { 1 };
        let mode = if discrete.accepted.0 < 3 || self.one_in(60) {
            Mode::Submit
        } else {
            Mode::Obtain
        };
        let mut target = |max: u64| {
            i64::try_from(self.below(2 * max + 1)).unwrap() - i64::try_from(max).unwrap()
        };
        let targets = std::array::from_fn(|_| Offsets {
            position: OffsetNm(i32::try_from(target(3_000) * beyond).unwrap()),
            velocity: VelocityUmS(i32::try_from(target(5_000)).unwrap()),
            torque: TorquePermille(i16::try_from(target(50)).unwrap()),
        });
        encode_client(&ClientMessage::<N>::Command(Wanted {
            epoch: discrete.epoch,
            sequence: Sequence(discrete.accepted.0 + 1 - late),
            echo: Tick(discrete.tick.0 - late),
            mode,
            targets,
        }))
        .to_vec()
    }

    /// Something else instead.
    fn anything(&mut self, right: &[u8]) -> Vec<u8> {
        let epoch = self.endpoint.session().parts().discrete.epoch;
        let index = usize::try_from(self.below(u64::try_from(right.len()).unwrap())).unwrap();
        let byte = u8::try_from(self.below(256)).unwrap();
        match self.below(8) {
            0 => encode_client(&ClientMessage::<N>::Goodbye(epoch)).to_vec(),
            1 => encode_client(&ClientMessage::<N>::Stop(epoch)).to_vec(),
            2 => right.repeat(2),
            3 => right.repeat(12),
            4 => right.get(..index).unwrap().to_vec(),
            5 => (0..index).map(|_| byte).collect(),
            // Another version, which is told so.
            6 => right
                .iter()
                .enumerate()
                .map(|(at, there)| if at == 2 { 9 } else { *there })
                .collect(),
            _ => right
                .iter()
                .enumerate()
                .map(|(at, there)| if at == index { byte } else { *there })
                .collect(),
        }
    }

    fn tick(&mut self) {
        self.silent = self.silent.saturating_sub(1);
        if self.one_in(120) {
            self.silent = self.below(60);
        }
        if self.one_in(700) {
            self.resume();
        }
        let discrete = self.endpoint.session().parts().discrete;
        let faulted = discrete.phase == Phase::Fault;
        let jump = if self.one_in(1_000) { 3_000_000 } else { 1_000 };
        self.nominal = self.nominal.map(|nominal| (nominal + jump) % 900_000_000);
        let cycle = Cycle {
            elapsed: if self.one_in(300) { 2 } else { 1 },
            nominal: self.nominal.map(PositionNm),
            actual: self.nominal.map(|nominal| Actual {
                position: PositionNm(nominal - 77),
                velocity: VelocityUmS(-5),
                torque: TorquePermille(3),
            }),
            // In the fault both at once, too.
            stop: self.one_in(if faulted { 8 } else { 500 }),
            rearm: self.one_in(if faulted { 2 } else { 100 }),
            next_epoch: Epoch(discrete.epoch.0 + 1),
            arrival_us: u16::try_from(self.below(1_000)).unwrap(),
        };
        self.script_tick(&cycle);
        let mut frames = String::new();
        let turn = self.endpoint.tick(&cycle, &mut |to: Connection, bytes| {
            writeln!(frames, "frame {} {}", to.0, hex(bytes)).unwrap();
        });
        self.open.retain(|open| !turn.close.contains(open));
        self.phases.insert(format!("{:?}", turn.output.state.phase));
        self.causes
            .extend(turn.output.ended.map(|cause| format!("{cause:?}")));
        expect_turn(&mut self.played.expected, &turn);
        self.played.expected += &frames;
    }

    fn script_tick(&mut self, cycle: &Cycle<N>) {
        // Not 0 is yes.
        let mut yes = |yes: bool| u64::from(yes) * (1 + self.below(255));
        let (stop, rearm) = (yes(cycle.stop), yes(cycle.rearm));
        let script = &mut self.played.script;
        write!(
            script,
            "t {} {stop} {rearm} {} {}",
            cycle.elapsed, cycle.arrival_us, cycle.next_epoch.0
        )
        .unwrap();
        for index in 0..6 {
            write!(
                script,
                " {}",
                cycle.nominal.get(index).map_or(1, |nominal| nominal.0)
            )
            .unwrap();
        }
        for index in 0..6 {
            let actual = cycle.actual.get(index).copied().unwrap_or_default();
            write!(
                script,
                " {} {} {}",
                actual.position.0, actual.velocity.0, actual.torque.0
            )
            .unwrap();
        }
        script.push('\n');
    }

    /// The drives have something else in force; sometimes more than there may be.
    fn resume(&mut self) {
        // The ramp takes a tick per 100 nm: short, or no session would follow.
        let beyond = if self.one_in(3) { 2_010_000 } else { 0 };
        let position = i32::try_from(self.below(6_000)).unwrap() - 3_000 + beyond;
        let offsets = Offsets {
            position: OffsetNm(position),
            velocity: VelocityUmS(17),
            torque: TorquePermille(-2),
        };
        let code = match self.endpoint.resume(&[offsets; N]) {
            Ok(()) => "GT_CODE_OK",
            Err(_) => "GT_CODE_START_OFFSET_IN_FORCE",
        };
        let numbers = format!(" {position} 17 -2").repeat(6);
        writeln!(self.played.script, "r{numbers}").unwrap();
        writeln!(self.played.expected, "resume {code}").unwrap();
    }

    fn black_box(&mut self) {
        let black_box = self.endpoint.black_box();
        let (ticks, frozen) = (black_box.entries().count(), u8::from(black_box.is_frozen()));
        writeln!(self.played.expected, "black box {ticks} frozen {frozen}").unwrap();
        self.played.expected +=
            &Window::of(black_box).map_or_else(String::new, |window| window.encode());
        self.endpoint.black_box_mut().release();
        self.played.script.push_str("b\n");
    }
}

fn expect_turn<const N: usize>(text: &mut String, turn: &Turn<N, MOTORS>) {
    let output = &turn.output;
    for motor in &turn.motors {
        let (velocity, torque) = (motor.velocity_offset.0, motor.torque_offset.0);
        writeln!(text, "motor {} {velocity} {torque}", motor.position.0).unwrap();
    }
    let owner = output
        .owner
        .map_or_else(String::new, |owner| format!(" {}", owner.0));
    let close: String = turn
        .close
        .iter()
        .map(|close| format!(" {}", close.0))
        .collect();
    let (refused, welcomed) = (output.refusals.len(), u8::from(output.welcome.is_some()));
    let ended = codes(&State {
        cause: output.ended.unwrap_or(Cause::None),
        ..output.state
    })
    .1;
    writeln!(
        text,
        "turn refused {refused} welcomed {welcomed} owner{owner} ended {ended} close{close}"
    )
    .unwrap();
    expect_state(text, &output.state);
}

fn expect_state<const N: usize>(text: &mut String, state: &State<N>) {
    let (phase, cause) = codes(state);
    let (tick, epoch, accepted) = (state.tick.0, state.epoch.0, state.accepted.0);
    let (left, arrival, on_time) = (
        state.ramp_ticks_left,
        state.arrival_us,
        state.on_time_of_100,
    );
    writeln!(text, "state {tick} {epoch} {accepted} phase {phase} cause {cause} left {left} arrival {arrival} on_time {on_time}").unwrap();
    let c = &state.counters;
    let counters = [
        c.received,
        c.missed,
        c.late,
        c.duplicate,
        c.stale,
        c.malformed,
        c.out_of_range,
        c.limited,
        c.clamped,
        c.strangers,
        u32::from(c.longest_miss_run),
    ];
    let counters: String = counters.iter().map(|count| format!(" {count}")).collect();
    writeln!(text, "counters{counters}").unwrap();
    let offsets = |offsets: &Offsets| {
        format!(
            "{} {} {}",
            offsets.position.0, offsets.velocity.0, offsets.torque.0
        )
    };
    for axis in &state.axes {
        let (nominal, flags, actual) = (axis.nominal.0, axis.flags.bits(), &axis.actual);
        let (in_force, shadow) = (offsets(&axis.offsets), offsets(&axis.shadow));
        let actual = format!(
            "{} {} {}",
            actual.position.0, actual.velocity.0, actual.torque.0
        );
        writeln!(
            text,
            "axis {nominal} offsets {in_force} shadow {shadow} actual {actual} flags {flags}"
        )
        .unwrap();
    }
}

/// Numbers of phase and cause, as the wire has them: the bytes after header, tick, epoch and sequence.
fn codes<const N: usize>(state: &State<N>) -> (u8, u8) {
    let frame = encode_state(state);
    (frame[6 + 24], frame[6 + 25])
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
