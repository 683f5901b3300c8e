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

#include <arpa/inet.h>
#include <errno.h>
#include <math.h>
#include <netinet/in.h>
#include <stdio.h>
#include <time.h>

#include "gantry_tau.h"
#include "configuration.h"
#include "drives.h"
#include "epochs.h"
#include "keys.h"
#include "lateness.h"
#include "pins.h"
#include "sockets.h"

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
static int udp = 0;
RTAPI_MP_INT(udp, "1: the client uses UDP datagrams, not a TCP stream");
static char *key = NULL;
RTAPI_MP_STRING(key, "key file of the client (gantry-tau key new): no other peer is heard");
static int insecure = 0;
RTAPI_MP_INT(insecure, "1: without a key, let everybody who reaches an address other than 127.0.0.1 move the machine");
static int lockstep = 0;
RTAPI_MP_INT(lockstep, "1: the thread waits for the client; for tests only");

enum { ABSENT = -1 };
/* Lateness that is a stop, periods; calls with a disagreement after which it is said: LinuxCNC's joints are at 0 until it has started. */
enum { MAX_LATE_PERIODS = 250, SAY_AFTER = 5000 };
/* Lock-step: silence that counts as a miss, and as a tick of the handshake; longest wait between two looks at the pins. */
static const int64_t SILENCE_NS = 1000000000, HANDSHAKE_SILENCE_NS = 10000000, POLL_NS = 500000;

static int component = ABSENT;
static struct pins *pins;
static gt_server_config config;
static gt_start begin;
static gt_keys keys;
static int has_keys;
static GT_MEMORY(GT_SERVER_SIZE_6) memory;
/* NULL until the first cycle: the nominal positions are known only then. */
static gt_server *server;
static gt_tick_input input;
static gt_tick_output output;
static gt_held held;
static gt_frame frame;
static struct lateness lateness;
static uint32_t skipped;
static int64_t last_tick_ns;
static int has_failed;
/* What must be connected is; the force sensor is. */
static int is_wired;
static int has_wrench;
/* `gantry-tau.read` has run since the last `gantry-tau.write`. */
static int has_fed_back;
/* `permit` of the last call. */
static int is_permitted;

/* Function `gantry-tau.read`: LinuxCNC sees the drives without the offsets. */
static void read_function(void *unused, long period)
{
    drives_feedback(pins);
    has_fed_back = 1;
}

static void fail(const char *what, gt_code code)
{
    if (!has_failed) {
        rtapi_print_msg(RTAPI_MSG_ERR, "gantry_tau: %s: %s; references stay as they are\n", what, gt_code_name(code));
    }
    has_failed = 1;
    *pins->phase = GT_PHASE_FAULT;
    *pins->permit = 0;
}

/* Says what is not connected. LinuxCNC has loaded all files of HAL when its threads start. */
static void check_wiring(void)
{
    const char *name = pins_unconnected(pins);
    is_wired = name == NULL;
    has_wrench = pins_have_wrench(pins);
    if (!is_wired) {
        rtapi_print_msg(RTAPI_MSG_ERR, "gantry_tau: %s is not connected: the machine is not permitted to be switched on\n", name);
    }
    if (!has_wrench) {
        rtapi_print_msg(RTAPI_MSG_ERR, "gantry_tau: gantry-tau.wrench-0 to -5 are not all connected: no force is published\n");
    }
}

/* Says what is wrong with an input, once for each time that it goes wrong. Returns whether it is right. */
static int right(int is_right, int *was_right, const char *wrong)
{
    if (!is_right && *was_right) {
        rtapi_print_msg(RTAPI_MSG_ERR, "gantry_tau: %s\n", wrong);
    }
    *was_right = is_right;
    return is_right;
}

static int read_drives(void)
{
    static int was_read = 1;
    return right(drives_read(pins), &was_read, "a measurement of a drive, or a command, is not a number in range: stopped");
}

/* Starts the server where the drives are. Stopped: a stop before a restart must outlive it, and a re-arm is a decision at the machine. */
static int start(long period)
{
    gt_code code;
    if (!read_drives()) {
        return 0;
    }
    drives_accept(&input);
    config.cycle_us = (uint32_t)(period / 1000);
    begin.stop_latched = 1;
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        begin.in_force[joint].nominal_nm = input.nominal_nm[joint];
    }
    drives_start();
    check_wiring();
    code = has_keys ? gt_server_init_keyed(&memory, sizeof memory, &config, &begin, &keys, &server, NULL)
                    : gt_server_init(&memory, sizeof memory, &config, &begin, &server, NULL);
    if (code != GT_CODE_OK) {
        server = NULL;
        fail("cannot start", code);
    }
    return code == GT_CODE_OK;
}

static int is_stopped(void)
{
    return !*pins->enable || *pins->stop;
}

/* Says why the machine is not permitted to be switched on, once that has lasted. */
static void say_disagreement(void)
{
    static int calls;
    static char text[256]; /* not on the stack */
    if (is_permitted || !is_wired) {
        calls = 0;
    } else if (calls < SAY_AFTER && ++calls == SAY_AFTER) {
        if (!has_fed_back) {
            snprintf(text, sizeof text, "gantry-tau.read does not run before every gantry-tau.write: addf gantry-tau.read before motion-controller");
        } else if (drives_agree(pins, text, sizeof text)) {
            calls = 0; /* a drive that is not read has its own line */
            return;
        }
        rtapi_print_msg(RTAPI_MSG_ERR, "gantry_tau: not permitted to be switched on: %s\n", text);
    }
}

/*
 * Evaluates every input that may stop the machine, or keep it from being switched on: in every call, whether it ticks or not. A machine that is
 * on without being permitted counts as one that cannot be read: the references stay.
 */
static void look(void)
{
    const int is_read = read_drives();
    is_permitted = is_wired && is_read && has_fed_back && ((*pins->enable && is_permitted) || drives_agree(pins, NULL, 0));
    say_disagreement();
    has_fed_back = 0;
    *pins->permit = is_permitted;
    input.reading = is_read && (is_permitted || !*pins->enable) ? GT_READING_DONE : GT_READING_FAILED;
    if (input.reading == GT_READING_DONE) {
        drives_accept(&input);
    }
    input.stop = is_stopped() ? GT_PRESSED : GT_RELEASED;
    input.rearm = *pins->rearm ? GT_PRESSED : GT_RELEASED;
}

/* True if the server does not know yet that it is stopped. */
static int is_stop_new(void)
{
    return (input.stop == GT_PRESSED || input.reading == GT_READING_FAILED) && output.state.phase != GT_PHASE_FAULT;
}

/* Reads the force sensor. A sample that is not valid is none: a client ends if none comes. */
static void measure(void)
{
    static int was_number = 1;
    gt_wrench wrench;
    int is_number = 1;
    for (int i = 0; i < 3; i++) {
        wrench.force_n[i] = *pins->wrench[i];
        wrench.moment_nm[i] = *pins->wrench[3 + i];
        is_number &= isfinite(wrench.force_n[i]) && isfinite(wrench.moment_nm[i]);
    }
    is_number = right(is_number || !*pins->wrench_valid, &was_number, "gantry-tau.wrench-N is not a number: no force is published");
    if (!has_wrench || !*pins->wrench_valid || !is_number || gt_wrench_sample_of(&wrench, 0, &input.sensor) != GT_CODE_OK) {
        input.sensor.status = GT_SAMPLE_NONE;
    }
}

static void receive(void)
{
    sockets_receive(server);
}

static void tick(void)
{
    gt_code code;
    uint64_t connection;

    receive();
    input.elapsed_cycles = 1 + skipped;
    if ((skipped > 0 || output.state.tick == 0) && input.reading == GT_READING_FAILED) {
        /* The references have followed the path since the last tick: they stay where it was seen last. At the start that is where the drives are.
         * The next call says that it is not seen. */
        input.reading = GT_READING_DONE;
        input.stop = GT_PRESSED;
    }
    skipped = 0;
    measure();
    code = gt_server_tick(server, &input, &output, NULL);
    if (code != GT_CODE_OK) {
        fail("cannot tick", code);
        return;
    }
    if (output.write) {
        drives_write(pins, &input, &output);
        /* Pins take what is written to them. */
        code = gt_server_written(server, GT_WRITE_ACCEPTED, NULL);
        if (code != GT_CODE_OK) {
            fail("cannot say that the references are written", code);
            return;
        }
    }
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

/* True if a session has a client that answers States. */
static int is_live(void)
{
    const gt_phase phase = output.state.phase;
    return phase == GT_PHASE_HANDSHAKE || phase == GT_PHASE_SUBMIT || phase == GT_PHASE_OBTAIN;
}

/* Lock-step: waits until the owner has answered the last State or has been silent for long, or somebody stops. */
static void wait_for_answer(void)
{
    const int64_t until = last_tick_ns + (output.state.phase == GT_PHASE_HANDSHAKE ? HANDSHAKE_SILENCE_NS : SILENCE_NS);
    uint8_t has_answered = 0;
    int64_t left;

    while ((left = until - rtapi_get_time()) > 0) {
        receive();
        if (gt_server_owner_has_answered(server, &has_answered) != GT_CODE_OK || has_answered || !output.has_owner || is_stopped()) {
            return;
        }
        sockets_wait(output.owner, (long)(left < POLL_NS ? left : POLL_NS));
    }
}

/* Lock-step without a session: the thread is behind its clock by what it has waited, and goes on at its own pace. */
static void wait_for_period(long period)
{
    int64_t left;
    while (lateness.is_started && (left = lateness.due_ns + period - rtapi_get_time()) > 0) {
        const struct timespec rest = {.tv_nsec = (long)(left < POLL_NS ? left : POLL_NS)};
        nanosleep(&rest, NULL);
    }
}

static void note_lateness(int64_t late_ns)
{
    *pins->lateness = late_ns < INT32_MAX ? (hal_s32_t)late_ns : INT32_MAX;
    if (*pins->lateness > *pins->lateness_max) {
        *pins->lateness_max = *pins->lateness;
    }
}

/* A call of a burst: several ticks at once would be several steps at the drive's next cycle. The offsets stay, on the path. */
static void hold(void)
{
    skipped += skipped < UINT32_MAX - 1;
    *pins->held += 1;
    input.elapsed_cycles = skipped;
    if (gt_server_hold(server, &input, &held, NULL) == GT_CODE_OK) {
        drives_hold(pins, &held);
    }
}

/* A thread that was late for that long has left the drives alone: somebody must look. */
static void stop_if_too_late(int64_t late_ns, long period)
{
    static int was_in_time = 1;
    if (!right(late_ns <= MAX_LATE_PERIODS * (int64_t)period, &was_in_time, "the thread was late by more than 250 periods: stopped")) {
        input.stop = GT_PRESSED;
    }
}

/* Function `gantry-tau.write`: one cycle of the server. */
static void write_function(void *unused, long period)
{
    int64_t late_ns;
    if (has_failed || (server == NULL && !start(period))) {
        return;
    }
    if (lockstep && is_live()) {
        wait_for_answer();
        last_tick_ns = rtapi_get_time();
        lateness.is_started = 0;
        look();
        tick();
        return;
    }
    if (lockstep) {
        wait_for_period(period);
    }
    late_ns = lateness_of_call(&lateness, rtapi_get_time(), period);
    note_lateness(late_ns);
    look();
    stop_if_too_late(late_ns, period);
    if (late_ns > period && !is_stop_new()) {
        hold();
        return;
    }
    last_tick_ns = rtapi_get_time();
    tick();
}

/* True for an address that is not of this computer alone. */
static int others_reach(const char *text)
{
    struct in_addr parsed;
    return inet_pton(AF_INET, text, &parsed) == 1 && ntohl(parsed.s_addr) >> 24 != IN_LOOPBACKNET;
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
    has_keys = key != NULL && *key != 0;
    if (!has_keys && !insecure && others_reach(address)) {
        snprintf(error, size, "everybody who reaches %s could move the machine: give key=FILE (gantry-tau key new FILE), or insecure=1", address);
        return -1;
    }
    if (has_keys && keys_read(key, &keys, error, size) != 0) {
        return -1;
    }
    if (configure(&config, lockstep, error, size) != 0 || sockets_open(address, port, udp, error, size) != 0) {
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
    epochs_release();
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
