//! The units of [`gantry_tau_fmi`] with the C interface of FMI 2.0, co-simulation. This package has all
//! of their unsafe code: it reads what a master points to, and calls its logger.
//!
//! A component and a saved state are numbers, not addresses: one that is null, freed or made up is
//! unknown, and refused. What a master passes beside them must be what the standard asks for: an array
//! of as many elements as it says, a text that ends.
//!
//! A panic does not leave the library: it becomes `fmi2Fatal`.

mod arguments;
mod component;
mod inquiry;
mod lifecycle;
mod logger;
mod numbers;
mod registry;
mod states;
mod steps;
mod types;
mod values;
