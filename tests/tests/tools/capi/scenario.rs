//! Random traffic, valid and hostile, through `tests/scenario.c` and through core: all results agree, for every kind of server in C.
//! The C program receives a script of calls; its output is compared line by line, and its black boxes with core's.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::Write as _;
use std::process::{Command, Stdio};

use gantry_tau::black_box::Window;
use gantry_tau_core::control::axis::{Actual, InForce, Offsets, Reference};
use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::endpoint::{Endpoint, MotorMap, Transport};
use gantry_tau_core::control::message::{
    AxisLimits, Capabilities, ClientMessage, Command as Wanted, Hello, Mode, Phase, State,
};
use gantry_tau_core::control::session::config::{AxisConfig, Config, MissBudget, Parameters, Travel};
use gantry_tau_core::control::session::{BlackBox, Connection, LastWrite, Output, Session, Start, TickInput};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::{Epoch, EpochRange, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS};
use libtest_mimic::Failed;

use super::tools::{Program, from_hex, hex};

const MOTORS: usize = 9;
const TICKS: u32 = 4_000;

/// Runs all four kinds of servers.
pub(crate) fn agrees(compiler: &str, flags: &[&str]) -> Result<(), Failed> {
    let program = Program::compile("tests/scenario.c", compiler, flags)?;
    compare(&program, &Scenario::<3, 0>::new(3).run())?;
    compare(&program, &Scenario::<3, 64>::new(4).run())?;
    compare(&program, &Scenario::<6, 0>::new(5).run())?;
    compare(&program, &Scenario::<6, 64>::new(6).run())
}

/// Calls, and their results.
struct Recorded<const N: usize> {
    script: String,
    expected: String,
    black_boxes: Vec<Window<N>>,
}

fn compare<const N: usize>(program: &Program, recorded: &Recorded<N>) -> Result<(), Failed> {
    let mut child = Command::new(program.path()).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
    let mut input = child.stdin.take().unwrap();
    let script = recorded.script.clone();
    let writer = std::thread::spawn(move || input.write_all(script.as_bytes()));
    let output = child.wait_with_output()?;
    writer.join().unwrap()?;
    let text = String::from_utf8(output.stdout)?;
    let (parts, lines): (Vec<_>, Vec<_>) = text.lines().partition(|line| line.starts_with("part "));
    for (number, (there, here)) in lines.iter().zip(recorded.expected.lines()).enumerate() {
        assert_eq!(*there, here, "line {}", number + 1);
    }
    assert_eq!(lines.len(), recorded.expected.lines().count());
    assert!(output.status.success(), "{}", output.status);
    let mut files: Vec<Vec<u8>> = Vec::new();
    for part in parts {
        let bytes = from_hex(&part["part ".len()..]);
        if bytes.starts_with(b"GTBB") {
            files.push(Vec::new());
        }
        files.last_mut().unwrap().extend(bytes);
    }
    assert_eq!(files.len(), recorded.black_boxes.len());
    for (file, here) in files.iter().zip(&recorded.black_boxes) {
        assert!(Window::decode("the black box", file).unwrap() == *here);
    }
    Ok(())
}

/// Core's server, and the calls to it.
struct Scenario<const N: usize, const HALF: usize> {
    endpoint: Endpoint<N, MOTORS>,
    black_box: Box<BlackBox<N, HALF>>,
    open: Vec<Connection>,
    nominal: [i64; N],
    random: u64,
    /// Ticks left in which no client sends.
    silent: u64,
    phases: BTreeSet<&'static str>,
    causes: BTreeSet<&'static str>,
    withheld: usize,
    recorded: Recorded<N>,
}

fn limits<U>(max: i32, step: i32, accel: i32, ramp: i32) -> Limits<U> {
    let values = LimitValues { max, step, accel, ramp };
    Limits::new(values).unwrap()
}

impl<const N: usize, const HALF: usize> Scenario<N, HALF> {
    fn new(seed: u64) -> Self {
        let position = limits(2_000_000, 5_000, 10_000, 100);
        let axis = AxisConfig {
            limits: AxisLimits { position, velocity: limits(5_000, 200, 400, 50), torque: limits(50, 5, 10, 1) },
            ..AxisConfig::position_only(position, Travel::around_zero(1_000_000_000), 2_000_000)
        };
        let config = Config::new(Parameters {
            handshake_ticks: 40,
            budget: Some(MissBudget { window: 100, allowed: 20 }),
            ..Parameters::thesis([axis; N])
        });
        let session = Session::new(config.unwrap(), &Start::at_rest([PositionNm(0); N]));
        let motors = MotorMap::new(std::array::from_fn(|motor| motor % N));
        let epochs = EpochRange { first: Epoch(1), last: Epoch(4) };
        Self {
            endpoint: Endpoint::new(session.unwrap(), motors.unwrap(), epochs),
            black_box: Box::new(BlackBox::new()),
            open: Vec::new(),
            nominal: [0; N],
            silent: 0,
            random: seed.wrapping_mul(0x9e37_79b9_7f4a_7c15),
            phases: BTreeSet::new(),
            causes: BTreeSet::new(),
            withheld: 0,
            recorded: Recorded {
                script: format!("axes {N} black_box {HALF}\n"),
                expected: String::new(),
                black_boxes: Vec::new(),
            },
        }
    }

    fn run(mut self) -> Recorded<N> {
        for tick in 1..=TICKS {
            self.connections();
            if self.one_in(100) {
                self.epochs();
            }
            for connection in self.open.clone() {
                self.speak(connection);
            }
            self.tick();
            if tick % 200 == 0 {
                self.black_box();
            }
        }
        // A scenario must reach all phases, and most causes.
        assert_eq!(self.phases.len(), 6, "{:?}", self.phases);
        assert!(self.causes.len() >= 5, "{:?}", self.causes);
        assert!(self.withheld > 0, "references were never withheld");
        self.recorded
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
            let transport = if datagram { Transport::Datagram } else { Transport::Stream };
            writeln!(self.recorded.script, "o {}", u8::from(datagram)).unwrap();
            let opened = self.endpoint.open(transport);
            let (code, number) = opened.map_or(("GT_CODE_FULL", 0), |connection| ("GT_CODE_OK", connection.0));
            self.open.extend(opened);
            writeln!(self.recorded.expected, "open {code} {number}").unwrap();
        }
        if self.one_in(150) {
            let index = usize::try_from(self.below(6)).unwrap();
            let connection = self.open.get(index).copied().unwrap_or(Connection(99_999));
            self.endpoint.close(connection);
            self.open.retain(|open| *open != connection);
            writeln!(self.recorded.script, "c {}", connection.0).unwrap();
        }
    }

    /// Sends the bytes of a connection in this tick: mostly valid ones.
    fn speak(&mut self, connection: Connection) {
        let owns = self.endpoint.session().owner() == Some(connection);
        if self.silent > 0 {
            return;
        }
        if !owns && !self.one_in(6) {
            return;
        }
        if owns && self.one_in(25) {
            return;
        }
        let mut bytes = if owns { self.command().to_vec() } else { self.hello() };
        if self.one_in(70) {
            bytes = self.anything(&bytes);
        }
        // Now and then in pieces, as streams are read; a datagram in pieces is broken.
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
        let text = if bytes.is_empty() { "-".to_owned() } else { hex(bytes) };
        writeln!(self.recorded.script, "f {} {text}", connection.0).unwrap();
        writeln!(self.recorded.expected, "fed {fed}").unwrap();
    }

    fn hello(&mut self) -> Vec<u8> {
        let axes = if self.one_in(10) { 5 } else { u8::try_from(N).unwrap() };
        let capabilities = Capabilities::NONE;
        encode_client(&ClientMessage::<N>::Hello(Hello { axes, capabilities })).to_vec()
    }

    /// The right answer to the last State, or nearly.
    fn command(&mut self) -> Vec<u8> {
        let (session, output) = (self.endpoint.session(), self.endpoint.output());
        let (epoch, last_tick) = (session.epoch(), session.last_tick());
        let accepted = output.map_or(0, |output| output.state.accepted.0);
        let late = u64::from(self.one_in(30));
        let beyond = if self.one_in(40) { 1_000 } else { 1 };
        let mode = if accepted < 3 || self.one_in(60) { Mode::Submit } else { Mode::Obtain };
        let mut target = |max: u64| i64::try_from(self.below(2 * max + 1)).unwrap() - i64::try_from(max).unwrap();
        let targets = std::array::from_fn(|_| Offsets {
            position: OffsetNm(i32::try_from(target(3_000) * beyond).unwrap()),
            velocity: VelocityUmS(i32::try_from(target(5_000)).unwrap()),
            torque: TorquePermille(i16::try_from(target(50)).unwrap()),
        });
        encode_client(&ClientMessage::<N>::Command(Wanted {
            epoch,
            sequence: Sequence(accepted + 1 - late),
            echo: Tick(last_tick.0 - late),
            mode,
            targets,
        }))
        .to_vec()
    }

    /// Returns other bytes instead.
    fn anything(&mut self, right: &[u8]) -> Vec<u8> {
        let epoch = self.endpoint.session().epoch();
        let index = usize::try_from(self.below(u64::try_from(right.len()).unwrap())).unwrap();
        let byte = u8::try_from(self.below(256)).unwrap();
        match self.below(8) {
            0 => encode_client(&ClientMessage::<N>::Goodbye(epoch)).to_vec(),
            1 => encode_client(&ClientMessage::<N>::Stop(epoch)).to_vec(),
            2 => right.repeat(2),
            3 => right.repeat(12),
            4 => right.get(..index).unwrap().to_vec(),
            5 => (0..index).map(|_| byte).collect(),
            // Another version, which is answered.
            6 => right.iter().enumerate().map(|(at, there)| if at == 2 { 9 } else { *there }).collect(),
            _ => right.iter().enumerate().map(|(at, there)| if at == index { byte } else { *there }).collect(),
        }
    }

    fn tick(&mut self) {
        self.silent = self.silent.saturating_sub(1);
        if self.one_in(120) {
            self.silent = self.below(60);
        }
        let faulted = self.endpoint.session().phase() == Phase::Fault;
        let last_write = self.last_write();
        let jump = if self.one_in(1_000) { 3_000_000 } else { 1_000 };
        self.nominal = self.nominal.map(|nominal| (nominal + jump) % 900_000_000);
        let input = TickInput {
            elapsed_cycles: if self.one_in(300) { 2 } else { 1 },
            nominal: self.nominal.map(PositionNm),
            actual: self.nominal.map(|nominal| Actual {
                position: PositionNm(nominal - 77),
                velocity: VelocityUmS(-5),
                torque: TorquePermille(3),
            }),
            // In the fault both at once, too.
            stop: self.one_in(if faulted { 8 } else { 500 }),
            rearm: self.one_in(if faulted { 2 } else { 100 }),
            last_write,
            arrival_us: u16::try_from(self.below(1_000)).unwrap(),
        };
        self.script_tick(&input);
        let references = self.endpoint.tick_recorded(&input, &mut *self.black_box);
        let output = self.endpoint.output().unwrap().clone();
        self.phases.insert(output.state.phase.name());
        self.causes.extend(output.ended.map(|cause| cause.name()));
        self.withheld += usize::from(references.is_none());
        let expected = &mut self.recorded.expected;
        expect_output(expected, references.as_ref(), &output);
        while let Some((to, frame)) = self.endpoint.poll_transmit() {
            writeln!(expected, "frame {} {}", to.0, hex(frame)).unwrap();
        }
        expected.push_str("GT_CODE_DONE\n");
        while let Some(connection) = self.endpoint.poll_close() {
            self.open.retain(|open| *open != connection);
            writeln!(expected, "close {}", connection.0).unwrap();
        }
        expected.push_str("GT_CODE_DONE\n");
    }

    /// Returns the fate of the last references: now and then refused, with values in force that may be beyond their limits, or
    /// unknown; after that the values are soon read back.
    fn last_write(&mut self) -> LastWrite<N> {
        let withheld = self.endpoint.output().is_some_and(|output| output.withheld);
        if !self.one_in(if withheld { 3 } else { 700 }) {
            return LastWrite::Accepted;
        }
        let beyond = match self.below(4) {
            0 => return LastWrite::Unknown,
            1 => 2_010_000,
            _ => 0,
        };
        // The ramp takes a tick per 100 nm: a short one, so that a session can follow.
        let position = i32::try_from(self.below(6_000)).unwrap() - 3_000 + beyond;
        let offsets = Offsets { position: OffsetNm(position), velocity: VelocityUmS(17), torque: TorquePermille(-2) };
        let in_force = self.nominal.map(|nominal| InForce { nominal: PositionNm(nominal), offsets });
        LastWrite::Refused { in_force }
    }

    fn script_tick(&mut self, input: &TickInput<N>) {
        let mut in_force = [InForce::at(PositionNm(0)); N];
        let last_write = match input.last_write {
            LastWrite::Accepted => 1,
            LastWrite::Refused { in_force: there } => {
                in_force = there;
                2
            }
            LastWrite::Unknown => 3,
        };
        let switch = |pressed| if pressed { 2 } else { 1 };
        let mut numbers: Vec<i64> = vec![
            input.elapsed_cycles.into(),
            switch(input.stop),
            switch(input.rearm),
            last_write,
            input.arrival_us.into(),
        ];
        for index in 0..6 {
            numbers.push(input.nominal.get(index).map_or(1, |nominal| nominal.0));
        }
        for index in 0..6 {
            let Actual { position, velocity, torque } = input.actual.get(index).copied().unwrap_or_default();
            numbers.extend([position.0, velocity.0.into(), torque.0.into()]);
        }
        for index in 0..6 {
            let unused = InForce::at(PositionNm(5));
            let in_force = in_force.get(index).copied().unwrap_or(unused);
            let Offsets { position, velocity, torque } = in_force.offsets;
            let offsets = [position.0, velocity.0, torque.0.into()].map(i64::from);
            numbers.push(in_force.nominal.0);
            numbers.extend(offsets);
        }
        self.recorded.script.push('t');
        for number in numbers {
            write!(self.recorded.script, " {number}").unwrap();
        }
        self.recorded.script.push('\n');
    }

    /// Gives a further range of epochs; now and then one that is used up already, or empty.
    fn epochs(&mut self) {
        let used = self.endpoint.session().epoch().0;
        let first = used + self.below(3);
        let last = (first + self.below(5)).saturating_sub(1);
        self.endpoint.set_epochs(EpochRange { first: Epoch(first), last: Epoch(last) });
        writeln!(self.recorded.script, "e {first} {last}").unwrap();
    }

    fn black_box(&mut self) {
        let black_box = &mut self.black_box;
        let window = Window::of(black_box);
        let ticks = window.as_ref().map_or(0, |window| window.entries.len());
        let frozen = u8::from(black_box.is_frozen());
        black_box.release();
        self.recorded.black_boxes.extend(window);
        writeln!(self.recorded.expected, "black box {ticks} frozen {frozen}").unwrap();
        self.recorded.script.push_str("b\n");
    }
}

fn expect_output<const N: usize>(text: &mut String, references: Option<&[Reference; MOTORS]>, output: &Output<N>) {
    writeln!(text, "write {}", u8::from(references.is_some())).unwrap();
    for motor in 0..MOTORS {
        let numbers = references.map_or((0, 0, 0), |references| {
            let reference = references[motor];
            (reference.position.0, reference.velocity_offset.0, reference.torque_offset.0)
        });
        writeln!(text, "motor {} {} {}", numbers.0, numbers.1, numbers.2).unwrap();
    }
    let owner = output.owner.map_or_else(String::new, |owner| format!(" {}", owner.0));
    let (refused, welcomed) = (output.refusals.len(), u8::from(output.welcome.is_some()));
    let ended = output.ended.unwrap_or_default().code();
    writeln!(text, "refused {refused} welcomed {welcomed} owner{owner} ended {ended}").unwrap();
    expect_state(text, &output.state);
}

fn expect_state<const N: usize>(text: &mut String, state: &State<N>) {
    let (phase, cause) = (state.phase.code(), state.cause.code());
    let (tick, epoch, accepted) = (state.tick.0, state.epoch.0, state.accepted.0);
    let (left, arrival, on_time) = (state.ramp_ticks_left, state.arrival_us, state.on_time_of_100);
    writeln!(
        text,
        "state {tick} {epoch} {accepted} phase {phase} cause {cause} left {left} arrival {arrival} on_time {on_time}"
    )
    .unwrap();
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
        c.non_owner,
        u32::from(c.longest_miss_run),
    ];
    let counters: String = counters.iter().map(|count| format!(" {count}")).collect();
    writeln!(text, "counters{counters}").unwrap();
    let offsets = |offsets: &Offsets| format!("{} {} {}", offsets.position.0, offsets.velocity.0, offsets.torque.0);
    for axis in &state.axes {
        let (nominal, flags, actual) = (axis.nominal.0, axis.flags.bits(), &axis.actual);
        let (in_force, shadow) = (offsets(&axis.offsets), offsets(&axis.shadow));
        let actual = format!("{} {} {}", actual.position.0, actual.velocity.0, actual.torque.0);
        writeln!(text, "axis {nominal} offsets {in_force} shadow {shadow} actual {actual} flags {flags}").unwrap();
    }
}
