//! Components by their numbers, which a master takes for addresses.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

use gantry_tau_fmi::instance::CallRefused;

use crate::component::Component;
use crate::logger::Logger;
use crate::numbers::fresh_number;
use crate::types::{fmi2Component, fmi2Status};

/// A component that may be in use by one thread.
type Shared = Arc<Mutex<Component>>;

static COMPONENTS: Mutex<BTreeMap<usize, Shared>> = Mutex::new(BTreeMap::new());

/// Keeps a component. Returns what the master knows it by.
pub(crate) fn keep(component: Component) -> fmi2Component {
    let number = fresh_number();
    let mut components = COMPONENTS.lock().unwrap_or_else(PoisonError::into_inner);
    components.insert(number, Arc::new(Mutex::new(component)));
    std::ptr::without_provenance_mut(number)
}

/// Frees a component; one that is unknown is left.
pub(crate) fn free(component: fmi2Component) {
    let mut components = COMPONENTS.lock().unwrap_or_else(PoisonError::into_inner);
    let freed = components.remove(&component.addr());
    drop(components);
    drop(freed);
}

fn find(component: fmi2Component) -> Option<Shared> {
    let components = COMPONENTS.lock().unwrap_or_else(PoisonError::into_inner);
    components.get(&component.addr()).cloned()
}

/// Calls a component, and tells its logger what is to be said. An unknown one is an error; a panic loses
/// it.
pub(crate) fn call(
    component: fmi2Component,
    body: impl FnOnce(&mut Component) -> Result<(), CallRefused>,
) -> fmi2Status {
    let Some(shared) = find(component) else {
        return fmi2Status::Error;
    };
    let (logger, status, sentences) = {
        let mut component = shared.lock().unwrap_or_else(PoisonError::into_inner);
        let (status, sentences) = called(&mut component, body);
        (component.logger.clone(), status, sentences)
    };
    // Unlocked: the logger may call.
    for (status, sentence) in sentences {
        logger.say(status, &sentence);
    }
    status
}

type Said = Vec<(fmi2Status, String)>;

fn called(
    component: &mut Component,
    body: impl FnOnce(&mut Component) -> Result<(), CallRefused>,
) -> (fmi2Status, Said) {
    if component.is_lost {
        let sentence = "the component is lost after a defect of this library; free it";
        return (
            fmi2Status::Fatal,
            vec![(fmi2Status::Fatal, sentence.to_owned())],
        );
    }
    let result = catch_unwind(AssertUnwindSafe(|| body(component)));
    let warnings = component.instance.take_warnings().into_iter();
    let mut said: Said = warnings
        .map(|warning| (fmi2Status::Warning, warning))
        .collect();
    let status = match result {
        Ok(Ok(())) if said.is_empty() => fmi2Status::Ok,
        Ok(Ok(())) => fmi2Status::Warning,
        Ok(Err(refused)) => {
            said.push((fmi2Status::Error, refused.to_string()));
            fmi2Status::Error
        }
        Err(_) => {
            component.is_lost = true;
            let sentence = "a defect of this library (its text is on standard error)";
            said.push((fmi2Status::Fatal, sentence.to_owned()));
            fmi2Status::Fatal
        }
    };
    (status, said)
}

/// Creates a component. A reason against it is told to the logger, and null is returned.
pub(crate) fn create(
    logger: Logger,
    body: impl FnOnce(Logger) -> Result<Component, String>,
) -> fmi2Component {
    let for_errors = logger.clone();
    match catch_unwind(AssertUnwindSafe(|| body(logger))) {
        Ok(Ok(component)) => keep(component),
        Ok(Err(reason)) => {
            for_errors.say(fmi2Status::Error, &reason);
            std::ptr::null_mut()
        }
        Err(_) => {
            let sentence = "a defect of this library (its text is on standard error)";
            for_errors.say(fmi2Status::Fatal, sentence);
            std::ptr::null_mut()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gantry_tau_fmi::instance::Instance;
    use gantry_tau_fmi::kind::Kind;
    use gantry_tau_machine::robot_file::AnyRobotFile;

    #[test]
    fn a_panic_becomes_fatal_and_loses_its_component_alone() {
        let [lost, other] = [(); 2].map(|()| {
            let robot = AnyRobotFile::named("l2").unwrap();
            let instance = Instance::new(Kind::Compensator, robot).unwrap();
            create(Logger::new("", None), |logger| {
                Ok(Component::of(instance, logger))
            })
        });
        assert!(!lost.is_null() && !other.is_null());
        let status = call(lost, |_| panic!("on purpose"));
        assert_eq!(status, fmi2Status::Fatal);
        assert_eq!(call(lost, |_| Ok(())), fmi2Status::Fatal);
        assert_eq!(call(other, |_| Ok(())), fmi2Status::Ok);
        for component in [lost, other, lost] {
            free(component);
            assert_eq!(call(component, |_| Ok(())), fmi2Status::Error);
        }
    }
}
