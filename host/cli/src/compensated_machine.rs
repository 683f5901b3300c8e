//! A simulated machine and the compensation of its client, cycle by cycle, without a server.

use std::error::Error;

use gantry_tau_client::{Compensation, Samples};
use gantry_tau_core::control::axis::{InForce, Offsets, Reference};
use gantry_tau_core::control::channel::Channel;
use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::control::message::{Capabilities, Welcome};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::{Epoch, OffsetNm, PositionNm, Tick, TorquePermille, VelocityUmS};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{CYCLE_US, RobotFile};
use gantry_tau_server::plant::{Plant, ToolReading};
use gantry_tau_sim::machine::SimulatedMachine;

/// A machine with `N` axes and `M` motors, and its compensation.
pub struct CompensatedMachine<const N: usize, const M: usize> {
    machine: SimulatedMachine<N, M>,
    compensation: Compensation<N>,
    motors: MotorMap<N, M>,
    nominal: [PositionNm; N],
    tick: Tick,
    welcome: Welcome<N>,
    /// Offsets of [`cycle`](Self::cycle).
    channels: [Channel<OffsetNm>; N],
    torques: [Channel<TorquePermille>; N],
    /// Answer of the last cycle, which acts in the next.
    answer: [OffsetNm; N],
    torque_answer: [TorquePermille; N],
}

impl<const N: usize, const M: usize> CompensatedMachine<N, M> {
    /// Joins a machine and the client of a robot file.
    ///
    /// # Errors
    /// The file has no compensation, or other motors.
    pub fn new<K: MachineKind<N>>(
        machine: SimulatedMachine<N, M>,
        client: &RobotFile<K, N>,
    ) -> Result<Self, Box<dyn Error>> {
        let welcome = Welcome {
            epoch: Epoch(1),
            tick: Tick(0),
            cycle_us: CYCLE_US,
            echo_window: 0,
            capabilities: Capabilities::NONE,
            kinematics_checksum: 0,
            limits: client.limits.map(|axis| axis.limits),
        };
        Ok(Self {
            machine,
            compensation: Compensation::new(client, &welcome)?,
            motors: client.motor_map()?,
            nominal: [PositionNm(0); N],
            tick: Tick(0),
            welcome,
            channels: [Channel::ZERO; N],
            torques: [Channel::ZERO; N],
            answer: [OffsetNm(0); N],
            torque_answer: [TorquePermille(0); N],
        })
    }

    /// Returns the load that the compensation found in the last cycle.
    #[must_use]
    pub fn load(&self) -> Wrench {
        self.compensation.load()
    }

    /// Returns the nominal positions of the last cycle, m.
    #[must_use]
    pub fn nominal_m(&self) -> [f64; N] {
        self.nominal.map(|position| position.to_metres().0)
    }

    /// Returns the offsets of [`cycle`](Self::cycle).
    #[must_use]
    pub const fn channels(&self) -> &[Channel<OffsetNm>; N] {
        &self.channels
    }

    /// Returns the torque offsets of [`cycle`](Self::cycle).
    #[must_use]
    pub fn torques(&self) -> [TorquePermille; N] {
        self.torques.map(|channel| channel.value())
    }

    /// Runs a cycle as with a server: an answer acts in the next one, within the limits of the file.
    ///
    /// # Errors
    /// The machine or the compensation fails.
    pub fn cycle(&mut self) -> Result<ToolReading, Box<dyn Error>> {
        let (shown, answer) = self.read()?;
        let targets = std::mem::replace(&mut self.answer, answer);
        let torques = std::mem::replace(&mut self.torque_answer, self.compensation.torques());
        let limits = &self.welcome.limits;
        for ((channel, target), limits) in self.channels.iter_mut().zip(targets).zip(limits) {
            *channel = channel.follow(target, &limits.position);
        }
        for ((channel, target), limits) in self.torques.iter_mut().zip(torques).zip(limits) {
            *channel = channel.follow(target, &limits.torque);
        }
        self.write(&self.channels.map(|channel| channel.value()))?;
        Ok(shown)
    }

    /// Runs a cycle of the machine. Returns its instruments, and the offsets that answer them.
    ///
    /// # Errors
    /// The machine or the compensation fails.
    pub fn read(&mut self) -> Result<(ToolReading, [OffsetNm; N]), Box<dyn Error>> {
        let reading = self.machine.read(1)?;
        let shown = reading.tool.ok_or("the machine has no instruments")?;
        self.nominal = reading.nominal;
        let samples = Samples {
            wrench: Wrench::from_array(shown.sensor),
            acceleration: shown.acceleration,
        };
        self.tick.0 += 1;
        let answer = self
            .compensation
            .cycle(self.tick, &samples, &reading.nominal)?;
        Ok((shown, answer.offsets))
    }

    /// Writes the nominal positions with these offsets, for the next cycle.
    ///
    /// # Errors
    /// The machine refuses them.
    pub fn write(&mut self, offsets: &[OffsetNm; N]) -> Result<(), Box<dyn Error>> {
        let mut parts = self.nominal.map(InForce::at);
        let mut of_axes = [Reference {
            position: PositionNm(0),
            velocity_offset: VelocityUmS(0),
            torque_offset: TorquePermille(0),
        }; N];
        let axes = parts.iter_mut().zip(&mut of_axes).zip(offsets);
        for (((part, of_axis), offset), torque) in axes.zip(&self.torques) {
            part.offsets = Offsets {
                torque: torque.value(),
                ..Offsets::position(*offset)
            };
            of_axis.torque_offset = torque.value();
            of_axis.position = PositionNm(part.nominal.0 + i64::from(offset.0));
        }
        let references = (self.motors.spread(&of_axes)).ok_or("a motor has no axis")?;
        self.machine.write(&references, &parts)?;
        Ok(())
    }
}
