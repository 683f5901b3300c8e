//! A component: a unit, its logger, its saved states.

use std::collections::BTreeMap;
use std::path::Path;

use gantry_tau_fmi::instance::{CallRefused, Instance, Saved};
use gantry_tau_fmi::kind::{Kind, MARK};
use gantry_tau_fmi::resources::{ROBOT_FILE, folder};
use gantry_tau_machine::robot_file::AnyRobotFile;

use crate::logger::Logger;
use crate::numbers::fresh_number;

/// A component.
pub(crate) struct Component {
    pub(crate) logger: Logger,
    pub(crate) instance: Instance,
    /// Saved states, by their numbers.
    states: BTreeMap<usize, Saved>,
    /// A panic has left it in an unknown state.
    pub(crate) is_lost: bool,
}

impl Component {
    /// Creates the unit of a GUID for the robot file of a folder.
    pub(crate) fn new(guid: &str, resources: &str, logger: Logger) -> Result<Self, String> {
        let other = format!("the description is of another unit; expected one of {MARK}");
        let kind =
            Kind::of_guid(guid).map_err(|error| format!("GUID {guid}: {other} ({error})"))?;
        let path = folder(resources)?.join(ROBOT_FILE);
        let instance = Instance::new(kind, read(&path)?).map_err(|error| error.to_string())?;
        if instance.guid() != guid {
            let own = instance.guid();
            return Err(format!(
                "GUID {guid}: {other}, or {ROBOT_FILE} has another number of axes: {own}"
            ));
        }
        Ok(Self::of(instance, logger))
    }

    pub(crate) const fn of(instance: Instance, logger: Logger) -> Self {
        Self {
            logger,
            instance,
            states: BTreeMap::new(),
            is_lost: false,
        }
    }

    /// Saves the state, in place of that of `number` if it is known. Returns its number.
    pub(crate) fn save(&mut self, number: Option<usize>) -> usize {
        let number = number
            .filter(|number| self.states.contains_key(number))
            .unwrap_or_else(fresh_number);
        self.states.insert(number, self.instance.save());
        number
    }

    /// Goes on from a saved state.
    pub(crate) fn restore(&mut self, number: usize) -> Result<(), CallRefused> {
        let saved = self.states.get(&number).ok_or_else(unknown_state)?;
        self.instance.restore(saved);
        Ok(())
    }

    /// Frees a saved state.
    pub(crate) fn forget(&mut self, number: usize) -> Result<(), CallRefused> {
        let forgotten = self.states.remove(&number);
        forgotten.map(drop).ok_or_else(unknown_state)
    }
}

fn read(path: &Path) -> Result<AnyRobotFile, String> {
    AnyRobotFile::load(path).map_err(|error| error.to_string())
}

fn unknown_state() -> CallRefused {
    CallRefused::because("the state is unknown: freed, or not one of this component")
}
