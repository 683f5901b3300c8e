/*
 * HAL component `gantry_tau`: the server of gantry-tau in LinuxCNC's servo thread, between the motion controller and the drives.
 *
 *     addf gantry-tau.read servo      after the drives are read, before motion-controller
 *     addf gantry-tau.write servo     after motion-controller, before the drives are written
 *
 * README.md has wiring, pins and parameters. The thread allocates nothing, opens nothing and waits for nothing; with `lockstep=1`, for tests
 * only, it waits for the client's answers.
 */
#include "rtapi.h"
#include "rtapi_app.h"
#include "hal.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "gantry_tau.h"
#include "machine.h"

#include "epochs.h"
#include "lateness.h"
#include "pins.h"
#include "sockets.h"
#include "units.h"

MODULE_AUTHOR("gantry-tau");
MODULE_DESCRIPTION("External offsets for the joints of a Gantry-Tau robot, from a client on the network");
/* Sources under MIT OR Apache-2.0; what is linked with LinuxCNC is GPL as a whole. */
MODULE_LICENSE("GPL");

static char *epoch_file;
RTAPI_MP_STRING(epoch_file, "file of the epoch counter, in storage that survives a restart; required");
static char *address = "127.0.0.1";
RTAPI_MP_STRING(address, "IPv4 address to listen on");
static int port = 7000;
RTAPI_MP_INT(port, "port for the client");
static int sensor_port = 7001;
RTAPI_MP_INT(sensor_port, "port for readers of the force sensor");
static int udp = 0;
RTAPI_MP_INT(udp, "1: the client uses UDP datagrams, not a TCP stream");
static int lockstep = 0;
RTAPI_MP_INT(lockstep, "1: the thread waits for the client; for tests only");

enum { ABSENT = -1 };
/* Lock-step: silence that counts as a miss; as a tick of the handshake; longest wait between two looks at the pins. */
static const int64_t SILENCE_NS = 1000000000, HANDSHAKE_SILENCE_NS = 10000000, POLL_NS = 500000;

static int component = ABSENT;
static struct pins *pins;
static gt_server_config config;
static gt_start begin;
static GT_MEMORY(GT_SERVER_SIZE_6) memory;
/* NULL until the first cycle: the nominal positions are known only then. */
static gt_server *server;
static gt_tick_input input;
static gt_tick_output output;
static gt_frame frame;
static struct lateness lateness;
/* Nominal position of each joint in force, as LinuxCNC gave it. */
static double nominal[GANTRY_TAU_AXES];
static int64_t offset_nm[GANTRY_TAU_AXES];
static uint32_t skipped;
static int64_t last_tick_ns;
static int has_failed;

/* Adds an offset to a pin's value; without an offset the value stays the same, bit for bit. */
static double plus(double value, int64_t nm, int joint)
{
    return nm == 0 ? value : value + gt_joint_of_nm(joint, nm);
}

static int to_nm(double value, int joint, int64_t *nm)
{
    return gt_nm_of_joint(joint, value, nm, NULL) == GT_CODE_OK;
}

static void fail(const char *what, gt_code code)
{
    if (!has_failed) {
        rtapi_print_msg(RTAPI_MSG_ERR, "gantry_tau: %s: %s; offsets stay as they are\n", what, gt_code_name(code));
    }
    has_failed = 1;
    *pins->phase = GT_PHASE_FAULT;
}

/* Reads nominal positions and measurements. Returns 0 if one of them is not a number in range. */
static int read_machine(void)
{
    int is_read = 1;
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        const struct joint_pins *from = &pins->joint[joint];
        gt_actual *actual = &input.actual[joint];
        const double torque = *from->torque;
        int64_t speed_nm_s = 0;
        is_read &= to_nm(*from->nominal, joint, &input.nominal_nm[joint]);
        is_read &= to_nm(*from->position, joint, &actual->position_nm);
        is_read &= to_nm(*from->velocity, joint, &speed_nm_s) && llabs(speed_nm_s / 1000) <= INT32_MAX;
        is_read &= fabs(torque) <= INT16_MAX; /* not of NaN */
        if (is_read) {
            actual->velocity_um_s = (int32_t)(speed_nm_s / 1000);
            actual->torque_permille = (int16_t)torque;
        }
    }
    return is_read;
}

/* Starts the server where the machine is. Stopped: a stop before a restart must outlive it, and a re-arm is a decision at the machine. */
static int start(long period)
{
    gt_code code;
    if (has_failed || !read_machine()) {
        return 0;
    }
    config.cycle_us = (uint32_t)(period / 1000);
    begin.stop_latched = 1;
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        begin.in_force[joint].nominal_nm = input.nominal_nm[joint];
        nominal[joint] = *pins->joint[joint].nominal;
    }
    code = gt_server_init(&memory, sizeof memory, &config, &begin, &server, NULL);
    if (code != GT_CODE_OK) {
        server = NULL;
        fail("cannot start", code);
    }
    return code == GT_CODE_OK;
}

/* Writes the reference of a joint: its nominal position, which is `nm` rounded, and its offset, within the machine's travel. */
static void write_reference(int joint, double value, int64_t nm)
{
    const gt_axis_config *limits = &gantry_tau_limits[joint];
    const int64_t wanted = nm + offset_nm[joint];
    hal_float_t *reference = pins->joint[joint].reference;
    if (wanted > limits->machine_upper_nm) {
        *reference = gt_joint_of_nm(joint, limits->machine_upper_nm);
    } else if (wanted < limits->machine_lower_nm) {
        *reference = gt_joint_of_nm(joint, limits->machine_lower_nm);
    } else {
        *reference = plus(value, offset_nm[joint], joint);
    }
}

/* Holds the offsets over a cycle without a tick: the references follow the path. */
static void hold(void)
{
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        const struct joint_pins *to = &pins->joint[joint];
        int64_t nm;
        if (to_nm(*to->nominal, joint, &nm)) {
            write_reference(joint, *to->nominal, nm);
        }
    }
    for (int motor = 0; motor < GANTRY_TAU_MOTORS; motor++) {
        *pins->motor[motor].reference = *pins->joint[gantry_tau_axis_of_motor[motor]].reference;
    }
}

/* Writes the references of a tick. */
static void write_machine(void)
{
    for (int motor = 0; motor < GANTRY_TAU_MOTORS; motor++) {
        const int joint = gantry_tau_axis_of_motor[motor];
        const struct joint_pins *to = &pins->joint[joint];
        const gt_axis_state *state = &output.state.axes[joint];
        const gt_reference *reference = &output.motors[motor];
        /* Otherwise core holds the nominal position that is in force. */
        if (input.reading == GT_READING_DONE && state->nominal_nm == input.nominal_nm[joint]) {
            nominal[joint] = *to->nominal;
        }
        offset_nm[joint] = state->offsets.position_nm;
        write_reference(joint, nominal[joint], state->nominal_nm);
        *to->offset = gt_joint_of_nm(joint, offset_nm[joint]);
        *to->shadow = gt_joint_of_nm(joint, state->shadow.position_nm);
        *to->velocity_offset = gt_joint_of_nm(joint, (int64_t)reference->velocity_offset_um_s * 1000);
        *to->torque_offset = reference->torque_offset_permille;
        *pins->motor[motor].reference = *to->reference;
        *pins->motor[motor].velocity_offset = *to->velocity_offset;
        *pins->motor[motor].torque_offset = *to->torque_offset;
    }
}

static int is_stopped(void)
{
    return !*pins->enable || *pins->stop;
}

static void tick(uint32_t elapsed)
{
    gt_code code;
    uint64_t connection;
    double wrench[6];

    sockets_receive(server);
    input.elapsed_cycles = elapsed;
    input.reading = read_machine() ? GT_READING_DONE : GT_READING_FAILED;
    input.stop = is_stopped() ? GT_PRESSED : GT_RELEASED;
    input.rearm = *pins->rearm ? GT_PRESSED : GT_RELEASED;
    input.last_write = GT_WRITE_ACCEPTED;
    code = gt_server_tick(server, &input, &output, NULL);
    if (code != GT_CODE_OK) {
        fail("cannot tick", code);
        hold();
        return;
    }
    if (output.write) {
        write_machine();
    }
    for (int i = 0; i < 6; i++) {
        wrench[i] = *pins->wrench[i];
    }
    /* Before the State of the same tick, so that a client has the sample when it answers. */
    sockets_publish(output.state.tick, wrench);
    while (gt_server_poll_transmit(server, &frame) == GT_CODE_OK) {
        sockets_send(&frame);
    }
    while (gt_server_poll_close(server, &connection) == GT_CODE_OK) {
        sockets_close(connection);
    }
    *pins->phase = output.state.phase;
    *pins->cause = output.state.cause;
    *pins->missed = output.state.counters.missed;
    *pins->tick = (hal_u32_t)output.state.tick;
}

/* Lock-step: waits until the owner has answered the last State or has been silent for long, or somebody stops; without a session, for a cycle. */
static void wait_for_answer(long period)
{
    const gt_phase phase = output.state.phase;
    const int is_live = phase == GT_PHASE_SUBMIT || phase == GT_PHASE_OBTAIN;
    const int64_t until = last_tick_ns + (is_live ? SILENCE_NS : phase == GT_PHASE_HANDSHAKE ? HANDSHAKE_SILENCE_NS : period);
    uint8_t has_answered = 0;
    int64_t left;

    while ((left = until - rtapi_get_time()) > 0) {
        const struct timespec rest = {.tv_nsec = (long)(left < POLL_NS ? left : POLL_NS)};
        if (!is_live && phase != GT_PHASE_HANDSHAKE) {
            nanosleep(&rest, NULL);
            continue;
        }
        sockets_receive(server);
        if (gt_server_owner_has_answered(server, &has_answered) != GT_CODE_OK || has_answered || !output.has_owner || is_stopped()) {
            return;
        }
        sockets_wait(output.owner, rest.tv_nsec);
    }
}

/* Function `gantry-tau.read`: LinuxCNC sees the drives without the offsets. */
static void read_function(void *unused, long period)
{
    (void)unused;
    (void)period;
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        *pins->joint[joint].feedback = plus(*pins->joint[joint].position, -offset_nm[joint], joint);
    }
}

static void note_lateness(int64_t late_ns)
{
    *pins->lateness = late_ns < INT32_MAX ? (hal_s32_t)late_ns : INT32_MAX;
    if (*pins->lateness > *pins->lateness_max) {
        *pins->lateness_max = *pins->lateness;
    }
}

/* Function `gantry-tau.write`: one cycle of the server. */
static void write_function(void *unused, long period)
{
    int64_t late_ns;
    (void)unused;
    if (has_failed || (server == NULL && !start(period))) {
        hold();
        return;
    }
    if (lockstep) {
        wait_for_answer(period);
        last_tick_ns = rtapi_get_time();
        tick(1);
        return;
    }
    late_ns = lateness_of_call(&lateness, rtapi_get_time(), period);
    note_lateness(late_ns);
    if (late_ns > period) {
        /* A burst: several ticks at once would be several steps at the drive's next cycle. */
        skipped += skipped < UINT32_MAX - 1;
        *pins->held += 1;
        hold();
        return;
    }
    tick(1 + skipped);
    skipped = 0;
}

/* Checks that the header of the machine belongs to this module: the client compares the checksum with that of its own robot file. */
static gt_code machine_checksum(uint32_t *checksum, gt_error *error)
{
#ifdef GANTRY_TAU_MODEL_L2
    static GT_MEMORY(GT_L2_SIZE) place;
    gt_l2 *machine;
    const gt_code code = gt_l2_init(&place, sizeof place, &gantry_tau_geometry, &machine, error);
    return code == GT_CODE_OK ? gt_l2_checksum(machine, checksum) : code;
#else
    static GT_MEMORY(GT_F1_SIZE) place;
    gt_f1 *machine;
    const gt_code code = gt_f1_init(&place, sizeof place, &gantry_tau_geometry, &machine, error);
    return code == GT_CODE_OK ? gt_f1_checksum(machine, checksum) : code;
#endif
}

static int configure(char *text, size_t size)
{
    gt_error error;
    uint32_t checksum = 0;
    gt_code code = machine_checksum(&checksum, &error);
    if (code == GT_CODE_OK && checksum != GANTRY_TAU_KINEMATICS_CHECKSUM) {
        snprintf(text, size, "machine.h is damaged: its kinematics have the checksum %08x, not %08x", (unsigned)checksum,
                 (unsigned)GANTRY_TAU_KINEMATICS_CHECKSUM);
        return -1;
    }
    if (code == GT_CODE_OK) {
        code = gt_server_config_thesis(&config, GANTRY_TAU_AXES);
    }
    config.motors = GANTRY_TAU_MOTORS;
    memcpy(config.axis_of_motor, gantry_tau_axis_of_motor, sizeof gantry_tau_axis_of_motor);
    memcpy(config.axis, gantry_tau_limits, sizeof gantry_tau_limits);
    config.kinematics_checksum = checksum;
    config.capabilities = lockstep ? 1 : 0;
    if (code == GT_CODE_OK) {
        code = gt_server_config_check(&config, NULL, &error);
    }
    if (code != GT_CODE_OK) {
        snprintf(text, size, "machine.h is refused: %s, index %d, %g", gt_code_name(code), (int)error.index, error.value);
    }
    return code == GT_CODE_OK ? 0 : -1;
}

/* Everything that may fail, apart from HAL. Returns 0, or -1 with one sentence. */
static int prepare(char *error, size_t size)
{
    if (gt_abi_version() != GT_ABI_VERSION) {
        snprintf(error, size, "gantry_tau.h and libgantry_tau.a have different versions");
        return -1;
    }
    if (epoch_file == NULL || *epoch_file == 0) {
        snprintf(error, size, "epoch_file is missing: give a file in storage that survives a restart");
        return -1;
    }
    if (configure(error, size) != 0 || sockets_open(address, port, sensor_port, udp, error, size) != 0) {
        return -1;
    }
    /* Last: epochs are not used up by a component that does not load. */
    if (epochs_reserve(epoch_file, &begin.first_epoch, &begin.last_epoch, error, size) != 0) {
        sockets_shut();
        return -1;
    }
    return 0;
}

void rtapi_app_exit(void)
{
    if (component >= 0) {
        hal_exit(component);
        component = ABSENT;
    }
    sockets_shut();
}

int rtapi_app_main(void)
{
    static char error[512];
    int code;

    if (prepare(error, sizeof error) != 0) {
        rtapi_print_msg(RTAPI_MSG_ERR, "gantry_tau: %s\n", error);
        return -EINVAL;
    }
    component = hal_init("gantry_tau");
    code = component < 0 ? component : 0;
    if (code == 0) {
        pins = pins_new(component);
        code = pins == NULL ? -ENOMEM : hal_export_funct("gantry-tau.read", read_function, NULL, 1, 0, component);
    }
    if (code == 0) {
        *pins->phase = GT_PHASE_FAULT;
        code = hal_export_funct("gantry-tau.write", write_function, NULL, 1, 0, component);
    }
    if (code != 0) {
        rtapi_print_msg(RTAPI_MSG_ERR, "gantry_tau: HAL refuses the component (%d)\n", code);
        rtapi_app_exit();
        return code;
    }
    hal_ready(component);
    return 0;
}
