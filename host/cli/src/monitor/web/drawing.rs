//! The machine that a page draws: that of a robot file, or that of the server.

use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFileError};

use super::figure::{Drawn, Figures};
use crate::monitor::machine::{MachineName, name_of};
use crate::monitor::{SAMPLES, ServerMachine, Snapshot};

/// Reason why a page draws no machine, for people.
#[derive(Clone, Debug, thiserror::Error)]
pub(super) enum DrawingError {
    /// The server does not say which machine it has.
    #[error(
        "Unknown machine: the port does not publish the sample machine, and needs serve --labcomm HOST:PORT={SAMPLES}."
    )]
    NotPublished,
    /// The server's machine is not built in.
    #[error("Unknown machine {0}: name its robot file with --robot.")]
    Unknown(MachineName),
    /// The robot file that was named is not that of the server's machine.
    #[error(
        "The server's machine is {served}, this page's is {own}: name its robot file with --robot."
    )]
    OtherMachine {
        /// Machine of the server.
        served: MachineName,
        /// Machine of the robot file.
        own: MachineName,
    },
    /// The robot file cannot be drawn.
    #[error(transparent)]
    RobotFile(#[from] RobotFileError),
    /// The server's ticks are not those of its machine.
    #[error("The server sends {sent} axes, and its machine has {axes}.")]
    Axes {
        /// Number of axes of a tick.
        sent: usize,
        /// Number of axes of the machine.
        axes: usize,
    },
    /// The kinematics have no pose.
    #[error("The machine cannot be at these positions: {0}.")]
    Positions(#[source] KinematicsError),
}

/// Machine of a page. It is drawn only if it is the server's.
pub(super) struct Drawing {
    /// Robot file that was named; `None`: that of the server's machine.
    named: Option<AnyRobotFile>,
    served: Option<Served>,
    /// Number of the machine: another one after each change.
    number: u64,
}

/// Machine of the server.
struct Served {
    machine: ServerMachine,
    /// Its figures, or the reason for which there are none.
    figures: Result<Box<dyn Figures>, DrawingError>,
}

impl Drawing {
    pub(super) const fn of(named: Option<AnyRobotFile>) -> Self {
        Self {
            named,
            served: None,
            number: 0,
        }
    }

    /// Returns the points of a tick as JSON.
    ///
    /// # Errors
    /// [`DrawingError`].
    pub(super) fn figure(
        &mut self,
        snapshot: &Snapshot,
        machine: Option<&ServerMachine>,
    ) -> Result<String, DrawingError> {
        let figures = self.figures(machine)?;
        if snapshot.axes.len() != figures.axes() {
            return Err(DrawingError::Axes {
                sent: snapshot.axes.len(),
                axes: figures.axes(),
            });
        }
        figures.figure(snapshot).map_err(DrawingError::Positions)
    }

    /// Returns the parts of the machine as JSON, with its number, if it is another than that with
    /// `number`.
    pub(super) fn machine_after(&self, number: u64) -> Option<(u64, String)> {
        let figures = self.served.as_ref()?.figures.as_ref().ok()?;
        (self.number != number).then(|| (self.number, figures.machine()))
    }

    fn figures(
        &mut self,
        machine: Option<&ServerMachine>,
    ) -> Result<&mut dyn Figures, DrawingError> {
        let machine = machine.ok_or(DrawingError::NotPublished)?;
        let last = self.served.take();
        let served = match last.filter(|last| last.machine == *machine) {
            Some(same) => same,
            None => {
                self.number += 1;
                Served {
                    machine: machine.clone(),
                    figures: self.figures_of(machine),
                }
            }
        };
        match &mut self.served.insert(served).figures {
            Ok(figures) => Ok(figures.as_mut()),
            Err(reason) => Err(reason.clone()),
        }
    }

    fn figures_of(&self, machine: &ServerMachine) -> Result<Box<dyn Figures>, DrawingError> {
        let robot = match &self.named {
            Some(named) => {
                let own = name_of(named);
                if own.kinematics != machine.name.kinematics {
                    return Err(DrawingError::OtherMachine {
                        served: machine.name.clone(),
                        own,
                    });
                }
                named.clone()
            }
            None => machine
                .robot()
                .ok_or_else(|| DrawingError::Unknown(machine.name.clone()))?,
        };
        Ok(figures(robot)?)
    }
}

fn figures(robot: AnyRobotFile) -> Result<Box<dyn Figures>, RobotFileError> {
    Ok(match robot {
        AnyRobotFile::L2(robot) => Box::new(Drawn::new(*robot)?),
        AnyRobotFile::F1(robot) => Box::new(Drawn::new(*robot)?),
    })
}
