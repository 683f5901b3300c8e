//! The machine that a server moves: simulated here or in another process, or drives over EtherCAT.

use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::links::Allowed;
use gantry_tau_server::record::TickRecord;
use gantry_tau_sim::remote::RemoteMachine;
use gantry_tau_system::dial::{Addresses, NEVER};

use super::Outcome;
use super::serve::{Serve, positions_only};

/// Prefix of a bus.
const ETHERCAT: &str = "ethercat:";
/// Prefix of the address of a machine in another process.
const SOCKET: &str = "socket:";

/// Error of a program without EtherCAT.
#[cfg(not(all(feature = "ethercat", target_os = "linux")))]
pub(super) const WITHOUT_ETHERCAT: &str = "this program was built without EtherCAT; build it on Linux, in the repository: cargo install --path host/cli --features ethercat";

/// Choice of `--plant`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum PlantChoice {
    /// The simulated machine.
    Simulated,
    /// The simulated machine behind emulated drives.
    Emulated,
    /// Drives behind a network interface.
    Interface(String),
    /// A machine in another process.
    Socket(Addresses),
}

impl PlantChoice {
    /// True if nothing real moves.
    pub(super) const fn is_simulated(&self) -> bool {
        !matches!(self, Self::Interface(_))
    }
}

impl std::str::FromStr for PlantChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(address) = text.strip_prefix(SOCKET) {
            return match address.parse() {
                Ok(address) => Ok(Self::Socket(address)),
                Err(error) => Err(format!("{address}: {error}")),
            };
        }
        match text.strip_prefix(ETHERCAT) {
            None if text == "simulated" => Ok(Self::Simulated),
            Some("emulated") => Ok(Self::Emulated),
            Some(interface) if !interface.is_empty() => Ok(Self::Interface(interface.to_owned())),
            _ => Err(
                "expected simulated, socket:HOST:PORT, ethercat:emulated, or ethercat: with the name of a network interface".to_owned(),
            ),
        }
    }
}

impl Serve {
    /// Serves a machine in another process.
    pub(super) fn serve_remote<K: MachineKind<N>, const N: usize, const M: usize>(
        &self,
        robot: &RobotFile<K, N>,
        allowed: &Allowed,
        address: &Addresses,
    ) -> Outcome {
        let owned = self.own(robot, allowed)?;
        self.serve(robot, owned, positions_only, || {
            let machine = RemoteMachine::<N, M>::connect(address.clone(), robot, &NEVER)?;
            Ok((machine, |_: &TickRecord<N>| {}))
        })
    }
}

#[cfg(not(all(feature = "ethercat", target_os = "linux")))]
impl Serve {
    /// Refuses: this program has no EtherCAT.
    pub(super) fn serve_bus<K: MachineKind<N>, const N: usize, const M: usize>(
        &self,
        _robot: &RobotFile<K, N>,
        _allowed: &Allowed,
    ) -> Outcome {
        Err(WITHOUT_ETHERCAT.into())
    }
}

#[cfg(all(feature = "ethercat", target_os = "linux"))]
impl Serve {
    /// Serves the drives of a bus.
    pub(super) fn serve_bus<K: MachineKind<N>, const N: usize, const M: usize>(
        &self,
        robot: &RobotFile<K, N>,
        allowed: &Allowed,
    ) -> Outcome {
        use crate::ethercat::{EthercatError, EthercatPlant, emulated_bus};
        use gantry_tau_machine::robot_file::Ethercat;
        use gantry_tau_sim::load_generator::load_generator;

        use super::serve::Owned;

        if let PlantChoice::Interface(interface) = &self.plant {
            let section = robot
                .ethercat
                .as_ref()
                .ok_or_else(|| EthercatError::NoSection {
                    file: robot.name.clone(),
                })?;
            self.check_clocks(robot, section)?;
            let state = self.own_state(robot)?;
            let socket = gantry_tau_ethercat::RawSocket::open(interface)?;
            let owned = Owned::new(state, self.own_ports(robot, allowed)?);
            let link = self.gauges_of_bus(robot, allowed)?;
            return self.serve(robot, owned, positions_only, || {
                let mut plant =
                    EthercatPlant::<_, N, M>::open(robot, section, socket, |start_m| {
                        self.motion_from(start_m)
                    })?;
                if let Some(link) = link {
                    plant.publish_gauges(link);
                }
                let mut faults = plant.fault_log().of_interface(interface);
                Ok((plant, move |row: &TickRecord<N>| {
                    drop(faults.see(row.state.phase))
                }))
            });
        }
        let (hand, tool) = load_generator();
        let section = robot.ethercat.clone().unwrap_or_else(|| {
            Ethercat::emulated(&robot.motors.axis_of_motor, &robot.metres_per_q)
        });
        self.check_clocks(robot, &section)?;
        let owned = Owned::new(self.own_state(robot)?, self.own_ports(robot, allowed)?);
        let link = self.gauges_of_bus(robot, allowed)?;
        self.serve(robot, owned, positions_only, || {
            let bus = emulated_bus::<_, N, M>(robot, &section, tool)?;
            let mut plant = EthercatPlant::<_, N, M>::open(robot, &section, bus, |start_m| {
                self.motion_from(start_m)
            })?;
            if let Some(link) = link {
                plant.publish_gauges(link);
            }
            let mut faults = plant.fault_log();
            let mut load = self.load(hand, 0);
            Ok((plant, move |row: &TickRecord<N>| {
                load.update(row.state.phase, row.state.tick);
                faults.see(row.state.phase);
            }))
        })
    }

    /// Listens for readers of the gauges on the bus, if it has some.
    fn gauges_of_bus<K, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
        allowed: &Allowed,
    ) -> Result<Option<gantry_tau_server::links::gauges::GaugePublisher>, super::Failure> {
        let link = super::serve::has_gauges(robot).then(|| self.gauge_link(&robot.name, allowed));
        link.transpose()
    }

    /// Refuses clocks of the bus together with a pace that cannot follow them.
    fn check_clocks<K, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
        section: &gantry_tau_machine::robot_file::Ethercat,
    ) -> Result<(), super::Failure> {
        use gantry_tau_machine::robot_file::Clocks;

        if section.clocks == Clocks::Free || self.pace == super::Pace::Real {
            return Ok(());
        }
        Err(format!(
            "{}: ethercat.clocks: a cycle in lock-step (--pace lockstep) cannot follow SYNC0; expected \"free\"",
            robot.name
        )
        .into())
    }
}
