//! The C interface: T26. Null and misaligned pointers and memory without an object are refused;
//! fields arrive, in both directions.

use gantry_tau_capi::code::gt_code;
use gantry_tau_capi::error::gt_error;
use gantry_tau_capi::server::{
    GT_MAX_MOTORS, GT_PRESSED, GT_READING_DONE, GT_READING_FAILED, GT_RELEASED, GT_SAMPLE_CUT,
    GT_SAMPLE_DONE, GT_SAMPLE_NONE, GT_WRITE_ACCEPTED, GT_WRITE_REFUSED, GT_WRITE_UNKNOWN,
    gt_actual, gt_axis_config, gt_axis_state, gt_cause, gt_counters, gt_in_force, gt_limits,
    gt_offsets, gt_reference, gt_server_config, gt_start, gt_tick_input, gt_wrench_sample,
};
use gantry_tau_capi::verification::{self, Room};
use gantry_tau_core::control::axis::{Actual, InForce, Offsets, Reference};
use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::message::{AxisState, Counters, Phase, State};
use gantry_tau_core::control::session::config::{AxisConfig, Config};
use gantry_tau_core::control::session::{LastWrite, Output, Session};
use gantry_tau_core::units::{OffsetNm, TorquePermille, VelocityUmS, WrenchSample};
use gantry_tau_core::verification::control::{no_output, pending};

/// Code of an answer.
fn code<T>(answer: &Result<T, gt_error>) -> gt_code {
    answer
        .as_ref()
        .err()
        .map_or(gt_code::Ok, |error| error.code)
}

/// T26: an address is a pointer exactly if it is neither null nor misaligned.
pub fn pointer_is_judged(address: usize) {
    let expected = match address {
        0 => gt_code::NullPointer,
        _ if address % 8 != 0 => gt_code::Misaligned,
        _ => gt_code::Ok,
    };
    assert!(
        code(&verification::judge(address)) == expected,
        "T26: null and misaligned pointers are refused"
    );
}

/// T26: an object is made exactly where there is aligned memory for it, and then found there with
/// its value; after a refused value there is none, for any contents before.
pub fn object_is_made(room: &mut Room, place: Option<usize>, value: Option<u32>) {
    let made = room.create(place, value);
    let expected = match place.filter(|place| *place <= Room::BYTES) {
        None => gt_code::NullPointer,
        Some(place) if place % 8 != 0 => gt_code::Misaligned,
        Some(place) if Room::BYTES - place < Room::OBJECT => gt_code::MemoryTooSmall,
        Some(_) if value.is_none() => gt_code::Length,
        Some(_) => gt_code::Ok,
    };
    assert!(
        code(&made) == expected,
        "T26: an object has aligned memory, and enough of it"
    );
    assert!(
        made.is_err() || made.ok() == place,
        "T26: the handle is where the object is"
    );
    let found = room.find(place);
    match expected {
        gt_code::Ok => assert!(
            found.ok() == value,
            "T26: an object is found where it was made"
        ),
        gt_code::Length => assert!(
            code(&found) == gt_code::NoObject,
            "T26: a refused value leaves no object"
        ),
        _ => {}
    }
}

/// T26: an object is found exactly where its tag stands.
pub fn object_is_found(room: &mut Room, place: Option<usize>) {
    let bytes = room.0;
    let found = room.find(place);
    let expected = match place.filter(|place| *place <= Room::BYTES - Room::OBJECT) {
        None => gt_code::NullPointer,
        Some(place) if place % 8 != 0 => gt_code::Misaligned,
        Some(place) if bytes[place..place + 8] != Room::TAG => gt_code::NoObject,
        Some(_) => gt_code::Ok,
    };
    assert!(
        code(&found) == expected,
        "T26: an object is found by its tag alone"
    );
}

/// T26: the bytes at a pointer are borrowed, and never more than an object can have; zero bytes
/// need no pointer. The byte `at` speaks for every one.
pub fn bytes_are_borrowed(room: &mut Room, place: Option<usize>, length: usize, at: usize) {
    let bytes = room.0;
    let place = place.filter(|place| *place <= Room::BYTES);
    let expected = match place {
        _ if length == 0 => gt_code::Ok,
        None => gt_code::NullPointer,
        Some(_) if isize::try_from(length).is_err() => gt_code::Length,
        Some(_) => gt_code::Ok,
    };
    let borrowed = room.borrow(place, length);
    assert!(
        code(&borrowed) == expected,
        "T26: bytes are borrowed from a pointer, null only for zero bytes"
    );
    let Ok(borrowed) = borrowed else { return };
    let place = place.unwrap_or(Room::BYTES);
    let same = borrowed.len() == length.min(Room::BYTES - place)
        && (at >= borrowed.len() || borrowed[at] == bytes[place + at]);
    assert!(same, "T26: the bytes at the pointer are borrowed");
}

/// True for a value of a switch.
fn is_switch(value: u8) -> bool {
    [GT_RELEASED, GT_PRESSED].contains(&value)
}

/// T26: the input of a tick is refused exactly if a switch or a code is invalid, and otherwise
/// arrives field by field; `axis` speaks for every one.
pub fn input_arrives<const N: usize>(input: &gt_tick_input, axis: usize) {
    let known = [GT_READING_DONE, GT_READING_FAILED].contains(&input.reading)
        && input.sensor.status <= GT_SAMPLE_CUT
        && is_switch(input.stop)
        && is_switch(input.rearm);
    let answer = verification::to_core::<N>(input);
    assert!(
        answer.is_ok() == known,
        "T26: an input is refused for an invalid value, and for nothing else"
    );
    let Ok(tick) = answer else { return };
    assert!(
        tick.elapsed_cycles == input.elapsed_cycles,
        "T26: the cycle arrives"
    );
    let pressed = (
        input.stop == GT_PRESSED,
        input.quit != 0,
        input.rearm == GT_PRESSED,
    );
    assert!(
        (tick.stop, tick.quit, tick.rearm) == pressed,
        "T26: stop, quit and re-arm arrive"
    );
    assert!(
        same_sample(tick.sensor.as_ref(), &input.sensor),
        "T26: the sample of the force sensor arrives"
    );
    assert!(
        tick.reading.is_some() == (input.reading == GT_READING_DONE),
        "T26: a reading arrives if there is one"
    );
    if let Some(reading) = &tick.reading {
        assert!(
            reading.nominal[axis].0 == input.nominal_nm[axis],
            "T26: a nominal reference arrives"
        );
        assert!(
            same_actual(&reading.actual[axis], &input.actual[axis]),
            "T26: measurements arrive"
        );
    }
}

/// T26: what C says of the references of a tick is judged: any code that is none changes nothing, and
/// of references that were withheld none counts as taken; else it arrives, field by field. `axis`
/// speaks for every one; without values in force there is nothing at the pointer.
pub fn write_is_judged<const N: usize>(
    session: &Session<N>,
    withheld: bool,
    (fate, in_force): (u8, Option<[gt_in_force; N]>),
    axis: usize,
) {
    let mut output = no_output::<N>();
    output.withheld = withheld;
    let (mut told, mut is_told) = (LastWrite::Accepted, true);
    let write = pending(session, &mut output, &mut told, &mut is_told);
    let answer = verification::say(write, fate, in_force);
    let expected = match (fate, in_force) {
        (GT_WRITE_ACCEPTED, _) if withheld => gt_code::Withheld,
        (GT_WRITE_REFUSED, None) => gt_code::NullPointer,
        (GT_WRITE_ACCEPTED | GT_WRITE_REFUSED | GT_WRITE_UNKNOWN, _) => gt_code::Ok,
        _ => gt_code::Write,
    };
    assert!(code(&answer) == expected, "T26: the fate is judged");
    let is_none = [gt_code::Write, gt_code::NullPointer].contains(&expected);
    assert!(
        is_told != is_none,
        "T26: a fate that is none changes nothing"
    );
    match (told, in_force) {
        (LastWrite::Accepted, _) => assert!(
            fate == GT_WRITE_ACCEPTED && !withheld,
            "T26: accepted is what C said to be, and was written"
        ),
        (LastWrite::Refused { in_force: told }, Some(given)) => assert!(
            fate == GT_WRITE_REFUSED && same_in_force(&told[axis], &given[axis]),
            "T26: values in force arrive"
        ),
        (LastWrite::Unknown, _) => assert!(
            fate == GT_WRITE_UNKNOWN || expected == gt_code::Withheld || is_none,
            "T26: unknown is what C said to be, or cannot know"
        ),
        _ => panic!("T26: values in force come from C"),
    }
}

/// T26: the output of a tick arrives: the reference of every motor in use, and the State; `motor`
/// speaks for every one, in use or not.
pub fn output_arrives<const N: usize>(
    references: Option<&[Reference; GT_MAX_MOTORS]>,
    output: &Output<N>,
    motors: usize,
    motor: usize,
) {
    let c = verification::to_c(references, output, motors);
    assert!(
        (c.write != 0) == references.is_some(),
        "T26: references are written where there are some"
    );
    let used =
        |references: &[Reference; GT_MAX_MOTORS]| (motor < motors).then_some(references[motor]);
    let expected = references
        .and_then(used)
        .map_or(gt_reference::default(), |reference| gt_reference {
            position_nm: reference.position.0,
            velocity_offset_um_s: reference.velocity_offset.0,
            torque_offset_permille: reference.torque_offset.0,
        });
    assert!(
        c.motors[motor] == expected,
        "T26: a motor receives its reference, and no other one does"
    );
    assert!(
        usize::try_from(c.motor_count) == Ok(motors),
        "T26: the number of motors arrives"
    );
    let owner = (c.has_owner != 0).then_some(c.owner);
    let expected = output.owner.map(|owner| owner.0);
    assert!(
        owner == expected && c.owner == expected.unwrap_or(0),
        "T26: the owner arrives, and none is zero"
    );
    assert!(
        (c.welcomed != 0) == output.welcome.is_some(),
        "T26: a grant arrives"
    );
    assert!(
        usize::try_from(c.refused) == Ok(output.refusals.len()),
        "T26: refusals are counted"
    );
    assert!(
        number_of(c.ended) == output.ended.map_or(0, |cause| cause.code()),
        "T26: an end arrives"
    );
    assert!((c.latched != 0) == output.latched, "T26: the latch arrives");
    assert!(
        c.state == verification::state_to_c(&output.state),
        "T26: the State is that of the output"
    );
}

/// T26: a State arrives field by field; `axis` speaks for every one, in use or not.
pub fn state_arrives<const N: usize>(state: &State<N>, axis: usize) {
    let told = verification::state_to_c(state);
    let numbers = told.tick == state.tick.0
        && told.epoch == state.epoch.0
        && told.accepted == state.accepted.0;
    assert!(numbers, "T26: tick, epoch and sequence arrive");
    let rest = told.ramp_ticks_left == state.ramp_ticks_left
        && told.arrival_us == state.arrival_us
        && told.on_time_of_100 == state.on_time_of_100;
    assert!(rest, "T26: ramp, arrival and on-time share arrive");
    #[allow(
        clippy::as_conversions,
        reason = "the number of a variant without fields"
    )]
    let phase = told.phase as i32;
    assert!(
        phase == i32::from(state.phase.code()),
        "T26: the phase arrives"
    );
    assert!(
        number_of(told.cause) == state.cause.code(),
        "T26: the cause arrives"
    );
    assert!(
        same_counters(&state.counters, &told.counters),
        "T26: counters arrive"
    );
    assert!(
        same_sample(state.sensor.as_ref(), &told.sensor),
        "T26: the sample of the force sensor arrives"
    );
    assert!(
        usize::try_from(told.axis_count) == Ok(N),
        "T26: the number of axes arrives"
    );
    let is = &told.axes[axis];
    let unused = AxisState::default();
    let was = state.axes.get(axis).unwrap_or(&unused);
    assert!(
        same_axis(was, is),
        "T26: an axis arrives, and an unused one is zero"
    );
}

/// True if a sample of C says what one of core does; without one the rest of C's is anything.
fn same_sample(sample: Option<&WrenchSample>, c: &gt_wrench_sample) -> bool {
    let Some(sample) = sample else {
        return c.status == GT_SAMPLE_NONE;
    };
    let status = if sample.is_cut {
        GT_SAMPLE_CUT
    } else {
        GT_SAMPLE_DONE
    };
    (c.status, c.age) == (status, sample.age)
        && sample.force.map(|force| force.0) == c.force_mn
        && sample.moment.map(|moment| moment.0) == c.moment_unm
}

/// Number of a cause of C, which is that of the wire.
fn number_of(cause: gt_cause) -> u8 {
    #[allow(
        clippy::as_conversions,
        reason = "the number of a variant without fields"
    )]
    let number = cause as i32;
    u8::try_from(number).unwrap_or(u8::MAX)
}

/// True if core accepts these limits.
fn is_valid(limits: &gt_limits) -> bool {
    Limits::<OffsetNm>::new(values(limits)).is_ok()
}

/// T26: the limits and the travel of an axis arrive field by field, or are refused with core's
/// limits.
pub fn axis_arrives(axis: &gt_axis_config) {
    let answer = verification::configure_axis(axis);
    let valid = is_valid(&axis.position) && is_valid(&axis.velocity) && is_valid(&axis.torque);
    assert!(
        answer.is_ok() == valid,
        "T26: an axis is refused for its limits, and for nothing else"
    );
    assert!(
        answer.is_ok_and(|core| same_limits(&core, axis)) || !valid,
        "T26: limits and travel of an axis arrive"
    );
}

/// T26: a configuration that is accepted has every field, and its motors their axes; tested. `axis`
/// and `motor` speak for every one.
pub fn configuration_arrives<const N: usize>(config: &gt_server_config, axis: usize, motor: usize) {
    let motors = usize::try_from(config.motors).unwrap_or(usize::MAX);
    let Ok((checked, map)) = verification::configure::<N>(config) else {
        return;
    };
    let parameters = checked.parameters();
    let numbers = parameters.cycle_us == config.cycle_us
        && parameters.handshake_ticks == config.handshake_ticks
        && parameters.echo_window == config.echo_window
        && parameters.kinematics_checksum == config.kinematics_checksum
        && parameters.capabilities.0 == config.capabilities;
    assert!(numbers, "T26: numbers of a configuration arrive");
    let budget = parameters
        .budget
        .map_or((0, None), |budget| (budget.window, Some(budget.allowed)));
    let expected = (
        config.budget_window,
        (config.budget_window > 0).then_some(config.budget_allowed),
    );
    assert!(budget == expected, "T26: a budget of misses arrives");
    assert!(
        same_limits(&parameters.axes[axis], &config.axis[axis]),
        "T26: every axis has its own limits and travel"
    );
    assert!(
        0 < motors && motors <= GT_MAX_MOTORS,
        "T26: there are motors, and room for them"
    );
    let expected = if motor < motors {
        usize::from(config.axis_of_motor[motor])
    } else {
        0
    };
    assert!(
        map.axis_of_motor()[motor] == expected,
        "T26: a motor has its axis"
    );
}

/// T26: a server starts with the values in force that were given, and in Fault with a latched stop;
/// `axis` speaks for every one.
pub fn start_arrives<const N: usize>(config: Config<N>, start: &gt_start, axis: usize) {
    let all_within = (0..N).all(|axis| {
        let limits = &config.parameters().axes[axis].limits;
        let gt_offsets {
            position_nm,
            velocity_um_s,
            torque_permille,
        } = start.in_force[axis].offsets;
        limits.position.admits(OffsetNm(position_nm))
            && limits.velocity.admits(VelocityUmS(velocity_um_s))
            && limits.torque.admits(TorquePermille(torque_permille))
    });
    let session = verification::start(config, start);
    assert!(
        session.is_ok() == all_within,
        "T26: a start is refused for offsets beyond their limits, and for nothing else"
    );
    let Ok(session) = session else { return };
    assert!(
        same_in_force(&session.demanded()[axis], &start.in_force[axis]),
        "T26: a start has the values in force"
    );
    assert!(
        (session.phase() == Phase::Fault) == (start.stop_latched != 0),
        "T26: a latched stop arrives"
    );
}

fn same_offsets(core: &Offsets, c: &gt_offsets) -> bool {
    (core.position.0, core.velocity.0, core.torque.0)
        == (c.position_nm, c.velocity_um_s, c.torque_permille)
}

fn same_actual(core: &Actual, c: &gt_actual) -> bool {
    (core.position.0, core.velocity.0, core.torque.0)
        == (c.position_nm, c.velocity_um_s, c.torque_permille)
}

fn same_in_force(core: &InForce, c: &gt_in_force) -> bool {
    core.nominal.0 == c.nominal_nm && same_offsets(&core.offsets, &c.offsets)
}

fn same_counters(core: &Counters, c: &gt_counters) -> bool {
    (core.received, core.missed, core.late) == (c.received, c.missed, c.late)
        && (core.duplicate, core.stale, core.malformed) == (c.duplicate, c.stale, c.malformed)
        && (core.out_of_range, core.limited, core.clamped) == (c.out_of_range, c.limited, c.clamped)
        && (core.non_owner, core.longest_miss_run) == (c.non_owner, c.longest_miss_run)
}

fn same_axis(core: &AxisState, c: &gt_axis_state) -> bool {
    core.nominal.0 == c.nominal_nm
        && same_offsets(&core.offsets, &c.offsets)
        && same_offsets(&core.shadow, &c.shadow)
        && same_actual(&core.actual, &c.actual)
        && core.flags.bits() == c.flags
}

fn same_channel<U>(core: &Limits<U>, c: &gt_limits) -> bool {
    core.values() == values(c)
}

const fn values(limits: &gt_limits) -> LimitValues {
    LimitValues {
        max: limits.max,
        step: limits.step,
        accel: limits.accel,
        ramp: limits.ramp,
    }
}

fn same_limits(core: &AxisConfig, c: &gt_axis_config) -> bool {
    same_channel(&core.limits.position, &c.position)
        && same_channel(&core.limits.velocity, &c.velocity)
        && same_channel(&core.limits.torque, &c.torque)
        && (core.nominal_travel.lower.0, core.nominal_travel.upper.0)
            == (c.nominal_lower_nm, c.nominal_upper_nm)
        && (core.machine_travel.lower.0, core.machine_travel.upper.0)
            == (c.machine_lower_nm, c.machine_upper_nm)
        && core.nominal_step_nm == c.nominal_step_nm
        && core.nominal_accel.map_or(0, |limit| limit.nm.get()) == c.nominal_accel_nm
        && core
            .nominal_accel
            .is_none_or(|limit| limit.is_fault == (c.nominal_accel_is_fault != 0))
        && core.agitation.map_or(0, |budget| budget.nm_per_tick.get()) == c.agitation_nm_per_tick
}
