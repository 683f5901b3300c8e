//! Variables of the server.

use gantry_tau_client::Controller;
use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::control::message::{AxisFlags, State};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;

use crate::units::conversions::{metres, metres_per_s, offsets_m, share};
use crate::units::ports::{ForceInputs, LoadOutputs, largest_offsets_m, nominal_inputs};
use crate::variable::Causality::{Input, Output, Parameter};
use crate::variable::{Declarations, Domain, Enumeration, Group, Unit, Values};

/// Variables of the server.
#[derive(Clone, Copy)]
pub(super) struct ServerPorts<const N: usize> {
    pub(super) sample: ForceInputs,
    pub(super) nominal: Group<N>,
    pub(super) cable: Group<1>,
    pub(super) obtain: Group<1>,
    pub(super) stop: Group<1>,
    pub(super) rearm: Group<1>,
    pub(super) machine_ok: Group<1>,
    pub(super) accept_unstable: Group<1>,
    pub(super) reference: Group<N>,
    offset: Group<N>,
    velocity_offset: Group<N>,
    torque_offset: Group<N>,
    computed: Group<N>,
    limited: Group<N>,
    phase: Group<1>,
    cause: Group<1>,
    missed: Group<1>,
    on_time_of_100: Group<1>,
    session: Group<1>,
    pub(super) latched: Group<1>,
    tared: Group<1>,
    load: LoadOutputs,
}

impl<const N: usize> ServerPorts<N> {
    pub(super) fn declare<K: MachineKind<N>>(
        declared: &mut Declarations,
        robot: &RobotFile<K, N>,
        home_m: [f64; N],
    ) -> Self {
        let real = Domain::Real;
        let metre = real(Unit::Metre);
        let offsets = largest_offsets_m(robot).map(|most| ([-most, most], 0.0));
        let mut references = home_m.map(|home_m| ([0.0, 0.0], home_m));
        for ((range, _), axis) in references.iter_mut().zip(&robot.limits) {
            let travel = axis.machine_travel;
            *range = metres([travel.lower, travel.upper]);
        }
        let counts = [([0.0, f64::from(i32::MAX)], 0.0)];
        Self {
            sample: ForceInputs::declare(declared),
            nominal: nominal_inputs(declared, home_m),
            cable: declared.switch(
                "cable",
                Input,
                "The client's cable is in; a client begins when it is put in",
                true,
            ),
            obtain: declared.switch(
                "obtain",
                Input,
                "The client asks for Obtain once its sensor is tared, otherwise for Submit",
                true,
            ),
            stop: declared.switch("stop", Input, "The stop at the machine is pressed", false),
            rearm: declared.switch(
                "rearm",
                Input,
                "The re-arm at the machine is pressed; it counts after it was seen released in Fault",
                false,
            ),
            machine_ok: declared.switch(
                "machine_ok",
                Input,
                "The machine can be read; otherwise the server stops",
                true,
            ),
            accept_unstable: declared.switch(
                "accept_unstable",
                Parameter,
                "Obtain with a margin of stability below 2 at home, too",
                false,
            ),
            reference: declared.add(
                "reference",
                Output,
                metre,
                "Position reference for the drives: nominal plus offset, within the travel of the machine",
                references,
            ),
            offset: declared.add(
                "offset",
                Output,
                metre,
                "Position offset in force",
                offsets,
            ),
            velocity_offset: declared.add(
                "velocity_offset",
                Output,
                real(Unit::MetrePerSecond),
                "Velocity offset in force",
                [([-2e3, 2e3], 0.0); N],
            ),
            torque_offset: declared.add(
                "torque_offset",
                Output,
                real(Unit::One),
                "Torque offset in force, share of the rated torque",
                [([-1.0, 1.0], 0.0); N],
            ),
            computed: declared.add(
                "computed",
                Output,
                metre,
                "Offset as it would be in force, in Submit",
                offsets,
            ),
            limited: declared.add(
                "limited",
                Output,
                Domain::Boolean,
                "The offset is held back by its limits",
                [([0.0, 1.0], 0.0); N],
            ),
            phase: declared.add(
                "phase",
                Output,
                Domain::Enumeration(Enumeration::Phase),
                "Phase of the server",
                [(Enumeration::Phase.range(), 0.0)],
            ),
            cause: declared.add(
                "cause",
                Output,
                Domain::Enumeration(Enumeration::Cause),
                "Cause of the end of the last session",
                [(Enumeration::Cause.range(), 0.0)],
            ),
            missed: declared.add(
                "missed",
                Output,
                Domain::Integer,
                "Deadlines missed in this session",
                counts,
            ),
            on_time_of_100: declared.add(
                "on_time_of_100",
                Output,
                Domain::Integer,
                "Commands in time of the last 100 deadlines",
                [([0.0, 100.0], 0.0)],
            ),
            session: declared.add(
                "session",
                Output,
                Domain::Integer,
                "Number of the current or last session; 0 before the first",
                counts,
            ),
            latched: declared.switch(
                "latched",
                Output,
                "A stop is latched until the server is re-armed",
                false,
            ),
            tared: declared.switch("tared", Output, "The tare of the force sensor is done", false),
            load: LoadOutputs::declare(declared),
        }
    }

    pub(super) fn show_references(&self, references: &[Reference; N], values: &mut Values) {
        let positions = references.map(|axis| axis.position);
        values.put(self.reference, metres(positions));
    }

    pub(super) fn show_state(&self, state: &State<N>, values: &mut Values) {
        let offsets = state.axes.map(|axis| axis.offsets);
        values.put(
            self.offset,
            offsets_m(offsets.map(|offset| offset.position)),
        );
        let velocities = offsets.map(|offset| metres_per_s(offset.velocity));
        values.put(self.velocity_offset, velocities);
        values.put(
            self.torque_offset,
            offsets.map(|offset| share(offset.torque)),
        );
        let computed = state.axes.map(|axis| axis.shadow.position);
        values.put(self.computed, offsets_m(computed));
        let limited = state.axes.map(|axis| {
            let is_limited = axis.flags.contains(AxisFlags::POSITION_LIMITED);
            f64::from(u8::from(is_limited))
        });
        values.put(self.limited, limited);
        values.put(self.phase, [f64::from(state.phase.code())]);
        values.put(self.cause, [f64::from(state.cause.code())]);
        let most = i32::MAX as u32;
        values.put(self.missed, [f64::from(state.counters.missed.min(most))]);
        values.put(self.on_time_of_100, [f64::from(state.on_time_of_100)]);
        let session = u32::try_from(state.epoch.0).unwrap_or(most).min(most);
        values.put(self.session, [f64::from(session)]);
    }

    /// Shows what the client computes; `None` without a session.
    pub(super) fn show_client(&self, controller: Option<&Controller<N>>, values: &mut Values) {
        values.put_switch(self.tared, controller.is_some_and(Controller::is_tared));
        let load = controller.map_or_else(Wrench::zero, Controller::load);
        self.load.show(&load, values);
    }
}
