//! Double of a server's LabComm port: sends the samples of one scene, tick after tick, to every
//! reader.

use std::io::Write;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_labcomm::samples::{Axes, Axis, SessionEvent, State, Tool};
use gantry_tau_labcomm::{Encoder, ErrorKind, Text, Version};
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile, text_of};
use gantry_tau_server::publication::{DriveStates, MachineIdentity};

/// First tick that is sent.
pub const FIRST_TICK: i64 = 1_000;

/// Values that are the same in all ticks.
#[derive(Clone, Copy)]
pub struct Scene {
    /// Version of LabComm.
    pub version: Version,
    /// Phase of the session.
    pub phase: Phase,
    /// Cause of the end of the last one.
    pub cause: Cause,
    /// The machine fails in the first tick.
    pub machine_fails: bool,
    /// Position offset of axis 1, nm; axis 2 has its double, and so on.
    pub offset_nm: i32,
    /// Movement of every axis, nm per tick.
    pub step_nm: i64,
    /// The machine that the server names.
    pub machine: Named,
}

/// Machine that a server names.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Named {
    /// The built-in L2; its robot file is not sent.
    L2,
    /// That of [`sent_robot`], whose robot file is sent.
    Sent,
    /// One with other kinematic parameters, whose robot file is not sent.
    Other,
    /// None: the server is of an earlier version.
    None,
}

/// Returns the text of a robot file like that of the built-in L2, with one longer link.
pub fn sent_robot() -> String {
    let text = text_of("l2").unwrap();
    let sent = text.replace("L = [1.0, 1.1, 1.0]", "L = [1.0, 1.1, 1.01]");
    assert_ne!(sent, text);
    sent
}

/// Returns what the server says of its machine.
fn identity(named: Named) -> Option<MachineIdentity> {
    match named {
        Named::L2 => Some(gantry_tau_record::identity::machine(
            &RobotFile::builtin_l2().unwrap(),
            "",
        )),
        Named::Sent => {
            let text = sent_robot();
            let AnyRobotFile::L2(robot) = AnyRobotFile::parse("small.toml", &text).unwrap() else {
                panic!("another kind of machine")
            };
            Some(gantry_tau_record::identity::machine(&robot, &text))
        }
        Named::Other => Some(MachineIdentity {
            kinematics: 0x0bad_cafe,
            name: Text::cut("small.toml"),
            lockstep: 0,
            robot_file: Text::cut(""),
        }),
        Named::None => None,
    }
}

impl Scene {
    /// Scene of the built-in L2 at rest, in a phase.
    #[must_use]
    pub const fn of(phase: Phase, cause: Cause) -> Self {
        Self {
            version: Version::V2014,
            phase,
            cause,
            machine_fails: false,
            offset_nm: -10_000,
            step_nm: 0,
            machine: Named::L2,
        }
    }

    /// State of a tick.
    #[must_use]
    pub fn state(&self, tick: i64) -> State {
        State {
            tick,
            epoch: 7,
            sequence: tick - 100,
            phase: self.phase.code(),
            cause: self.cause.code(),
            on_time: 99,
            ramp_ticks_left: 1_890,
            counters: [41_234, 3, 2, 1, 4, 5, 6, 12, 7, 8],
            longest_miss_run: 1,
        }
    }

    /// Axes of a tick; the drives follow the reference of the tick before.
    #[must_use]
    pub fn axes<const N: usize>(&self, tick: i64, home_nm: [i64; N]) -> Axes<N> {
        let mut number = 0;
        let axis = home_nm.map(|home_nm| {
            number += 1;
            let position_offset_nm = self.offset_nm * number;
            let nominal_nm = home_nm + self.step_nm * tick;
            let reference_nm = nominal_nm + i64::from(position_offset_nm);
            Axis {
                nominal_nm,
                reference_nm,
                position_offset_nm,
                velocity_offset_um_s: number,
                torque_offset_permille: -2,
                shadow_nm: 0,
                actual_nm: reference_nm - self.step_nm - 4,
                actual_velocity_um_s: -3,
                actual_torque_permille: -12,
                flags: if number == 2 { 0b10 } else { 0 },
            }
        });
        Axes { tick, axis }
    }

    /// Tool of a tick.
    #[must_use]
    pub const fn tool(&self, tick: i64) -> Tool {
        Tool {
            tick,
            step: 1,
            load: [300.25, -0.5, -18.0, 0.05, -0.1, 0.02],
            displacement_m: [1e-4, -5e-5, 2e-5],
            turn_rad: [1e-5, 2e-5, 0.0],
            gauges_m: [0.000_19, 0.000_036, 0.000_024],
        }
    }
}

/// Home of the built-in L2, roughly, nm.
pub const HOME_NM: [i64; 3] = [624_500_000, -696_400_000, 669_000_000];

/// A listening double, which ends with its test.
pub struct Double {
    /// Its port.
    pub address: SocketAddr,
    quit: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Double {
    /// Sends what a server of the scene would.
    #[must_use]
    pub fn of(scene: Scene) -> Self {
        Self::at("127.0.0.1:0".parse().unwrap(), scene)
    }

    /// As [`of`](Self::of), on an address.
    #[must_use]
    pub fn at(address: SocketAddr, scene: Scene) -> Self {
        Self::on(address, move |stream, quit| {
            let mut tick = FIRST_TICK;
            let mut bytes = preamble(&scene)?;
            while !quit.load(Ordering::Relaxed) {
                let mut buffer = [0; 1_024];
                let mut encoder = Encoder::new(scene.version, &mut buffer);
                add_tick(&mut encoder, &scene, tick).ok()?;
                bytes.extend_from_slice(encoder.bytes());
                stream.write_all(&bytes).ok()?;
                bytes.clear();
                tick += 1;
                std::thread::sleep(Duration::from_millis(1));
            }
            None
        })
    }

    /// Sends these bytes, and then nothing.
    #[must_use]
    pub fn of_bytes(bytes: Vec<u8>) -> Self {
        Self::on("127.0.0.1:0".parse().unwrap(), move |stream, quit| {
            stream.write_all(&bytes).ok()?;
            while !quit.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(1));
            }
            None
        })
    }

    fn on(
        address: SocketAddr,
        serve: impl Fn(&mut TcpStream, &AtomicBool) -> Option<()> + Send + Sync + 'static,
    ) -> Self {
        let listener = TcpListener::bind(address).unwrap();
        let address = listener.local_addr().unwrap();
        let quit = Arc::new(AtomicBool::new(false));
        let asked = Arc::clone(&quit);
        let serve = Arc::new(serve);
        let thread = std::thread::spawn(move || {
            let mut readers = Vec::new();
            for stream in listener.incoming() {
                if asked.load(Ordering::Relaxed) {
                    break;
                }
                let mut stream = stream.unwrap();
                let serve = Arc::clone(&serve);
                let asked = Arc::clone(&asked);
                readers.push(std::thread::spawn(move || serve(&mut stream, &asked)));
            }
            for reader in readers {
                let _ = reader.join();
            }
        });
        Self {
            address,
            quit,
            thread: Some(thread),
        }
    }
}

impl Drop for Double {
    fn drop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
        // Wakes the listener.
        let _ = TcpStream::connect(self.address);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Version, definitions, and the machine.
fn preamble(scene: &Scene) -> Option<Vec<u8>> {
    let mut buffer = [0; 32_768];
    let mut encoder = Encoder::new(scene.version, &mut buffer);
    let index = scene.version.first_index();
    encoder.version().ok()?;
    encoder.define::<State>(index).ok()?;
    encoder.define::<Axes<3>>(index + 1).ok()?;
    encoder.define::<Tool>(index + 2).ok()?;
    encoder.define::<SessionEvent>(index + 3).ok()?;
    encoder.define::<DriveStates<3>>(index + 4).ok()?;
    if let Some(machine) = identity(scene.machine) {
        encoder.define::<MachineIdentity>(index + 5).ok()?;
        encoder.data(index + 5, &machine).ok()?;
    }
    Some(encoder.bytes().to_vec())
}

fn add_tick(encoder: &mut Encoder<'_>, scene: &Scene, tick: i64) -> Result<(), ErrorKind> {
    let index = scene.version.first_index();
    if tick == FIRST_TICK {
        let (kind, text) = if scene.machine_fails {
            (4, "the machine did not answer")
        } else {
            (0, "session granted (epoch 7)")
        };
        encoder.data(
            index + 3,
            &SessionEvent {
                tick,
                kind,
                cause: 0,
                text: Text::cut(text),
            },
        )?;
    }
    encoder.data(index, &scene.state(tick))?;
    encoder.data(index + 1, &scene.axes(tick, HOME_NM))?;
    encoder.data(index + 2, &scene.tool(tick))?;
    // Operating, ready, quick stop.
    encoder.data(
        index + 4,
        &DriveStates {
            tick,
            state: [2, 1, 3],
        },
    )
}
