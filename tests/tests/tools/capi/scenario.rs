//! Random traffic, valid and hostile, through `tests/scenario.c` and through core: all results
//! agree, for every kind of server in C. The C program receives a script of calls; its output is
//! compared line by line, and its black boxes with core's.

use std::fmt::Write as _;
use std::io::Write as _;
use std::process::{Command, Stdio};

use gantry_tau_core::control::axis::{Actual, InForce, Offsets, Reference};
use gantry_tau_core::control::endpoint::{Endpoint, MotorMap, Transport, Write};
use gantry_tau_core::control::message::{Cause, ClientMessage, Phase};
use gantry_tau_core::control::session::config::{Config, MissBudget, Parameters};
use gantry_tau_core::control::session::{
    BlackBox, Connection, LastWrite, Output, Reading, Session, Start, TickInput,
};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::{
    Epoch, EpochRange, ForceMn, MomentUnm, OffsetNm, PositionNm, TorquePermille, VelocityUmS,
    WrenchSample,
};
use gantry_tau_proofs::scenario::ClientAction;
use gantry_tau_server::black_box::Window;
use gantry_tau_tests::client::Noise;
use gantry_tau_tests::server_fixture::parameters;
use libtest_mimic::Failed;

use super::tools::{Program, assert_lines, from_hex, hex, motor_line};

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
    let mut child = Command::new(program.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()?;
    let mut input = child.stdin.take().unwrap();
    let script = recorded.script.clone();
    let writer = std::thread::spawn(move || input.write_all(script.as_bytes()));
    let output = child.wait_with_output()?;
    writer.join().unwrap()?;
    let text = String::from_utf8(output.stdout)?;
    let (parts, lines): (Vec<_>, Vec<_>) = text.lines().partition(|line| line.starts_with("part "));
    assert_lines(&lines.join("\n"), &recorded.expected);
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
        assert!(gantry_tau_record::black_box::decode("the black box", file).unwrap() == *here);
    }
    Ok(())
}

/// Core's server, and the calls to it.
struct Scenario<const N: usize, const HALF: usize> {
    endpoint: Endpoint<N>,
    motors: MotorMap<N, MOTORS>,
    black_box: Box<BlackBox<N, HALF>>,
    open: Vec<Connection>,
    nominal: [i64; N],
    noise: Noise,
    /// Ticks left in which no client sends.
    silent: usize,
    recorded: Recorded<N>,
}

/// Bytes with another byte at a place.
fn with(bytes: &[u8], place: usize, byte: u8) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    bytes[place] = byte;
    bytes
}

impl<const N: usize, const HALF: usize> Scenario<N, HALF> {
    fn new(seed: u64) -> Self {
        let budget = Some(MissBudget {
            window: 100,
            allowed: 20,
        });
        let config = Config::new(Parameters {
            handshake_ticks: 40,
            budget,
            ..parameters()
        });
        let session = Session::new(config.unwrap(), &Start::at_rest([PositionNm(0); N]));
        let motors = MotorMap::new(std::array::from_fn(|motor| motor % N));
        let epochs = EpochRange {
            first: Epoch(1),
            last: Epoch(4),
        };
        Self {
            endpoint: Endpoint::new(session.unwrap(), epochs),
            motors: motors.unwrap(),
            black_box: Box::new(BlackBox::new()),
            open: Vec::new(),
            nominal: [0; N],
            noise: Noise::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15)),
            silent: 0,
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
        let expected = &self.recorded.expected;
        for phase in Phase::ALL {
            assert!(
                expected.contains(&format!("\"phase\":\"{}\"", phase.name())),
                "{phase} was never reached"
            );
        }
        let causes = Cause::ALL.iter().filter(|cause| {
            **cause != Cause::None && expected.contains(&format!("ended {} ", cause.name()))
        });
        assert!(causes.count() >= 5, "few causes");
        assert!(
            expected.contains("write 0\n"),
            "references were never withheld"
        );
        self.recorded
    }

    fn one_in(&mut self, count: usize) -> bool {
        self.noise.below(count) == 0
    }

    /// A number of either sign.
    fn within(&mut self, most: i32) -> i32 {
        let most_index = usize::try_from(2 * most + 1).unwrap();
        i32::try_from(self.noise.below(most_index)).unwrap() - most
    }

    fn connections(&mut self) {
        if self.open.is_empty() || self.one_in(20) {
            let datagram = self.one_in(3);
            let transport = if datagram {
                Transport::Datagram
            } else {
                Transport::Stream
            };
            writeln!(self.recorded.script, "o {}", u8::from(datagram)).unwrap();
            let opened = self.endpoint.open(transport);
            let (code, number) = opened.map_or(("GT_CODE_FULL", 0), |connection| {
                ("GT_CODE_OK", connection.0)
            });
            self.open.extend(opened);
            writeln!(self.recorded.expected, "open {code} {number}").unwrap();
        }
        if self.one_in(150) {
            let index = self.noise.below(6);
            let connection = self.open.get(index).copied().unwrap_or(Connection(99_999));
            self.endpoint.close(connection);
            self.open.retain(|open| *open != connection);
            writeln!(self.recorded.script, "c {}", connection.0).unwrap();
        }
    }

    /// Sends the bytes of a connection in this tick: mostly valid ones.
    fn speak(&mut self, connection: Connection) {
        let owns = self.endpoint.session().owner() == Some(connection);
        let speaks = if owns {
            !self.one_in(25)
        } else {
            self.one_in(6)
        };
        if self.silent > 0 || !speaks {
            return;
        }
        let mut bytes = if owns { self.command() } else { self.hello() };
        if self.one_in(70) {
            bytes = self.anything(&bytes);
        }
        // Now and then in pieces, as streams are read; a datagram in pieces is broken.
        if self.one_in(8) {
            let cut = self.noise.below(40).min(bytes.len());
            let (first, rest) = bytes.split_at(cut);
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
        writeln!(self.recorded.script, "f {} {text}", connection.0).unwrap();
        writeln!(self.recorded.expected, "fed {fed}").unwrap();
    }

    fn hello(&mut self) -> Vec<u8> {
        let axes = u8::from(self.one_in(10));
        self.encoded(
            &ClientAction::Hello {
                axes,
                capabilities: 0,
            },
            [Offsets::ZERO; N],
        )
    }

    /// The right answer to the last State, or nearly.
    fn command(&mut self) -> Vec<u8> {
        let late = i8::from(self.one_in(30));
        let beyond = if self.one_in(40) { 1_000 } else { 1 };
        let accepted = self
            .endpoint
            .output()
            .map_or(0, |output| output.state.accepted.0);
        let obtain = accepted >= 3 && !self.one_in(60);
        let targets = std::array::from_fn(|_| Offsets {
            position: OffsetNm(self.within(3_000) * beyond),
            velocity: VelocityUmS(self.within(5_000)),
            torque: TorquePermille(i16::try_from(self.within(50)).unwrap()),
        });
        let ahead = i32::from(1 - late);
        self.encoded(
            &ClientAction::Command {
                epoch: 0,
                ahead,
                behind: late,
                obtain,
                targets: Default::default(),
            },
            targets,
        )
    }

    fn encoded(&self, action: &ClientAction, targets: [Offsets; N]) -> Vec<u8> {
        encode_client(
            &action
                .message(self.endpoint.session(), |_| targets)
                .unwrap(),
        )
        .to_vec()
    }

    /// Returns other bytes instead.
    fn anything(&mut self, right: &[u8]) -> Vec<u8> {
        let epoch = self.endpoint.session().epoch();
        let index = self.noise.below(right.len());
        let byte = u8::try_from(self.noise.below(256)).unwrap();
        match self.noise.below(8) {
            0 => encode_client(&ClientMessage::<N>::Goodbye(epoch)).to_vec(),
            1 => encode_client(&ClientMessage::<N>::Stop(epoch)).to_vec(),
            2 => right.repeat(2),
            3 => right.repeat(12),
            4 => right[..index].to_vec(),
            5 => vec![byte; index],
            // Another version, which is answered.
            6 => with(right, 2, 9),
            _ => with(right, index, byte),
        }
    }

    /// Sample of a tick; every fourth has none.
    fn sensor(&self) -> Option<WrenchSample> {
        let place = i32::try_from(self.nominal[0] / 1_000).unwrap();
        (place % 4 != 0).then(|| WrenchSample {
            age: u8::try_from(place % 256).unwrap(),
            is_cut: place % 5 == 0,
            force: [place, -place, 1_000 - place].map(ForceMn),
            moment: [i32::MAX - place, i32::MIN + place, 7 * place].map(MomentUnm),
        })
    }

    fn tick(&mut self) {
        self.silent = self.silent.saturating_sub(1);
        if self.one_in(120) {
            self.silent = self.noise.below(60);
        }
        let faulted = self.endpoint.session().phase() == Phase::Fault;
        let told = self.told();
        let arrival_us = u16::try_from(self.noise.below(1_000)).unwrap();
        let jump = if self.one_in(1_000) { 3_000_000 } else { 1_000 };
        self.nominal = self.nominal.map(|nominal| (nominal + jump) % 900_000_000);
        let input = TickInput {
            elapsed_cycles: if self.one_in(300) { 2 } else { 1 },
            reading: (!self.one_in(200)).then(|| Reading {
                nominal: self.nominal.map(PositionNm),
                actual: self.nominal.map(|nominal| Actual {
                    position: PositionNm(nominal - 77),
                    velocity: VelocityUmS(-5),
                    torque: TorquePermille(3),
                }),
            }),
            sensor: self.sensor(),
            // In the fault both at once, too.
            stop: self.one_in(if faulted { 8 } else { 500 }),
            quit: self.one_in(if faulted { 8 } else { 1_000 }),
            rearm: self.one_in(if faulted { 2 } else { 100 }),
        };
        self.recorded.script_tick(&input, told.as_ref(), arrival_us);
        self.endpoint.note_arrival(arrival_us);
        let write = self.endpoint.tick_recorded(&input, &mut *self.black_box);
        let references = match &write {
            Write::Due(write) => self.motors.spread(write.references()),
            Write::Withheld(_) => None,
        };
        self.recorded
            .expect_output(references.as_ref(), write.output());
        let expected = &mut self.recorded.expected;
        if let Some(told) = told {
            writeln!(expected, "written {}", say(write, told)).unwrap();
        }
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

    /// Returns what is said of the references of the coming tick: now and then refused, with values in
    /// force that may be beyond their limits, unknown, or nothing; after that the values are soon read
    /// back.
    fn told(&mut self) -> Option<LastWrite<N>> {
        let withheld = self.endpoint.output().is_some_and(|output| output.withheld);
        if !self.one_in(if withheld { 3 } else { 700 }) {
            return Some(LastWrite::Accepted);
        }
        let beyond = match self.noise.below(6) {
            0 => return Some(LastWrite::Unknown),
            1 => return None,
            2 => 2_010_000,
            _ => 0,
        };
        // The ramp takes a tick per 100 nm: a short one, so that a session can follow.
        let position = OffsetNm(self.within(3_000) + beyond);
        let offsets = Offsets {
            position,
            velocity: VelocityUmS(17),
            torque: TorquePermille(-2),
        };
        let in_force = self.nominal.map(|nominal| InForce {
            nominal: PositionNm(nominal),
            offsets,
        });
        Some(LastWrite::Refused { in_force })
    }

    /// Gives a further range of epochs; now and then one that is used up already, or empty.
    fn epochs(&mut self) {
        let used = self.endpoint.session().epoch().0;
        let [ahead, count] = [3, 5].map(|end| u64::try_from(self.noise.below(end)).unwrap());
        let first = used + ahead;
        let last = (first + count).saturating_sub(1);
        self.endpoint.set_epochs(EpochRange {
            first: Epoch(first),
            last: Epoch(last),
        });
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

/// Says of references what became of them. Returns the code that C has for it.
fn say<const N: usize>(write: Write<'_, N>, told: LastWrite<N>) -> &'static str {
    match (write, told) {
        (Write::Due(write), LastWrite::Accepted) => write.accepted(),
        (Write::Due(write), LastWrite::Refused { in_force }) => write.refused(in_force),
        (Write::Withheld(drives), LastWrite::Refused { in_force }) => drives.read_back(in_force),
        (write, LastWrite::Unknown) => write.unknown(),
        (write, LastWrite::Accepted) => {
            write.unknown();
            return "GT_CODE_WITHHELD";
        }
    }
    "GT_CODE_OK"
}

impl<const N: usize> Recorded<N> {
    fn script_tick(&mut self, input: &TickInput<N>, told: Option<&LastWrite<N>>, arrival_us: u16) {
        let (written, in_force) = match told {
            None => (0, None),
            Some(LastWrite::Accepted) => (1, None),
            Some(LastWrite::Refused { in_force }) => (2, Some(in_force)),
            Some(LastWrite::Unknown) => (3, None),
        };
        let [stop, rearm] = [input.stop, input.rearm].map(|pressed| if pressed { 2 } else { 1 });
        let read = if input.reading.is_some() { 1 } else { 2 };
        let (elapsed, quit) = (input.elapsed_cycles, u8::from(input.quit));
        let first = format!("t {elapsed} {read} {stop} {quit} {rearm} {written} {arrival_us}");
        self.script.push_str(&first);
        // Without a sample the rest is not looked at.
        let sensor = input.sensor.unwrap_or(WrenchSample {
            age: 7,
            force: [ForceMn(-1); 3],
            ..WrenchSample::default()
        });
        let status = input
            .sensor
            .map_or(0, |sample| if sample.is_cut { 2 } else { 1 });
        write!(self.script, " {status} {}", sensor.age).unwrap();
        for (force, moment) in sensor.force.iter().zip(&sensor.moment) {
            write!(self.script, " {} {}", force.0, moment.0).unwrap();
        }
        let reading = input
            .reading
            .unwrap_or(Reading::unmeasured([PositionNm(-1); N]));
        for (
            nominal,
            Actual {
                position,
                velocity,
                torque,
            },
        ) in reading.nominal.iter().zip(&reading.actual)
        {
            write!(
                self.script,
                " {} {} {} {}",
                nominal.0, position.0, velocity.0, torque.0
            )
            .unwrap();
        }
        for InForce {
            nominal,
            offsets:
                Offsets {
                    position,
                    velocity,
                    torque,
                },
        } in in_force.into_iter().flatten()
        {
            write!(
                self.script,
                " {} {} {} {}",
                nominal.0, position.0, velocity.0, torque.0
            )
            .unwrap();
        }
        self.script.push('\n');
    }

    fn expect_output(&mut self, references: Option<&[Reference; MOTORS]>, output: &Output<N>) {
        let text = &mut self.expected;
        writeln!(text, "write {}", u8::from(references.is_some())).unwrap();
        match references {
            Some(references) => text.extend(references.iter().map(motor_line)),
            None => text.push_str(&"motor 0 0 0\n".repeat(MOTORS)),
        }
        let (has_owner, owner) = output.owner.map_or((0, 0), |owner| (1, owner.0));
        let (refused, welcomed) = (output.refusals.len(), u8::from(output.welcome.is_some()));
        let ended = output.ended.unwrap_or_default().name();
        let latched = u8::from(output.latched);
        writeln!(
            text,
            "refused {refused} welcomed {welcomed} owner {has_owner} {owner} ended {ended} latched {latched}"
        )
        .unwrap();
        writeln!(text, "{}", serde_json::to_string(&output.state).unwrap()).unwrap();
    }
}
