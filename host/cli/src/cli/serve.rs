//! `gantry-tau serve`.

use std::fmt::Display;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use crate::demo::{Loops, NO_MASSES, glide_cycles};
use crate::signals;
use crate::terminal::say;
use clap::{ArgGroup, Args};
use gantry_tau_core::control::message::Capabilities;
use gantry_tau_core::control::position_loop::config::LoopConfig;
use gantry_tau_identify::experiment::campaign_machine::CampaignMachine;
use gantry_tau_identify::measurements::plan;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError, text_of};
use gantry_tau_record::black_box::writer::BlackBoxWriter;
use gantry_tau_record::identity;
use gantry_tau_record::recording::{RecordTo, Recorder, Recording, drain};
use gantry_tau_server::black_box::swap_channel;
use gantry_tau_server::key_file;
use gantry_tau_server::links::Allowed;
use gantry_tau_server::links::accelerometer::AccelerometerPublisher;
use gantry_tau_server::links::gauges::GaugePublisher;
use gantry_tau_server::plant::Plant;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::publication::{MachineIdentity, Publication};
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::connections::{Listen, Listening};
use gantry_tau_server::server::cycle::Cycle;
use gantry_tau_server::server::event_log::{EventLog, Losses};
use gantry_tau_server::server::{Controls, Server, ServerError, keyboard};
use gantry_tau_server::state::{
    Begun, Environment, FirstRun, LatchFlusher, MachineName, MachineState, StatePlace,
};
use gantry_tau_sim::load_generator::{LoadGenerator, load_generator};
use gantry_tau_sim::load_pattern::{LoadPattern, Milling};
use gantry_tau_sim::load_profile::LoadProfile;
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_sim::workpiece::Workpiece;
use gantry_tau_system::privileges;

use super::outputs::{InputFile, NamedInput};
use super::plant::PlantChoice;
use super::publication::PublicationOptions;
use super::recording::RecordLimit;
use super::{
    Failure, MachineCommand, Outcome, Pace, address, check_reach, fail, read_keyboard, transport,
};

/// Run the server with the simulated machine, for this program's client or any other
///
/// Runs the server with the simulated machine until Ctrl-C, which ramps every offset to zero first.
///
/// While a client is in Obtain, a simulated force acts on the tool in steps. Type `stop`, `rearm`
/// or `quit` and Enter.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("labcomm_streams").args(["labcomm", "record"]).multiple(true)))]
pub(crate) struct Serve {
    /// Address for clients; the default is reachable from this machine only. One that others reach
    /// needs --key. Traffic is not encrypted
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:7000", value_parser = address)]
    listen: SocketAddr,
    /// UDP datagrams instead of TCP streams: a lost frame is not repeated and delays no other
    #[arg(long)]
    udp: bool,
    /// Answer only clients that have this key (repeatable, up to 4); see `gantry-tau key`
    #[arg(long, value_name = "FILE")]
    key: Vec<InputFile>,
    /// Let every peer that reaches --listen move the machine: without --key, on an address that is not
    /// of this machine alone
    #[arg(long, conflicts_with = "key")]
    insecure: bool,
    /// Answer only this peer or network; others are closed silently (repeatable). Needed for
    /// addresses of samples that are not of this machine alone
    #[arg(long, value_name = "IP|IP/BITS")]
    allow: Vec<String>,
    /// Address of the simulated accelerometer, of a machine with a section [sensor.accelerometer]
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:7004", value_parser = address)]
    accelerometer: SocketAddr,
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE", default_value = "l2")]
    pub(super) robot: NamedInput,
    /// The machine's drives: simulated, a simulator behind a socket, or over EtherCAT behind a network
    /// interface; `emulated`: a bus without hardware
    ///
    /// A simulator answers one line of JSON per call, and goes in lock-step: --pace lockstep. See
    /// docs/simulators.md.
    ///
    /// EtherCAT needs the drives in the robot file, [[ethercat.drives]], and a program that was
    /// built with it. Drives in fault are enabled by `rearm`. See docs/ethercat.md.
    #[arg(
        long,
        value_name = "simulated|socket:HOST:PORT|ethercat:IFACE|ethercat:emulated",
        default_value = "simulated",
        hide_default_value = true
    )]
    pub(super) plant: PlantChoice,
    /// Source of the ticks
    #[arg(long, default_value = "real")]
    pub(super) pace: Pace,
    /// Largest simulated force, N; 0 for none [default: 300]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    force_max: Option<f64>,
    /// Length of each force step, s [default: 2]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    step_seconds: Option<f64>,
    /// Walk through the poses of this plan and pull its levels while a session runs, in place of
    /// the force steps; for `experiment`
    #[arg(long, value_name = "FILE.toml", conflicts_with_all = ["force_max", "step_seconds", "motion"])]
    plan: Option<InputFile>,
    /// Address of the gauges: those on the bus of the drives, or the simulated ones of a plan
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:7002", value_parser = address)]
    gauges: SocketAddr,
    /// Let the platform of the simulated machine be in equilibrium in every cycle, as without the
    /// section [masses] in its file; with it the machine moves by them, and the force sensor feels
    /// the inertia of the tool. With a plan it always is
    #[arg(long)]
    quasi_static: bool,
    /// Tap the tool in x in every step: a force, N, for some ms
    #[arg(long, value_name = "N,MS", value_parser = tap, conflicts_with_all = ["force_max", "plan"])]
    tap: Option<Tap>,
    /// Mill: mean force, N, teeth [4], turns per minute [3000], share of the diameter in the cut [0.5]
    #[arg(long, value_name = "N[,TEETH[,RPM[,SHARE]]]", value_parser = milling, conflicts_with_all = ["force_max", "step_seconds", "plan", "tap"])]
    milling: Option<Milling>,
    /// Let the simulated force sensor sample at a point of time in each cycle, as one without a
    /// low-pass of its own, in place of the mean over the cycle
    #[arg(long, conflicts_with = "plan")]
    point_samples: bool,
    /// Put an elastic workpiece of this stiffness, N/m, below the tool, in place of the force
    /// steps; for controllers of a force. Up to 1e9, without masses up to 1e6
    #[arg(long, value_name = "N_PER_M", allow_negative_numbers = true, conflicts_with_all = ["force_max", "step_seconds", "plan"])]
    workpiece: Option<f64>,
    /// Distance from the tool at home to the workpiece, um
    #[arg(
        long,
        value_name = "UM",
        default_value_t = 50.0,
        allow_negative_numbers = true,
        requires = "workpiece"
    )]
    workpiece_gap: f64,
    /// Length of a back-and-forth motion of the nominal path on every axis, mm
    #[arg(
        long,
        value_name = "MM",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    motion: f64,
    /// Name of the machine among those of this computer: the folder of its state [default: model,
    /// checksum and address]
    ///
    /// The state is the epoch counter, which keeps frames of earlier sessions invalid, and the stop
    /// latch. One server at a time owns it. It lies in /var/lib/gantry-tau as root and for drives
    /// over EtherCAT, in the folder of a service that systemd starts, and otherwise in the user's
    /// state folder. See docs/operation.md.
    #[arg(long, value_name = "NAME", conflicts_with = "epoch_file")]
    name: Option<MachineName>,
    /// File of the epoch counter, in place of that of the machine's name; the stop latch is
    /// FILE.stop
    #[arg(long, value_name = "FILE")]
    epoch_file: Option<PathBuf>,
    /// The machine has never run: that its state is missing is no loss. Without it a server without
    /// state starts in Fault, unless the machine is simulated and clients are of this computer
    #[arg(long)]
    first_run: bool,
    /// Record every tick, as CSV, as a stream of LabComm or as MCAP
    ///
    /// CSV: one row per tick with references, actual values and force. LabComm: the samples axes,
    /// state, tool, session_event and drives. MCAP: the same samples as JSON, and the machine as a
    /// scene for Foxglove.
    #[arg(long, value_name = "FILE.csv|FILE.labcomm|FILE.mcap")]
    record: Option<RecordTo>,
    #[command(flatten)]
    record_limit: RecordLimit,
    /// Write a black box (the ticks before and after, bit for bit) at each end of a session and
    /// each stop, for `gantry-tau replay`
    #[arg(long, value_name = "FOLDER")]
    black_box: Option<PathBuf>,
    #[command(flatten)]
    publications: PublicationOptions,
}

/// A tap: force, N, and cycles that it lasts.
#[derive(Clone, Copy, Debug)]
struct Tap {
    force_n: f64,
    cycles: u32,
}

fn tap(text: &str) -> Result<Tap, String> {
    let (force, time) = text.split_once(',').ok_or("expected N,MS")?;
    let force_n = number(force)?;
    let cycles = time
        .trim()
        .parse()
        .map_err(|_| "MS is not a whole number")?;
    if !(-2_000.0..=2_000.0).contains(&force_n) {
        return Err("the force must be from -2000 to 2000 N".to_owned());
    }
    if !(1..=10_000).contains(&cycles) {
        return Err("the time must be from 1 to 10000 ms".to_owned());
    }
    Ok(Tap { force_n, cycles })
}

fn milling(text: &str) -> Result<Milling, String> {
    let mut parts = text.split(',');
    let mut next = |default: f64| parts.next().map_or(Ok(default), number);
    let (mean_n, teeth, rpm, immersion) = (next(0.0)?, next(4.0)?, next(3_000.0)?, next(0.5)?);
    if parts.next().is_some() {
        return Err("expected at most four numbers".to_owned());
    }
    if teeth.fract() != 0.0 {
        return Err("the teeth must be a whole number".to_owned());
    }
    // What is out of range becomes its end, and is refused.
    Milling::new(mean_n, teeth as u32, rpm, immersion).map_err(|error| error.to_string())
}

fn number(text: &str) -> Result<f64, String> {
    text.trim()
        .parse()
        .map_err(|_| format!("{text:?} is not a number"))
}

impl MachineCommand for Serve {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome {
        self.check()?;
        self.check_interface(&robot)?;
        let allowed = Allowed::only(&self.allow)?;
        let has_gauges = match &self.plant {
            PlantChoice::Emulated | PlantChoice::Interface(_) => has_gauges(&robot),
            PlantChoice::Simulated | PlantChoice::Socket(_) => self.plan.is_some(),
        };
        let gauges = has_gauges.then_some(self.gauges);
        let has_accelerometer = robot.sensor.accelerometer.is_some();
        let accelerometer = has_accelerometer.then_some(self.accelerometer);
        if !(self.listen.ip().is_loopback() || self.insecure) && self.key.is_empty() {
            let listen = self.listen;
            return Ok(fail(
                2,
                format_args!(
                    "everybody who reaches {listen} could move the machine: give --key FILE (gantry-tau key new FILE), or --insecure"
                ),
            ));
        }
        let own = [accelerometer, gauges];
        for address in own
            .into_iter()
            .flatten()
            .chain(self.publications.addresses())
        {
            check_reach(address, &allowed)?;
        }
        match &self.plant {
            PlantChoice::Simulated => {}
            PlantChoice::Socket(address) => {
                return self.serve_remote::<K, N, M>(&robot, &allowed, address);
            }
            PlantChoice::Emulated | PlantChoice::Interface(_) => {
                return self.serve_bus::<K, N, M>(&robot, &allowed);
            }
        }
        if robot.masses.is_none() {
            say(NO_MASSES);
        }
        let simulated = RobotFile {
            masses: robot.masses.filter(|_| !self.quasi_static),
            ..robot.clone()
        };
        let Some(path) = &self.plan else {
            let owned = self.own(&robot, &allowed)?;
            let (hand, tool) = load_generator();
            let motion = self.motion(&robot)?;
            let mut machine =
                SimulatedMachine::<N, M>::moving_from_robot(&simulated, tool, motion)?;
            if self.point_samples {
                machine = machine.sampling_points();
            }
            if let Some(n_per_m) = self.workpiece {
                let gap_m = self.workpiece_gap * 1e-6;
                let home_m = &robot.simulation.home_m;
                let has_masses = simulated.masses.is_some();
                machine = machine.above(Workpiece::below(home_m, n_per_m, gap_m, has_masses)?);
            }
            let mut load = self.load(hand, glide_cycles(&simulated));
            let loops = Cycle::with_position_loops;
            return self.serve(&robot, owned, loops, || {
                Ok((machine, move |row: &TickRecord<N>| {
                    load.update(row.state.phase, row.state.tick);
                }))
            });
        };
        let plan = plan::read(path, K::MODEL, &robot.metres_per_q)?;
        plan.check_wrist(path, robot.wrist.len())?;
        let owned = self.own(&robot, &allowed)?;
        let link = self.gauge_link(path.display(), &allowed)?;
        let machine = CampaignMachine::<N, M>::from_robot(&simulated, plan, link)?;
        let switch = machine.switch();
        self.serve(&robot, owned, positions_only, || {
            Ok((machine, |row: &TickRecord<N>| switch.see(row)))
        })
    }
}

/// Loops of a machine that takes positions; [`Serve::check_interface`] has refused velocities.
pub(super) fn positions_only<const N: usize, const M: usize, P: Plant<N, M>>(
    cycle: Cycle<N, M, P>,
    _: Option<[LoopConfig; N]>,
) -> Result<Cycle<N, M, P>, ServerError> {
    Ok(cycle)
}

/// Ownership of a server before its first effect; given back in the reverse order of taking.
pub(super) struct Owned {
    ports: Ports,
    state: MachineState,
}

impl Owned {
    pub(super) const fn new(state: MachineState, ports: Ports) -> Self {
        Self { ports, state }
    }
}

/// Addresses of a server.
pub(super) struct Ports {
    clients: Listening,
    accelerometer: Option<AccelerometerPublisher>,
    publications: Vec<Publication>,
}

/// True if there are gauges on the bus of the drives.
pub(super) fn has_gauges<K, const N: usize>(robot: &RobotFile<K, N>) -> bool {
    let section = robot.ethercat.as_ref();
    section.is_some_and(|section| !section.gauges.is_empty())
}

impl Serve {
    /// Listens for readers of the gauges that `file` describes.
    pub(super) fn gauge_link(
        &self,
        file: impl Display,
        allowed: &Allowed,
    ) -> Result<GaugePublisher, Failure> {
        let link = GaugePublisher::bind(self.gauges)
            .map(|link| link.for_peers(allowed.clone()))
            .map_err(|error| ServerError::listen(self.gauges, &error))?;
        say(format_args!("gauges of {file} on {}", link.address()?));
        Ok(link)
    }

    /// Serves the machine that `open` finds, until the quit; what it returns beside the machine
    /// sees every row. Until `open` is called no machine has been touched; `docs/operation.md`
    /// lists the order.
    pub(super) fn serve<
        K: MachineKind<N>,
        P: Plant<N, M> + 'static,
        E: FnMut(&TickRecord<N>),
        const N: usize,
        const M: usize,
    >(
        &self,
        robot: &RobotFile<K, N>,
        owned: Owned,
        loops: Loops<N, M, P>,
        open: impl FnOnce() -> Result<(P, E), Box<dyn std::error::Error>>,
    ) -> Outcome {
        let capabilities = match self.pace {
            Pace::Real => Capabilities::NONE,
            Pace::Lockstep => Capabilities::LOCKSTEP,
        };
        let config = robot.session_config(capabilities)?;
        let motors = robot.motor_map()?;
        let Owned {
            ports:
                Ports {
                    clients,
                    accelerometer,
                    publications,
                },
            state,
        } = owned;
        let accelerometers = (accelerometer.iter())
            .map(|link| Ok(format!(", accelerometer on {}", link.address()?)));
        let ports = publications
            .iter()
            .map(|port| Ok(format!(", LabComm on {}", port.address()?)));
        let ports = accelerometers
            .chain(ports)
            .collect::<std::io::Result<String>>()?;
        let (sensors, mut publications): (Vec<_>, Vec<_>) = publications
            .into_iter()
            .partition(Publication::is_of_sensors);
        let Begun {
            epochs,
            latch,
            condition,
            lock,
        } = state.begin(self.first_run())?;
        if condition.is_latched() {
            tracing::warn!("{condition}");
        }
        // Before the machine is touched: a recording that is refused must not cost it a start.
        let mut file = match &self.record {
            Some(to) => {
                let to = self.record_limit.of(self.publications.recorded(to));
                Some(Recorder::start(Recording::create::<TickRecord<N>, K>(
                    &to, robot,
                )?)?)
            }
            None => None,
        };
        let mut black_boxes = None;
        let mut sender = None;
        if let Some(folder) = &self.black_box {
            let (cycles, windows) = swap_channel::channel();
            sender = Some(cycles);
            black_boxes = Some(BlackBoxWriter::open(folder, windows)?.start()?);
        }
        let (machine, mut each) = open()?;
        let cycle = Cycle::listening(config, motors, machine, epochs, latch, clients)?;
        let mut cycle = loops(cycle, robot.position_loops)?.with_sensors(sensors);
        if let Some(accelerometer) = accelerometer {
            cycle = cycle.with_accelerometer(accelerometer);
        }
        if let Some(sender) = sender {
            cycle = cycle.with_black_box(sender);
        }
        if let Err(denied) = gantry_tau_server::realtime::lock_memory() {
            tracing::warn!("no {}: {}", denied.privilege, denied.reason);
        }
        let mut flusher = LatchFlusher::of(cycle.latch())
            .map_err(|error| ServerError::Thread(error.to_string()))?;
        let controls = Arc::new(Controls::default());
        let quit = Arc::clone(&controls);
        signals::on_quit(move || quit.quit.store(true, Ordering::Relaxed));
        let (server, mut rows) = Server::spawn_controlled(cycle, self.pace.into(), controls)?;
        self.give_up_privileges();
        say(format_args!(
            "listening on {}{}{ports}; Ctrl-C ramps to zero and ends",
            server.address,
            if self.udp { " (UDP)" } else { "" },
        ));
        listen_to_the_keyboard(Arc::clone(&server.controls));
        let mut events = EventLog::default();
        let mut losses = Losses::default();
        drain(&mut rows, |row, is_last| {
            each(row);
            let mut happened = events.see(row);
            let is_behind = server.controls.dropped_rows.load(Ordering::Relaxed) > 0;
            let recording = file.as_ref().is_some_and(Recorder::loses_rows);
            happened.extend(losses.see(row.state.tick.0, is_behind, recording));
            for port in &mut publications {
                port.publish(row, &happened);
                if is_last {
                    port.flush();
                }
            }
            flusher.see(row.latched, row.latch_lost);
            if let Some(file) = &mut file {
                file.push(*row, happened);
            }
        });
        let controls = Arc::clone(&server.controls);
        let mut code = match server.quit() {
            Ok(_) => {
                say("all offsets are zero; ended");
                ExitCode::SUCCESS
            }
            Err(error @ (ServerError::StillInForce { .. } | ServerError::StopNotStored)) => {
                // The latch's writer may still come to it: until the process is gone the latch is
                // this one's.
                std::mem::forget(lock);
                fail(
                    if error == ServerError::StopNotStored {
                        4
                    } else {
                        3
                    },
                    error,
                )
            }
            Err(error) => return Err(error.into()),
        };
        // Before the lock: a second start finds nothing half free.
        drop(publications);
        flusher.finish();
        let dropped = controls.dropped_rows.load(Ordering::Relaxed);
        let boxes = black_boxes
            .and_then(|boxes| boxes.finish().err())
            .map(|failure| failure.to_string());
        let recorded = file.and_then(|file| file.finish(dropped));
        if let Some(recorded) = &recorded {
            say(recorded);
        }
        let recording = recorded
            .and_then(|recorded| recorded.failure)
            .map(|failure| failure.to_string());
        for failure in [recording, boxes].into_iter().flatten() {
            let failed = fail(1, failure);
            // What the machine or the latch may have says more.
            if code == ExitCode::SUCCESS {
                code = failed;
            }
        }
        Ok(code)
    }

    /// Owns state and ports, in this order.
    pub(super) fn own<K: MachineKind<N>, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
        allowed: &Allowed,
    ) -> Result<Owned, Box<dyn std::error::Error>> {
        let state = self.own_state(robot)?;
        Ok(Owned::new(state, self.own_ports(robot, allowed)?))
    }

    /// Owns the state of the machine.
    pub(super) fn own_state<K: MachineKind<N>, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
    ) -> Result<MachineState, Box<dyn std::error::Error>> {
        let place = match &self.epoch_file {
            Some(file) => StatePlace::named(file),
            None => {
                let name = self
                    .name
                    .clone()
                    .unwrap_or_else(|| MachineName::of(K::MODEL, robot.checksum(), self.listen));
                Environment::of_process().place(&name, self.plant.is_simulated())?
            }
        };
        tracing::debug!("state of the machine: {}", place.epoch_file.display());
        Ok(MachineState::own(
            &place,
            &format!("serve, {} on {}", K::MODEL, self.listen),
        )?)
    }

    /// Owns the addresses for clients, accelerometer and LabComm, in this order.
    pub(super) fn own_ports<K: MachineKind<N>, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
        allowed: &Allowed,
    ) -> Result<Ports, Box<dyn std::error::Error>> {
        let listen = Listen {
            address: self.listen,
            transport: transport(self.udp),
            allowed: allowed.clone(),
        };
        let files: Vec<PathBuf> = self.key.iter().map(|file| file.to_path_buf()).collect();
        let keyring = key_file::keyring(&files)?;
        let clients = Listening::bind(&listen)?.with_keys(keyring);
        let accelerometer = (robot.sensor.accelerometer.as_ref())
            .map(|_| AccelerometerPublisher::bind(self.accelerometer))
            .transpose()
            .map_err(|error| ServerError::listen(self.accelerometer, &error))?
            .map(|accelerometer| accelerometer.for_peers(allowed.clone()));
        let publications = self.publications.bind::<N>(
            allowed,
            &self.machine(robot),
            robot.simulation.gauge_resolution_m,
        )?;
        Ok(Ports {
            clients,
            accelerometer,
            publications,
        })
    }

    /// Identity of the machine for readers of samples.
    fn machine<K: MachineKind<N>, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
    ) -> MachineIdentity {
        // One that was changed meanwhile has another checksum, and no reader draws it.
        let text = text_of(&self.robot).unwrap_or_default();
        MachineIdentity {
            lockstep: u8::from(self.pace == Pace::Lockstep),
            ..identity::machine(robot, &text)
        }
    }

    /// Knowledge of the command line about a machine without state.
    const fn first_run(&self) -> FirstRun {
        if self.first_run {
            FirstRun::Declared
        } else if self.plant.is_simulated() && self.listen.ip().is_loopback() {
            FirstRun::Harmless
        } else {
            FirstRun::Unexpected
        }
    }

    /// Gives up the privileges of the main thread, and so of every thread that it starts from here
    /// on.
    fn give_up_privileges(&self) {
        let recording = self.record.as_ref().map(|to| to.path().to_owned());
        // The files of the state are open.
        let files: Vec<PathBuf> = [recording, self.black_box.clone()]
            .into_iter()
            .flatten()
            .collect();
        match privileges::give_up(&files) {
            Ok(None) => {}
            Ok(Some(file)) => tracing::warn!(
                "the capability CAP_DAC_OVERRIDE is kept, to write {}, which belongs to another user; start the server as that user",
                file.display()
            ),
            Err(error) => tracing::warn!("the privileges cannot be given up: {error}"),
        }
    }

    fn check(&self) -> Result<(), &'static str> {
        if !(0.0..=2_000.0).contains(&self.force_max_n()) {
            return Err("--force-max must be from 0 to 2000 N");
        }
        if !(0.1..=3_600.0).contains(&self.step_s()) {
            return Err("--step-seconds must be from 0.1 to 3600");
        }
        let is_simulated = self.plant == PlantChoice::Simulated;
        let needs_simulation = self.plan.is_some()
            || self.workpiece.is_some()
            || self.quasi_static
            || self.point_samples;
        if !is_simulated && needs_simulation {
            return Err(
                "--plan, --workpiece, --quasi-static and --point-samples need the simulated machine: --plant simulated",
            );
        }
        let is_remote = matches!(self.plant, PlantChoice::Socket(_));
        let moves_tool = self.tap.is_some() || self.milling.is_some();
        if (is_remote || !self.plant.is_simulated()) && moves_tool {
            return Err("--tap and --milling need a simulated tool: --plant simulated");
        }
        let has_steps = self.force_max.is_some() || self.step_seconds.is_some();
        if (is_remote || !self.plant.is_simulated()) && has_steps {
            return Err("--force-max and --step-seconds need a simulated tool: --plant simulated");
        }
        if is_remote && self.motion != 0.0 {
            return Err("--motion needs drives of this program: the path is the simulator's");
        }
        if is_remote && self.pace != Pace::Lockstep {
            return Err("--plant socket: goes in lock-step only: --pace lockstep");
        }
        if !(-1_000.0..=1_000.0).contains(&self.motion) {
            return Err("--motion must be from -1000 to 1000 mm");
        }
        Ok(())
    }

    fn force_max_n(&self) -> f64 {
        self.force_max.unwrap_or(300.0)
    }

    fn step_s(&self) -> f64 {
        self.step_seconds.unwrap_or(2.0)
    }

    /// Checks that the machine takes velocities, if its robot file has position loops for it.
    fn check_interface<K, const N: usize>(&self, robot: &RobotFile<K, N>) -> Result<(), Failure> {
        let needs = match (&self.plant, &self.plan) {
            (PlantChoice::Simulated, None) => return Ok(()),
            (PlantChoice::Simulated, Some(_)) => "--plan needs",
            (PlantChoice::Socket(_), _) => "a simulator behind a socket (--plant) takes",
            _ => "drives over EtherCAT (--plant) take",
        };
        match robot.position_loops {
            None => Ok(()),
            Some(_) => Err(format!(
                "{}: drives.interface: is \"velocity\"; {needs} \"position\"",
                robot.name
            )
            .into()),
        }
    }

    fn motion<K: MachineKind<N>, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
    ) -> Result<Motion<N>, RobotFileError> {
        Ok(self.motion_from(robot.home_axes_m()?))
    }

    /// The motion of the nominal path from where the axes stand, m.
    pub(super) fn motion_from<const N: usize>(&self, start_m: [f64; N]) -> Motion<N> {
        Motion::by(start_m, self.motion * 1e-3)
    }

    /// The load on a simulated tool.
    pub(super) fn load(&self, mut hand: LoadGenerator, glide_cycles: u32) -> LoadProfile {
        hand.glide(glide_cycles);
        if let Some(cutter) = self.milling {
            return LoadProfile::of(hand, LoadPattern::Milling(cutter));
        }
        if let Some(Tap { force_n, cycles }) = self.tap {
            let every_cycles = (self.step_s() * 1e3).round() as u32;
            let tap = LoadPattern::Tap {
                force_n,
                cycles,
                every_cycles,
            };
            return LoadProfile::of(hand, tap);
        }
        let force_max_n = match self.workpiece {
            Some(_) => 0.0,
            None => self.force_max_n(),
        };
        LoadProfile::new(hand, force_max_n, self.step_s())
    }
}

/// Reads the keyboard in a thread that ends with the process.
fn listen_to_the_keyboard(controls: Arc<Controls>) {
    read_keyboard(move |input| keyboard::listen(input, &controls));
}
