//! From the creation of a component to its end.

use std::ffi::c_int;

use gantry_tau_fmi::instance::CallRefused;

use crate::arguments::{one, text};
use crate::component::Component;
use crate::logger::Logger;
use crate::registry::{call, create, free};
use crate::types::{
    CO_SIMULATION, FALSE, fmi2Boolean, fmi2CallbackFunctions, fmi2Component, fmi2Real, fmi2Status,
    fmi2String,
};

/// Creates a component; null if it is refused. The logger hears the reason.
///
/// # Safety
/// Every text ends with a zero, or is null. `functions` is null or points to the master's functions.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn fmi2Instantiate(
    instance_name: fmi2String,
    fmu_type: c_int,
    fmu_guid: fmi2String,
    fmu_resource_location: fmi2String,
    functions: *const fmi2CallbackFunctions,
    _visible: fmi2Boolean,
    _logging_on: fmi2Boolean,
) -> fmi2Component {
    // SAFETY: the caller's promise.
    let functions = unsafe { one("functions", functions) };
    // SAFETY: the caller's promise.
    let name = unsafe { text("instance name", instance_name) };
    let known_as = name.as_deref().unwrap_or_default();
    let logger = Logger::new(known_as, functions.as_ref().ok());
    create(logger, |logger| {
        functions?;
        if name?.is_empty() {
            return Err("instance name: is empty".to_owned());
        }
        if fmu_type != CO_SIMULATION {
            return Err("type: expected co-simulation".to_owned());
        }
        // SAFETY: the caller's promise.
        let guid = unsafe { text("GUID", fmu_guid) }?;
        // SAFETY: the caller's promise.
        let resources = unsafe { text("resource location", fmu_resource_location) }?;
        Component::new(&guid, &resources, logger)
    })
}

/// Frees a component and its saved states; null and what is unknown is left.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2FreeInstance(component: fmi2Component) {
    free(component);
}

/// Errors and warnings are told always, and there is nothing else to tell.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2SetDebugLogging(
    component: fmi2Component,
    _logging_on: fmi2Boolean,
    _n_categories: usize,
    _categories: *const fmi2String,
) -> fmi2Status {
    call(component, |_| Ok(()))
}

/// Takes the time of the experiment.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2SetupExperiment(
    component: fmi2Component,
    _tolerance_defined: fmi2Boolean,
    _tolerance: fmi2Real,
    start_time: fmi2Real,
    stop_time_defined: fmi2Boolean,
    stop_time: fmi2Real,
) -> fmi2Status {
    call(component, |component| {
        let stop = (stop_time_defined != FALSE).then_some(stop_time);
        component.instance.setup_experiment(start_time, stop)
    })
}

/// Begins the initialization.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2EnterInitializationMode(component: fmi2Component) -> fmi2Status {
    call(component, |component| {
        component.instance.enter_initialization()
    })
}

/// Ends the initialization.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2ExitInitializationMode(component: fmi2Component) -> fmi2Status {
    call(component, |component| {
        component.instance.exit_initialization()
    })
}

/// Ends the simulation.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2Terminate(component: fmi2Component) -> fmi2Status {
    call(component, |component| component.instance.terminate())
}

/// Returns to where the component was when it was created. Saved states stay.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2Reset(component: fmi2Component) -> fmi2Status {
    call(component, |component| -> Result<(), CallRefused> {
        component.instance.reset();
        Ok(())
    })
}
