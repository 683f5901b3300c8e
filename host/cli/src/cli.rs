//! Commands, their options and their output.

mod bus;
mod calibrate;
mod client;
mod completions;
mod demo;
mod draw;
mod experiment;
mod export;
mod faults;
mod fmu;
mod follow;
mod gauges;
mod header;
mod identify;
mod key;
mod labcomm;
mod machine;
mod man;
mod monitor;
mod outputs;
mod pace;
mod plan;
mod plant;
mod publication;
mod recording;
mod recover;
mod replay;
mod robot;
mod serve;
mod stability;
mod verbosity;
mod verify;
mod workspace;

use std::io::StdinLock;
use std::net::SocketAddr;
use std::process::ExitCode;

use crate::signals::{self, Suspension};
use crate::terminal::{LogWriter, OutputReader, WritesRest, complain, queue_output};
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use gantry_tau_client::force_sensor::{DEFAULT_NAME, SensorSource};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::model::{f1, l2};
use gantry_tau_machine::model::{F1_MOTORS, L2_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile, RobotFileError};
use gantry_tau_server::links::Allowed;
use gantry_tau_system::dial::{AddressError, Addresses};

use verbosity::Verbosity;

/// Stiffness compensation and external control of Gantry-Tau parallel robots.
///
/// A server owns the machine's reference. A client on the network measures the force on the tool,
/// computes the elastic displacement of the machine, and sends position offsets at 1 kHz. The
/// reference never jumps, for anything that client or network do. Start with `gantry-tau demo`, which needs
/// no hardware.
#[derive(Debug, Parser)]
#[command(name = "gantry-tau", version, max_term_width = 100)]
struct Arguments {
    #[command(flatten)]
    verbosity: Verbosity,
    #[command(subcommand)]
    command: Command,
}

/// The help text of a command with options stands at its struct: clap would replace it by the text
/// of the variant.
#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Demo),
    Serve(serve::Serve),
    Client(client::Client),
    Pace(pace::Pace),
    Key(key::KeyCommand),
    Monitor(monitor::Monitor),
    Recover(recover::Recover),
    Faults(faults::Faults),
    Follow(follow::Follow),
    Replay(replay::Replay),
    Robot(robot::RobotCommand),
    Bus(bus::BusCommand),
    Gauges(gauges::GaugesCommand),
    Workspace(workspace::Workspace),
    Stability(stability::Stability),
    Draw(draw::Draw),
    Header(header::Header),
    Export(export::Export),
    Fmu(fmu::Fmu),
    Labcomm(labcomm::Labcomm),
    Calibrate(calibrate::Calibrate),
    Identify(identify::Identify),
    Verify(verify::Verify),
    Plan(plan::Plan),
    Experiment(experiment::Experiment),
    /// Kinematics, statics and compensation for scripts: one JSON request per line in, one JSON answer per line out
    ///
    /// Example: echo '{"id":1,"robot":"l2","op":"ik","T":[0.0,0.5,0.65]}' | gantry-tau solve
    ///
    /// Every request: "id" (anything, returned in the answer), "robot" ("l2", "f1", the path of a robot file, or an inline object with the
    /// keys of such a file), "op", and its arguments. T: tool centre point [x,y,z]; q: cart positions [q1,q2,q3]; w: load on the platform
    /// [Fx,Fy,Fz,Mx,My,Mz] about the tool centre point; R: platform rotation, 3 rows, identity if absent. World axes; m, N, N m.
    ///
    ///   ik {T} -> {q, iterations, residual};  fk {q} -> {T, R, iterations, residual};  jacobian {T} -> {J: dT/dq, by rows}
    ///   statics {T, w} -> {f: link tensions, tau: cart loads};  compliance {T} -> {C: 6x6, by rows}
    ///   deflection {T, w} -> {r: carts, dx_links, dx_total};  compensate {T, w} -> {q that holds T under w}
    ///   dynamics {tcp_m, axes, drives, nu, wrench} -> {mass_matrix, accelerations, link_tensions, sensor_load};  modes {tcp_m} ->
    ///   {first_five_modes_hz};  loop {tcp_m, filter} -> {closed_loop_growth_per_s, at_hz, any_phase_margin, margin_at_hz}: docs/cli.md
    ///
    /// Answers: {"id":..., "ok":{...}} or {"id":..., "error":{"kind":..., "message":...}}, kind one of not_converged, unreachable,
    /// singular, out_of_range, not_finite, seed_required, bad_robot, bad_request. Links in the order 11, 21, 22, 31, 32, 33.
    #[command(verbatim_doc_comment)]
    Solve,
    Completions(completions::Completions),
    Man(man::Man),
}

impl Command {
    /// Prepares a command that runs until it is ended: nothing on its terminal or its outputs may
    /// end, suspend or block it.
    fn begin(&self) -> std::io::Result<Option<WritesRest>> {
        let (suspension, reader) = match self {
            Self::Serve(_) => (Suspension::Ignored, OutputReader::Person),
            Self::Client(_)
            | Self::Pace(_)
            | Self::Demo(_)
            | Self::Experiment(_)
            | Self::Gauges(_) => (Suspension::Allowed, OutputReader::Person),
            Self::Monitor(_) | Self::Faults(_) => (Suspension::Allowed, OutputReader::Program),
            _ => return Ok(None),
        };
        signals::install(suspension)?;
        queue_output(reader).map(Some)
    }
}

/// Source of the ticks.
#[derive(Clone, Copy, Debug, ValueEnum, PartialEq, Eq)]
enum Pace {
    /// One tick per millisecond of the clock
    Real,
    /// One tick per answer of the client, which the server waits for; without a session about one
    /// per millisecond
    Lockstep,
}

impl From<Pace> for gantry_tau_server::server::tick_source::TickSource {
    fn from(pace: Pace) -> Self {
        match pace {
            Pace::Real => Self::RealTime,
            Pace::Lockstep => Self::Lockstep,
        }
    }
}

/// Runs the command that the command line names; returns the exit code of the process.
pub fn main() -> ExitCode {
    let matches = Arguments::command().get_matches();
    let arguments = Arguments::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    // Errors of the writer would be reported by `eprintln!`, which panics when stderr fails.
    let log = tracing_subscriber::fmt()
        .with_env_filter(arguments.verbosity.filter())
        .with_writer(LogWriter)
        .log_internal_errors(false);
    log.with_target(false).compact().init();
    if let Err(error) = signals::survive_file_limits() {
        return fail(1, error);
    }
    if let Err(error) = outputs::check(&matches) {
        return fail(1, error);
    }
    let command = arguments.command;
    let _rest = match command.begin() {
        Ok(rest) => rest,
        Err(error) => return fail(1, error),
    };
    let outcome = match command {
        Command::Demo(demo) => run_on(AnyRobotFile::named(&demo.robot), demo),
        Command::Serve(serve) => run_on(AnyRobotFile::named(&serve.robot), serve),
        Command::Client(client) => run_on(AnyRobotFile::named(&client.robot), client),
        Command::Pace(pace) => run_on(AnyRobotFile::named(&pace.robot), pace),
        Command::Key(key) => key.run(),
        Command::Monitor(monitor) => monitor.run(),
        Command::Recover(recover) => recover.run(),
        Command::Faults(faults) => faults.run(),
        Command::Follow(follow) => run_on(AnyRobotFile::named(&follow.robot), follow),
        Command::Replay(replay) => replay.run(),
        Command::Robot(robot) => robot.run(),
        Command::Bus(bus) => bus.run(),
        Command::Gauges(gauges) => gauges.run(),
        Command::Stability(stability) => run_on(AnyRobotFile::named(&stability.robot), stability),
        Command::Workspace(workspace) => run_on(workspace.machine.read(), workspace),
        Command::Draw(draw) => run_on(draw.machine.read(), draw),
        Command::Export(export) => run_on(export.machine.read(), export),
        Command::Fmu(fmu) => fmu.run(),
        Command::Header(header) => header.run(),
        Command::Labcomm(labcomm) => labcomm.run(),
        Command::Calibrate(calibrate) => calibrate.run(),
        Command::Identify(identify) => identify.run(),
        Command::Verify(verify) => run_on(AnyRobotFile::named(&verify.robot), verify),
        Command::Plan(plan) => plan.run(),
        Command::Experiment(experiment) => experiment.run(),
        Command::Solve => solve(),
        Command::Completions(completions) => completions.run(),
        Command::Man(man) => man.run(),
    };
    match outcome {
        Err(error) => fail(1, error),
        Ok(code) => match crate::terminal::output_failure() {
            Some(reason) if code == ExitCode::SUCCESS => {
                fail(1, format_args!("standard output: {reason}"))
            }
            _ => code,
        },
    }
}

/// Error of a command: a text for the terminal.
type Failure = Box<dyn std::error::Error>;
/// Exit code of a command; an error is printed and becomes 1.
type Outcome = Result<ExitCode, Failure>;
/// Error of an option: a text that clap prints.
type OptionError = Box<dyn std::error::Error + Send + Sync>;

/// A command for a machine of either kind.
trait MachineCommand {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome;
}

/// Runs a command on the machine that it names.
fn run_on(robot: Result<AnyRobotFile, RobotFileError>, command: impl MachineCommand) -> Outcome {
    match robot? {
        AnyRobotFile::L2(robot) => {
            log_read(&*robot);
            command.run_on::<_, { l2::AXES }, L2_MOTORS>(*robot)
        }
        AnyRobotFile::F1(robot) => {
            log_read(&*robot);
            command.run_on::<_, { f1::AXES }, F1_MOTORS>(*robot)
        }
    }
}

fn log_read<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) {
    let checksum = robot.checksum();
    tracing::debug!("{}: {}, kinematics {checksum:08x}", robot.name, K::MODEL);
}

fn solve() -> Outcome {
    let stdin = std::io::stdin().lock();
    match crate::solve::run(stdin, std::io::stdout().lock()) {
        // The reader of the answers has ended, for instance `head`.
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(ExitCode::SUCCESS),
    }
}

/// Reads the standard input in a thread that ends with the process.
fn read_keyboard(listen: impl FnOnce(StdinLock<'_>) + Send + 'static) {
    let thread = std::thread::Builder::new().name("keyboard".to_owned());
    if let Err(error) = thread.spawn(move || listen(std::io::stdin().lock())) {
        tracing::warn!("commands cannot be typed ({error}); Ctrl-C ends");
    }
}

/// Prints the reasons not to trust a result; returns the exit code.
fn doubted(doubts: &[String]) -> ExitCode {
    if doubts.is_empty() {
        ExitCode::SUCCESS
    } else {
        fail(3, doubts.join("; "))
    }
}

/// Prints one line on stderr; returns the exit code.
fn fail(code: u8, error: impl std::fmt::Display) -> ExitCode {
    complain(error);
    ExitCode::from(code)
}

/// An address or a host name to listen on, with a port. Prefers IPv4.
fn address(text: &str) -> Result<SocketAddr, AddressError> {
    peer(text).map(|addresses| addresses.first())
}

/// Addresses or a host name to connect to, with a port.
fn peer(text: &str) -> Result<Addresses, AddressError> {
    text.parse()
}

/// Refuses an address that other computers reach, unless the peers that may use it are named.
fn check_reach(address: SocketAddr, allowed: &Allowed) -> Result<(), Failure> {
    if address.ip().is_loopback() || allowed.restricts() {
        return Ok(());
    }
    Err(format!(
        "other machines reach {address}, unencrypted: name those that may with --allow (every peer: --allow 0.0.0.0/0 --allow ::/0)"
    )
    .into())
}

/// Links to the instruments of a compensating client.
#[derive(Clone, Debug, Args)]
struct Instruments {
    /// A force sensor that the server does not have: a LabComm stream with a sample NAME of type
    /// float[6] or double[6] [default NAME: forcesensor]
    #[arg(long, value_name = "labcomm:HOST:PORT[/NAME]", value_parser = sensor)]
    sensor: Option<SensorSource>,
    /// The accelerometer, of a machine with a section [sensor.accelerometer]: the address of the
    /// server's link
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:7004", value_parser = peer)]
    accelerometer: Addresses,
}

/// A force sensor: `labcomm:` with address and name of a sample.
fn sensor(text: &str) -> Result<SensorSource, OptionError> {
    let stream = text.strip_prefix("labcomm:").ok_or(
        "expected labcomm:HOST:PORT; the samples of the server's own sensor come with its States",
    )?;
    let (at, name) = stream.split_once('/').unwrap_or((stream, DEFAULT_NAME));
    if name.is_empty() {
        return Err("expected the name of a sample after the slash".into());
    }
    Ok(SensorSource::Labcomm {
        address: peer(at)?,
        name: name.to_owned(),
    })
}

/// Transport selected by `--udp`.
const fn transport(udp: bool) -> Transport {
    if udp {
        Transport::Datagram
    } else {
        Transport::Stream
    }
}
