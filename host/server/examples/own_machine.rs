#![allow(missing_docs)]
use gantry_tau_server::gantry_tau_core::*;
use gantry_tau_server::plant::{Plant, PlantError, Reading};
use gantry_tau_server::server::*;
use gantry_tau_server::state::{FirstRun, MachineState, StatePlace};

struct Machine([InForce; 3]); // three drives that take positions
impl Plant<3, 3> for Machine {
    type Error = PlantError; // or that of your bus
    fn in_force(&mut self) -> Result<[InForce; 3], PlantError> {
        Ok(self.0) // read back from the drives
    }
    fn read(&mut self, _elapsed_cycles: u64) -> Result<Reading<3>, PlantError> {
        Ok(Reading::of_axes([PositionNm(0); 3], [Actual::ZERO; 3])) // the path, and the encoders
    }
    fn write(&mut self, _: &[Reference; 3], parts: &[InForce; 3]) -> Result<(), PlantError> {
        self.0 = *parts; // the references go to the drives
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let limits = Limits::new(LimitValues {
        max: 2_000_000, // nm: offsets of at most 2 mm,
        step: 5_000,    // 5 um per tick,
        accel: 10_000,
        ramp: 100, // and 0.1 um per tick on the way back to zero
    })?;
    let axis = AxisConfig::position_only(limits, Travel::around_zero(1_000_000_000), 2_000_000);
    let config = Config::new(Parameters::thesis([axis; 3]))?;
    let motors = MotorMap::new([0, 1, 2])?;
    let place = StatePlace::named("machine.epoch".as_ref()); // outlives a server: epochs, the stop
    let state = MachineState::own(&place, "own_machine")?.begin(FirstRun::Unexpected)?;
    let machine = Machine([InForce::at(PositionNm(0)); 3]);
    let address: std::net::SocketAddr = "127.0.0.1:2013".parse()?;
    let cycle = Cycle::new(config, motors, machine, state.epochs, state.latch, address)?;
    let (server, _records) = Server::spawn(cycle, TickSource::RealTime)?;
    std::io::stdin().read_line(&mut String::new())?; // Enter ends the server
    Ok(server.quit().map(|_missed| ())?)
}
