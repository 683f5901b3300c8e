/*
 * Makes the calls of a script to a server and prints every result. The test compares them with core's.
 *
 *     axes A black_box B        the server; epochs 1 to 4
 *     o T                       open a connection of transport T
 *     c N                       connection N is gone
 *     f N [HEX]                 feed bytes
 *     e FIRST LAST              set epochs
 *     t E D S Q R W U AXIS... [IN_FORCE...]
 *                               tick: elapsed_cycles, reading, stop, quit, rearm, fate of its references (0: not said), arrival; of each axis
 *                               nominal and actual position, velocity, torque; of a refused write of each axis nominal, position, velocity, torque
 *     b                         the black box: its parts, then release
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gantry_tau.h"

static GT_MEMORY(GT_SERVER_SIZE_6_BLACK_BOX) memory;
static uint8_t part[GT_BLACK_BOX_PART];
static char word[16384];
static uint8_t bytes[8192];

static const char *const phases[] = {
    [GT_PHASE_LISTENING] = "Listening", [GT_PHASE_HANDSHAKE] = "Handshake", [GT_PHASE_SUBMIT] = "Submit",
    [GT_PHASE_OBTAIN] = "Obtain", [GT_PHASE_SAFE_DISCONNECT] = "SafeDisconnect", [GT_PHASE_FAULT] = "Fault",
};
static const char *const causes[] = {
    [GT_CAUSE_NONE] = "None", [GT_CAUSE_CLIENT_LATE] = "ClientLate", [GT_CAUSE_NETWORK_LATE] = "NetworkLate",
    [GT_CAUSE_SERVER_LATE] = "ServerLate", [GT_CAUSE_MALFORMED] = "Malformed", [GT_CAUSE_CLOSED] = "Closed",
    [GT_CAUSE_GOODBYE] = "Goodbye", [GT_CAUSE_BUDGET] = "Budget", [GT_CAUSE_STOP] = "Stop", [GT_CAUSE_NOMINAL] = "Nominal",
    [GT_CAUSE_FLOOD] = "Flood", [GT_CAUSE_HANDSHAKE_TIMEOUT] = "HandshakeTimeout", [GT_CAUSE_RESTART] = "Restart",
    [GT_CAUSE_AGITATED] = "Agitated",
};

static void check(gt_code code)
{
    if (code != GT_CODE_OK) {
        printf("FAILED: %s\n", gt_code_name(code));
        exit(1);
    }
}

static const char *next(void)
{
    if (scanf("%16383s", word) != 1) {
        exit(2);
    }
    return word;
}

static int64_t number(void)
{
    return strtoll(next(), NULL, 10);
}

static uint64_t natural(void)
{
    return strtoull(next(), NULL, 10);
}

static size_t hex(void)
{
    const char *digits = next();
    size_t length = 0;
    if (strcmp(digits, "-") == 0) {
        return 0;
    }
    for (; digits[2 * length]; length++) {
        const char pair[3] = {digits[2 * length], digits[2 * length + 1], 0};
        bytes[length] = (uint8_t)strtoul(pair, NULL, 16);
    }
    return length;
}

static void print_hex(const uint8_t *data, size_t length)
{
    for (size_t i = 0; i < length; i++) {
        printf("%02x", data[i]);
    }
    printf("\n");
}

static gt_offsets offsets(void)
{
    gt_offsets offsets;
    offsets.position_nm = (int32_t)number();
    offsets.velocity_um_s = (int32_t)number();
    offsets.torque_permille = (int16_t)number();
    return offsets;
}

static void print_channels(const char *what, int64_t position, int32_t velocity, int16_t torque)
{
    printf("\"%s\":{\"position\":%lld,\"velocity\":%" PRId32 ",\"torque\":%" PRId16 "},", what, (long long)position, velocity, torque);
}

static void print_sensor(const gt_wrench_sample *sensor)
{
    const int32_t *f = sensor->force_mn, *m = sensor->moment_unm;
    if (sensor->status == GT_SAMPLE_NONE) {
        printf("\"sensor\":null,");
        return;
    }
    printf("\"sensor\":{\"age\":%u,\"is_cut\":%s,", sensor->age, sensor->status == GT_SAMPLE_CUT ? "true" : "false");
    printf("\"force\":[%" PRId32 ",%" PRId32 ",%" PRId32 "],\"moment\":[%" PRId32 ",%" PRId32 ",%" PRId32 "]},", f[0], f[1], f[2], m[0], m[1], m[2]);
}

/* The JSON that core's `serde` types give. */
static void print_state(const gt_state *state)
{
    const gt_counters *c = &state->counters;
    printf("{\"tick\":%llu,\"epoch\":%llu,\"accepted\":%llu,\"phase\":\"%s\",\"cause\":\"%s\",",
           (unsigned long long)state->tick, (unsigned long long)state->epoch, (unsigned long long)state->accepted, phases[state->phase], causes[state->cause]);
    printf("\"on_time_of_100\":%u,\"arrival_us\":%u,\"ramp_ticks_left\":%" PRIu32 ",", state->on_time_of_100, state->arrival_us, state->ramp_ticks_left);
    printf("\"counters\":{\"received\":%" PRIu32 ",\"missed\":%" PRIu32 ",\"late\":%" PRIu32 ",\"duplicate\":%" PRIu32 ",\"stale\":%" PRIu32 ",",
           c->received, c->missed, c->late, c->duplicate, c->stale);
    printf("\"malformed\":%" PRIu32 ",\"out_of_range\":%" PRIu32 ",\"limited\":%" PRIu32 ",\"clamped\":%" PRIu32 ",\"non_owner\":%" PRIu32 ",\"longest_miss_run\":%u},",
           c->malformed, c->out_of_range, c->limited, c->clamped, c->non_owner, c->longest_miss_run);
    print_sensor(&state->sensor);
    printf("\"axes\":[");
    for (uint32_t i = 0; i < state->axis_count; i++) {
        const gt_axis_state *axis = &state->axes[i];
        printf("%s{\"nominal\":%lld,", i ? "," : "", (long long)axis->nominal_nm);
        print_channels("offsets", axis->offsets.position_nm, axis->offsets.velocity_um_s, axis->offsets.torque_permille);
        print_channels("shadow", axis->shadow.position_nm, axis->shadow.velocity_um_s, axis->shadow.torque_permille);
        print_channels("actual", axis->actual.position_nm, axis->actual.velocity_um_s, axis->actual.torque_permille);
        printf("\"flags\":%u}", axis->flags);
    }
    printf("]}\n");
}

static void tick(gt_server *server, uint32_t axes)
{
    gt_tick_input input;
    gt_tick_output output;
    gt_frame frame;
    gt_in_force in_force[GT_MAX_AXES];
    uint64_t connection;
    uint8_t fate;
    gt_code code;

    memset(&input, 0x55, sizeof input); /* entries beyond the axes are not read */
    input.elapsed_cycles = (uint32_t)natural();
    input.reading = (uint8_t)natural();
    input.stop = (uint8_t)natural();
    input.quit = (uint8_t)natural();
    input.rearm = (uint8_t)natural();
    fate = (uint8_t)natural();
    check(gt_server_note_arrival(server, (uint16_t)natural()));
    input.sensor.status = (uint8_t)natural();
    input.sensor.age = (uint8_t)natural();
    for (int i = 0; i < 3; i++) {
        input.sensor.force_mn[i] = (int32_t)number();
        input.sensor.moment_unm[i] = (int32_t)number();
    }
    for (uint32_t i = 0; i < axes; i++) {
        input.nominal_nm[i] = number();
        input.actual[i].position_nm = number();
        input.actual[i].velocity_um_s = (int32_t)number();
        input.actual[i].torque_permille = (int16_t)number();
    }
    for (uint32_t i = 0; fate == GT_WRITE_REFUSED && i < axes; i++) {
        in_force[i].nominal_nm = number();
        in_force[i].offsets = offsets();
    }
    check(gt_server_tick(server, &input, &output, NULL));
    printf("write %u\n", output.write);
    for (uint32_t i = 0; i < output.motor_count; i++) {
        printf("motor %lld %" PRId32 " %" PRId16 "\n", (long long)output.motors[i].position_nm, output.motors[i].velocity_offset_um_s, output.motors[i].torque_offset_permille);
    }
    printf("refused %" PRIu32 " welcomed %u owner %u %llu ended %s latched %u\n", output.refused, output.welcomed, output.has_owner, (unsigned long long)output.owner, causes[output.ended], output.latched);
    print_state(&output.state);
    if (fate != 0) {
        printf("written %s\n", gt_code_name(gt_server_written(server, fate, fate == GT_WRITE_REFUSED ? in_force : NULL)));
    }
    while ((code = gt_server_poll_transmit(server, &frame)) == GT_CODE_OK) {
        printf("frame %llu ", (unsigned long long)frame.connection);
        print_hex(frame.bytes, frame.length);
    }
    printf("%s\n", gt_code_name(code));
    while ((code = gt_server_poll_close(server, &connection)) == GT_CODE_OK) {
        printf("close %llu\n", (unsigned long long)connection);
    }
    printf("%s\n", gt_code_name(code));
}

static void black_box(gt_server *server)
{
    gt_black_box box;
    check(gt_server_black_box(server, &box));
    printf("black box %" PRIu32 " frozen %u\n", box.ticks, box.frozen);
    for (uint32_t i = 0; i < box.parts; i++) {
        size_t length;
        check(gt_server_black_box_part(server, i, part, sizeof part, &length));
        printf("part ");
        print_hex(part, length);
    }
    check(gt_server_black_box_release(server));
}

static gt_server *begin(uint32_t *axes)
{
    static const gt_limits velocity = {5000, 200, 400, 50}, torque = {50, 5, 10, 1};
    gt_server_config config;
    gt_start start;
    gt_server *server;

    memset(&start, 0, sizeof start);
    start.first_epoch = 1;
    start.last_epoch = 4;
    next(); /* axes */
    *axes = (uint32_t)natural();
    check(gt_server_config_thesis(&config, *axes));
    next(); /* black_box */
    config.black_box_ticks = (uint32_t)natural();
    config.motors = 9;
    for (uint32_t i = 0; i < config.motors; i++) {
        config.axis_of_motor[i] = (uint8_t)(i % config.axes);
    }
    for (uint32_t i = 0; i < config.axes; i++) {
        gt_axis_config *axis = &config.axis[i];
        axis->velocity = velocity;
        axis->torque = torque;
        axis->nominal_lower_nm = -1000000000;
        axis->nominal_upper_nm = 1000000000;
        axis->machine_lower_nm = -1010000000;
        axis->machine_upper_nm = 1010000000;
        axis->nominal_step_nm = 100000;
    }
    config.kinematics_checksum = 0x12345678;
    config.handshake_ticks = 40;
    config.budget_window = 100;
    config.budget_allowed = 20;
    check(gt_server_init(&memory, sizeof memory, &config, &start, &server, NULL));
    return server;
}

int main(void)
{
    uint32_t axes;
    gt_server *server = begin(&axes);
    char call[2];
    while (scanf("%1s", call) == 1) {
        uint64_t connection = 0;
        uint8_t frames = 0;
        size_t length;
        switch (call[0]) {
        case 'o':
            printf("open %s", gt_code_name(gt_server_open(server, (uint32_t)natural(), &connection)));
            printf(" %llu\n", (unsigned long long)connection);
            break;
        case 'c':
            check(gt_server_close(server, natural()));
            break;
        case 'f':
            connection = natural();
            length = hex();
            check(gt_server_feed(server, connection, bytes, length, &frames));
            printf("fed %u\n", frames);
            break;
        case 'e':
            connection = natural();
            check(gt_server_set_epochs(server, connection, natural()));
            break;
        case 't':
            tick(server, axes);
            break;
        case 'b':
            black_box(server);
            break;
        default:
            return 2;
        }
    }
    return 0;
}
