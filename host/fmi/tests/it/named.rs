//! Units that tests couple.
use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_fmi::instance::Instance;
use gantry_tau_fmi::kind::Kind;
use gantry_tau_machine::robot_file::AnyRobotFile;
use gantry_tau_sim::load_generator::Load;

/// Length of a cycle, s.
pub(crate) const CYCLE_S: f64 = 1e-3;

/// End of a tick.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Row {
    pub(crate) phase: Phase,
    pub(crate) cause: Cause,
    pub(crate) missed: u32,
    pub(crate) references_nm: Vec<i64>,
    pub(crate) offsets_nm: Vec<i32>,
    pub(crate) computed_nm: Vec<i32>,
    pub(crate) sensor: [f64; 6],
    pub(crate) displacement_m: [f64; 3],
}

/// A unit that is read and written by names.
pub(crate) struct Named {
    pub(crate) instance: Instance,
}

impl Named {
    pub(crate) fn new(kind: Kind, robot: &AnyRobotFile) -> Self {
        let instance = Instance::new(kind, robot.clone()).unwrap();
        Self { instance }
    }

    /// A unit that has begun, with these values.
    pub(crate) fn begun(kind: Kind, robot: &AnyRobotFile, values: &[(&str, f64)]) -> Self {
        let mut unit = Self::new(kind, robot);
        unit.instance.setup_experiment(0.0, None).unwrap();
        for (name, value) in values {
            unit.set(name, *value);
        }
        unit.instance.enter_initialization().unwrap();
        unit.instance.exit_initialization().unwrap();
        unit
    }

    pub(crate) fn reference(&self, name: &str) -> u32 {
        self.instance
            .reference_of(name)
            .unwrap_or_else(|| panic!("no variable {name}"))
    }

    pub(crate) fn set(&mut self, name: &str, value: f64) {
        let reference = self.reference(name);
        self.instance.set(reference, value).unwrap();
    }

    /// The value before the first step.
    pub(crate) fn start(&self, name: &str) -> f64 {
        let mut variables = self.instance.variables().iter();
        variables
            .find(|variable| variable.name == name)
            .unwrap()
            .start
    }

    pub(crate) fn get(&self, name: &str) -> f64 {
        self.instance.get(self.reference(name)).unwrap()
    }

    /// Elements `name[1]` to `name[count]`.
    pub(crate) fn all(&self, name: &str, count: usize) -> Vec<f64> {
        (1..=count)
            .map(|element| self.get(&format!("{name}[{element}]")))
            .collect()
    }

    pub(crate) fn set_all(&mut self, name: &str, values: &[f64]) {
        for (index, value) in values.iter().enumerate() {
            self.set(&format!("{name}[{}]", index + 1), *value);
        }
    }

    pub(crate) fn step(&mut self, cycles: u32) {
        let time = self.instance.time();
        self.instance
            .step(time, f64::from(cycles) * CYCLE_S)
            .unwrap();
    }

    /// Every output, as bits.
    pub(crate) fn bits(&self) -> Vec<u64> {
        let count = self.instance.variables().len();
        (0..count as u32)
            .map(|reference| self.instance.get(reference).unwrap().to_bits())
            .collect()
    }
}

/// Server and machine.
pub(crate) struct Coupled {
    pub(crate) server: Named,
    pub(crate) machine: Named,
    axes: usize,
}

impl Coupled {
    pub(crate) fn new(robot: &AnyRobotFile, motion_m: f64) -> Self {
        let axes = match robot {
            AnyRobotFile::L2(_) => 3,
            AnyRobotFile::F1(_) => 6,
        };
        Self {
            server: Named::begun(Kind::Server, robot, &[]),
            machine: Named::begun(Kind::Machine, robot, &[("motion", motion_m)]),
            axes,
        }
    }

    /// References to the machine, a cycle of it.
    pub(crate) fn machine_step(&mut self, load: &Load) {
        for name in ["reference", "offset", "velocity_offset", "torque_offset"] {
            self.machine
                .set_all(name, &self.server.all(name, self.axes));
        }
        self.machine.set_all("load_force", &load.force_n);
        self.machine.set_all("load_moment", &load.moment_nm);
        self.machine.step(1);
    }

    /// Readings to the server, a tick of it.
    pub(crate) fn server_step(&mut self, cable: bool) {
        self.server
            .set_all("nominal", &self.machine.all("nominal", self.axes));
        for name in ["force", "moment"] {
            self.server.set_all(name, &self.machine.all(name, 3));
        }
        self.server.set("machine_ok", self.machine.get("ok"));
        self.server.set("cable", f64::from(u8::from(cable)));
        self.server.step(1);
    }

    pub(crate) fn row(&self) -> Row {
        let nm = |name| {
            let metres = self.server.all(name, self.axes).into_iter();
            metres.map(|m| (m * 1e9).round()).collect::<Vec<_>>()
        };
        let whole = |name| nm(name).into_iter().map(|nm| nm as i32).collect();
        let sensor = [self.machine.all("force", 3), self.machine.all("moment", 3)].concat();
        Row {
            phase: Phase::from_code(self.server.get("phase") as u8).unwrap(),
            cause: Cause::from_code(self.server.get("cause") as u8).unwrap(),
            missed: self.server.get("missed") as u32,
            references_nm: nm("reference").into_iter().map(|nm| nm as i64).collect(),
            offsets_nm: whole("offset"),
            computed_nm: whole("computed"),
            sensor: sensor.try_into().unwrap(),
            displacement_m: self.machine.all("displacement", 3).try_into().unwrap(),
        }
    }
}
