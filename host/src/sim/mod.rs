//! The simulated machine of the demo: the first implementation of [`crate::plant::Plant`].
//!
//! It is deliberately *not* built from the compensator's model. The compensator linearises at the nominal pose
//! ([`gantry_tau_core::model::l2::Elastic`]); here springs, joints and motors find their own nonlinear equilibrium ([`crate::elastic`]),
//! their true compliances differ from the assumed ones, and a joint has backlash. The two share the description of the
//! machine ([`gantry_tau_core::model::robot`]) and the units.
//!
//! | module | contents |
//! |---|---|
//! | [`springs`] | the true compliances of one machine |
//! | [`campaign`] | the machine in a campaign: poses, levels, gauges |
//! | [`drive`] | cascade of an axis `[T 4.1.7]` |
//! | [`interpolator`] | nominal references, in place of the NC kernel `[T 4.1.1]` |
//! | [`gauges`] | length gauges of a campaign, with zeros, errors and drift |
//! | [`load_generator`] | the load on the tool, set from another thread `[T 4.2.9]` |
//! | [`load_profile`] | force steps during Obtain |
//! | [`workpiece`] | an elastic workpiece that the tool presses on |
//! | [`force_sensor`] | six-axis force sensor `[T 4.2.5]` |
//! | [`parameters`] | parameters of a simulation, and their errors |
//! | [`machine`] | all of it behind [`crate::plant::Plant`], with length gauges at the tool `[T 4.2.6]` |
//!
//! Everything is deterministic: equal parameters and equal calls give bit-equal readings.
#![expect(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    reason = "simulation, off the reference path: floats cannot panic, arrays have fixed lengths, release keeps overflow checks"
)]
#![cfg_attr(
    test,
    allow(
        clippy::float_cmp,
        clippy::needless_range_loop,
        reason = "the tests compare floats that must be bit-equal, and walk several arrays by one axis number"
    )
)]

pub mod campaign;
pub mod drive;
pub mod force_sensor;
pub mod gauges;
pub mod interpolator;
pub mod load_generator;
pub mod load_profile;
pub mod machine;
pub mod parameters;
pub mod springs;
pub mod workpiece;

#[cfg(test)]
pub(crate) mod fixture;
