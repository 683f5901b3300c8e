//! The simulated L2 with instruments that say what a test wants.

use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_machine::model::L2_MOTORS;
use gantry_tau_server::plant::{Plant, PlantError, Reading};
use gantry_tau_sim::machine::SimulatedMachine;

/// The simulated L2, whose instruments speak in the cycle as honest ones would.
#[derive(Debug)]
pub struct Liar<F> {
    machine: SimulatedMachine<ARMS, L2_MOTORS>,
    /// Changes the reading of a tick, or publishes its samples.
    speak: F,
    reads: u64,
}

impl<F: FnMut(u64, &mut Reading<ARMS>) + Send> Liar<F> {
    /// Takes what changes each reading, by the number of the tick.
    #[must_use]
    pub const fn new(machine: SimulatedMachine<ARMS, L2_MOTORS>, speak: F) -> Self {
        Self {
            machine,
            speak,
            reads: 0,
        }
    }
}

impl<F: FnMut(u64, &mut Reading<ARMS>) + Send> Plant<ARMS, L2_MOTORS> for Liar<F> {
    type Error = PlantError;

    fn in_force(&mut self) -> Result<[InForce; ARMS], PlantError> {
        self.machine.in_force()
    }

    fn read(&mut self, elapsed: u64) -> Result<Reading<ARMS>, PlantError> {
        let mut reading = self.machine.read(elapsed)?;
        // The read before the first cycle is that of tick 0.
        (self.speak)(self.reads, &mut reading);
        self.reads += 1;
        Ok(reading)
    }

    fn write(
        &mut self,
        references: &[Reference; L2_MOTORS],
        parts: &[InForce; ARMS],
    ) -> Result<(), PlantError> {
        self.machine.write(references, parts)
    }
}
