//! A simulated machine and the compensation of its client, cycle by cycle, without a server.

use gantry_tau_client::Compensation;
use gantry_tau_core::control::axis::{InForce, Offsets, Reference};
use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::control::message::{Capabilities, Welcome};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::{Epoch, OffsetNm, PositionNm, Tick, TorquePermille, VelocityUmS};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::{Plant, ToolReading};
use gantry_tau_sim::machine::SimulatedMachine;

/// A machine with `N` axes and `M` motors, and its compensation.
pub struct CompensatedMachine<const N: usize, const M: usize> {
    machine: SimulatedMachine<N, M>,
    compensation: Compensation<N>,
    motors: MotorMap<N, M>,
    nominal: [PositionNm; N],
}

impl<const N: usize, const M: usize> CompensatedMachine<N, M> {
    /// Joins a machine and the client of a robot file.
    ///
    /// # Panics
    /// The file is not that of a compensated machine with `M` motors.
    #[must_use]
    pub fn new<K: MachineKind<N>>(
        machine: SimulatedMachine<N, M>,
        client: &RobotFile<K, N>,
    ) -> Self {
        let welcome = Welcome {
            epoch: Epoch(1),
            tick: Tick(0),
            cycle_us: 1_000,
            echo_window: 0,
            capabilities: Capabilities::NONE,
            kinematics_checksum: 0,
            limits: client.limits.map(|axis| axis.limits),
        };
        Self {
            machine,
            compensation: Compensation::new(client, &welcome).unwrap(),
            motors: client.motor_map().unwrap(),
            nominal: [PositionNm(0); N],
        }
    }

    /// Returns the load that the compensation found in the last cycle.
    #[must_use]
    pub fn load(&self) -> Wrench {
        self.compensation.load()
    }

    /// Runs a cycle of the machine. Returns its instruments, and the offsets that answer them.
    ///
    /// # Panics
    /// The machine or the compensation fails.
    pub fn read(&mut self) -> (ToolReading, [OffsetNm; N]) {
        let reading = self.machine.read(1).unwrap();
        let shown = reading.tool.unwrap();
        self.nominal = reading.nominal;
        let raw = Wrench::from_array(shown.sensor);
        let answer = self.compensation.cycle(&raw, &reading.nominal).unwrap();
        (shown, answer.offsets)
    }

    /// Writes the nominal positions with these offsets, for the next cycle.
    ///
    /// # Panics
    /// The machine refuses them.
    pub fn write(&mut self, offsets: &[OffsetNm; N]) {
        let parts: [InForce; N] = std::array::from_fn(|axis| InForce {
            nominal: self.nominal[axis],
            offsets: Offsets::position(offsets[axis]),
        });
        let references = self.motors.axis_of_motor().map(|axis| Reference {
            position: PositionNm(parts[axis].nominal.0 + i64::from(offsets[axis].0)),
            velocity_offset: VelocityUmS(0),
            torque_offset: TorquePermille(0),
        });
        self.machine.write(&references, &parts).unwrap();
    }
}
