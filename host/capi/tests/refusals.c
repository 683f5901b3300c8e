/* Every mistake of a caller that the library can detect returns its error code and has no other effect. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gantry_tau.h"
#include "../examples/f1.h"
#include "../examples/l2.h"

static GT_MEMORY(GT_SERVER_SIZE_6_BLACK_BOX) memory;
static int refused;

/* Requires that a call returned this code. */
static void expect(int line, gt_code expected, gt_code code)
{
    if (code != expected) {
        printf("line %d: %s, not %s\n", line, gt_code_name(code), gt_code_name(expected));
        exit(1);
    }
    refused += code != GT_CODE_OK;
}

/* Requires that an error has this index, parameter and value. */
static void about(int line, const gt_error *error, int32_t index, gt_parameter parameter, double value)
{
    if (error->index != index || error->parameter != parameter || error->value != value) {
        printf("line %d: index %" PRId32 ", parameter %" PRId32 ", value %g\n", line, error->index, error->parameter, error->value);
        exit(1);
    }
}

#define REFUSE(wrong)                                                                                                  \
    if (wrong) {                                                                                                       \
        printf("line %d: %s\n", __LINE__, #wrong);                                                                     \
        exit(1);                                                                                                       \
    }
#define EXPECT(code, call) expect(__LINE__, GT_CODE_##code, call)
#define ABOUT(index, parameter, value) about(__LINE__, &error, index, GT_PARAMETER_##parameter, value)

static gt_server_config good(uint32_t axes)
{
    gt_server_config config;
    EXPECT(OK, gt_server_config_thesis(&config, axes));
    return config;
}

static void configurations(void)
{
    gt_error error;
    gt_server_config config = good(3);
    size_t size = 0;

    EXPECT(OK, gt_server_config_check(&config, &size, &error));
    expect(__LINE__, GT_CODE_OK, error.code);
    REFUSE(size > GT_SERVER_SIZE_3 || size < GT_SERVER_SIZE_3 / 2)
    EXPECT(NULL_POINTER, gt_server_config_thesis(NULL, 3));
    EXPECT(CONFIG_AXES, gt_server_config_thesis(&config, 4));
    EXPECT(NULL_POINTER, gt_server_config_check(NULL, NULL, NULL));

#define BAD(code, change)                                                                                              \
    config = good(6);                                                                                                  \
    change;                                                                                                            \
    EXPECT(code, gt_server_config_check(&config, NULL, &error))
    BAD(CONFIG_AXES, config.axes = 0);
    ABOUT(-1, NONE, 0);
    BAD(CONFIG_AXES, config.axes = UINT32_MAX);
    BAD(MOTOR_COUNT, config.motors = 0);
    BAD(MOTOR_COUNT, config.motors = 13);
    ABOUT(-1, NONE, 13);
    BAD(MOTOR_MAP, config.axis_of_motor[5] = 6);
    ABOUT(5, NONE, 6);
    BAD(BLACK_BOX, config.black_box_ticks = 63);
    BAD(CONFIG_HANDSHAKE_TICKS, config.handshake_ticks = 0);
    BAD(CONFIG_BUDGET_WINDOW, config.budget_window = 129);
    ABOUT(-1, NONE, 129);
    BAD(LIMITS_NEGATIVE_MAX, config.axis[5].torque.max = INT32_MIN);
    ABOUT(5, TORQUE, INT32_MIN);
    BAD(LIMITS_RAMP_NOT_POSITIVE, config.axis[1].position.ramp = 0);
    ABOUT(1, POSITION, 0);
    BAD(LIMITS_RAMP_ABOVE_STEP, config.axis[2].velocity.ramp = 2);
    ABOUT(2, VELOCITY, 2);
    BAD(LIMITS_ACCEL_TOO_SMALL, config.axis[0].position.accel = 5099);
    ABOUT(0, POSITION, 5099);
    REFUSE(error.lower != 5100)
    BAD(CONFIG_TORQUE_MAX, config.axis[4].torque.max = 32768);
    ABOUT(4, NONE, 0);
    BAD(CONFIG_TRAVEL, config.axis[3].nominal_lower_nm = 1);
    BAD(CONFIG_TRAVEL, config.axis[3].machine_upper_nm = INT64_MAX);
    BAD(CONFIG_MARGIN, config.axis[2].machine_upper_nm = 1999999);
    ABOUT(2, NONE, 0);
    BAD(CONFIG_AGITATION, config.axis[1].agitation_nm_per_tick = 1000001);
    ABOUT(1, NONE, 1000001);
    /* Entries beyond the machine's axes are not read. */
    config = good(3);
    config.axis[3].position.ramp = 0;
    config.axis_of_motor[3] = 200;
    EXPECT(OK, gt_server_config_check(&config, NULL, &error));
}

/* One datagram is a Hello; none that differs from it in one bit gets a place, and no part of it, and nothing longer. */
static void greet(void)
{
    uint8_t hello[17] = {'G', 'T', 2, 1, 4, 0, 0, 0, 6, 0, 0, 0, 0xee, 0xa3, 0xe6, 0x45, 0};
    const uint8_t peer[GT_PEER] = {0};
    const gt_server_config config = good(6);
    const gt_start start = {0};
    gt_greeting greeting;
    gt_server *server;
    EXPECT(OK, gt_server_init(&memory, sizeof memory, &config, &start, &server, NULL));
    for (size_t length = 0; length <= sizeof hello; length++) {
        if (length != 16) {
            EXPECT(OK, gt_server_greet(server, peer, hello, length, &greeting));
            REFUSE(greeting.what != GT_GREETED_NOTHING)
        }
    }
    for (size_t bit = 0; bit < 8 * 16; bit++) {
        hello[bit / 8] ^= (uint8_t)(1u << bit % 8);
        EXPECT(OK, gt_server_greet(server, peer, hello, 16, &greeting));
        REFUSE(greeting.what != GT_GREETED_NOTHING)
        hello[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    for (uint64_t place = 0; place < GT_MAX_CONNECTIONS; place++) {
        EXPECT(OK, gt_server_greet(server, peer, hello, 16, &greeting));
        REFUSE(greeting.what != GT_GREETED_PEER || greeting.frame.connection != place || greeting.frame.length != 0)
    }
    EXPECT(OK, gt_server_greet(server, peer, hello, 16, &greeting));
    REFUSE(greeting.what != GT_GREETED_ANSWER || greeting.frame.length != 20)
    EXPECT(OK, gt_server_greet(server, peer, NULL, 0, &greeting));
    EXPECT(NULL_POINTER, gt_server_greet(server, peer, NULL, 16, &greeting));
    EXPECT(NULL_POINTER, gt_server_greet(server, NULL, hello, 16, &greeting));
    EXPECT(NULL_POINTER, gt_server_greet(server, peer, hello, 16, NULL));
    EXPECT(NULL_POINTER, gt_server_greet(NULL, peer, hello, 16, &greeting));
    EXPECT(LENGTH, gt_server_greet(server, peer, hello, SIZE_MAX, &greeting));
    {
        uint8_t id[GT_KEY_ID];
        EXPECT(DONE, gt_server_granted_key(server, id));
    }
}

/* The key of wire.md, and texts that are none. */
static void keys(void)
{
    static const char text[] = "gantry-tau-key 1\nrole control\nsecret 000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n";
    static const uint8_t expected[GT_KEY_ID] = {0x91, 0xab, 0x2d, 0xba, 0x98, 0x40, 0xf1, 0x09};
    const size_t length = sizeof text - 1;
    const gt_server_config config = good(3);
    const gt_start start = {0};
    const uint8_t peer[GT_PEER] = {0};
    uint8_t id[GT_KEY_ID];
    gt_error error;
    gt_keys keys = {.count = 1};
    gt_greeting greeting;
    gt_server *server;
    gt_key *key = &keys.keys[0];
    EXPECT(OK, gt_key_parse((const uint8_t *)text, length, key, &error));
    EXPECT(OK, gt_key_id(key, id));
    REFUSE(memcmp(id, expected, sizeof id) != 0 || key->role != GT_ROLE_CONTROL || key->secret[31] != 0x1f)
    EXPECT(KEY_TEXT, gt_key_parse((const uint8_t *)text, length - 2, key, &error));
    REFUSE(error.value != 3.0)
    EXPECT(KEY_TEXT, gt_key_parse(NULL, 0, key, &error));
    REFUSE(error.value != 1.0)
    EXPECT(NULL_POINTER, gt_key_parse((const uint8_t *)text, length, NULL, &error));
    EXPECT(NULL_POINTER, gt_key_id(NULL, id));
    EXPECT(OK, gt_server_init_keyed(&memory, sizeof memory, &config, &start, &keys, &server, &error));
    /* A Hello without a tag is not answered, nor is one with any bytes for it. */
    EXPECT(OK, gt_server_greet(server, peer, (const uint8_t *)"GT\2\1\4\0\0\0\3\0\0\0\356\243\346\105", 16, &greeting));
    REFUSE(greeting.what != GT_GREETED_NOTHING)
    keys.keys[1] = keys.keys[0];
    keys.count = 2;
    EXPECT(KEY_TWICE, gt_server_init_keyed(&memory, sizeof memory, &config, &start, &keys, &server, &error));
    REFUSE(error.index != 1)
    keys.keys[1].role = 0;
    EXPECT(KEY_ROLE, gt_server_init_keyed(&memory, sizeof memory, &config, &start, &keys, &server, &error));
    EXPECT(KEY_ROLE, gt_key_id(&keys.keys[1], id));
    for (uint32_t count = 0; count <= GT_MAX_KEYS + 1; count += GT_MAX_KEYS + 1) {
        keys.count = count;
        EXPECT(KEY_COUNT, gt_server_init_keyed(&memory, sizeof memory, &config, &start, &keys, &server, &error));
    }
    EXPECT(NULL_POINTER, gt_server_init_keyed(&memory, sizeof memory, &config, &start, NULL, &server, &error));
}

static void samples(void)
{
    static const gt_wrench_sample none = {.status = GT_SAMPLE_NONE};
    gt_wrench wrench = {{1.5, -0.0005, 0.0004}, {1e-6, -2e-6, 0.25}};
    gt_wrench_sample sample;
    EXPECT(NULL_POINTER, gt_wrench_sample_of(NULL, 0, &sample));
    EXPECT(NULL_POINTER, gt_wrench_sample_of(&wrench, 0, NULL));
    EXPECT(MISALIGNED, gt_wrench_sample_of((const gt_wrench *)((const uint8_t *)&wrench + 1), 0, &sample));
    EXPECT(OK, gt_wrench_sample_of(&wrench, 9, &sample));
    REFUSE(sample.status != GT_SAMPLE_DONE || sample.age != 9)
    REFUSE(sample.force_mn[0] != 1500 || sample.force_mn[1] != -1 || sample.force_mn[2] != 0)
    REFUSE(sample.moment_unm[0] != 1 || sample.moment_unm[1] != -2 || sample.moment_unm[2] != 250000)
    wrench.force_n[2] = -INFINITY;
    EXPECT(OK, gt_wrench_sample_of(&wrench, 9, &sample));
    REFUSE(sample.status != GT_SAMPLE_CUT || sample.force_mn[2] != -INT32_MAX || sample.force_mn[0] != 1500)
    wrench.moment_nm[0] = 2147.483648;
    EXPECT(OK, gt_wrench_sample_of(&wrench, 255, &sample));
    REFUSE(sample.status != GT_SAMPLE_CUT || sample.moment_unm[0] != INT32_MAX)
    wrench.moment_nm[2] = NAN;
    EXPECT(OK, gt_wrench_sample_of(&wrench, 255, &sample));
    REFUSE(memcmp(&sample, &none, sizeof none) != 0)
}

static void servers(void)
{
    gt_error error;
    gt_server_config config = good(6);
    gt_start start;
    gt_server *server = NULL, *none = NULL;
    gt_tick_input input;
    gt_tick_output output;
    gt_in_force in_force[GT_MAX_AXES] = {{0}};
    gt_frame frame;
    gt_black_box box;
    uint64_t connection = 0, first = 0;
    uint8_t flag = 0, at_zero = 1;
    size_t length = 0, whole = 0;
    uint8_t part[GT_BLACK_BOX_PART], beginning[8];

    memset(&start, 0, sizeof start);
    memset(&input, 0, sizeof input);
    input.reading = GT_READING_DONE;
    input.stop = input.rearm = GT_RELEASED;
    config.black_box_ticks = GT_BLACK_BOX_TICKS;

    EXPECT(NULL_POINTER, gt_server_init(NULL, sizeof memory, &config, &start, &server, &error));
    EXPECT(NULL_POINTER, gt_server_init(&memory, sizeof memory, NULL, &start, &server, &error));
    EXPECT(NULL_POINTER, gt_server_init(&memory, sizeof memory, &config, NULL, &server, &error));
    EXPECT(NULL_POINTER, gt_server_init(&memory, sizeof memory, &config, &start, NULL, NULL));
    EXPECT(MISALIGNED, gt_server_init(memory.bytes + 4, sizeof memory - 4, &config, &start, &server, &error));
    EXPECT(MEMORY_TOO_SMALL, gt_server_init(&memory, 1024, &config, &start, &server, &error));
    REFUSE(error.value < 1024 || error.value > GT_SERVER_SIZE_6_BLACK_BOX)
    start.in_force[4].offsets.position_nm = 2000001;
    EXPECT(START_OFFSET_IN_FORCE, gt_server_init(&memory, sizeof memory, &config, &start, &server, &error));
    ABOUT(4, NONE, 2000001);
    REFUSE(server) /* no handle was written */
    start.in_force[4].offsets.position_nm = 0;

    /* Memory without a server. */
    EXPECT(NO_OBJECT, gt_server_tick((gt_server *)&memory, &input, &output, &error));
    EXPECT(OK, gt_server_init(&memory, sizeof memory, &config, &start, &server, &error));
    start.in_force[0].offsets.torque_permille = 1;
    EXPECT(START_OFFSET_IN_FORCE, gt_server_init(&memory, sizeof memory, &config, &start, &none, &error));
    EXPECT(NO_OBJECT, gt_server_tick(server, &input, &output, &error));
    start.in_force[0].offsets.torque_permille = 0;
    EXPECT(OK, gt_server_init(&memory, sizeof memory, &config, &start, &server, &error));

    EXPECT(NULL_POINTER, gt_server_open(NULL, GT_TRANSPORT_STREAM, &connection));
    EXPECT(NULL_POINTER, gt_server_open(server, GT_TRANSPORT_STREAM, NULL));
    EXPECT(TRANSPORT, gt_server_open(server, 2, &connection));
    for (int i = 0; i < GT_MAX_CONNECTIONS; i++) {
        EXPECT(OK, gt_server_open(server, (uint32_t)i % 2, &connection));
        REFUSE(connection != (uint64_t)i)
    }
    EXPECT(FULL, gt_server_open(server, GT_TRANSPORT_STREAM, &connection));
    EXPECT(OK, gt_server_longest_idle(server, &connection));
    REFUSE(connection != 0)
    EXPECT(NULL_POINTER, gt_server_longest_idle(server, NULL));
    EXPECT(NULL_POINTER, gt_server_longest_idle(NULL, &connection));
    EXPECT(OK, gt_server_refusal(GT_TRANSPORT_STREAM, &frame));
    REFUSE(frame.length != 18 || memcmp(frame.bytes, "GT\1\7\10\0\7", 7) != 0)
    EXPECT(OK, gt_server_refusal(GT_TRANSPORT_DATAGRAM, &frame));
    REFUSE(frame.length != 20 || memcmp(frame.bytes, "GT\2\7\10\0\0\0\7", 9) != 0)
    EXPECT(TRANSPORT, gt_server_refusal(2, &frame));
    EXPECT(NULL_POINTER, gt_server_refusal(GT_TRANSPORT_STREAM, NULL));
    EXPECT(OK, gt_server_close(server, first));
    EXPECT(OK, gt_server_close(server, 12345));
    EXPECT(NULL_POINTER, gt_server_close(NULL, first));

    EXPECT(OK, gt_server_feed(server, 1, NULL, 0, &flag));
    EXPECT(OK, gt_server_feed(server, 12345, (const uint8_t *)"x", 1, NULL));
    EXPECT(NULL_POINTER, gt_server_feed(server, 1, NULL, 1, &flag));
    EXPECT(LENGTH, gt_server_feed(server, 1, (const uint8_t *)"x", SIZE_MAX, &flag));
    EXPECT(NULL_POINTER, gt_server_feed(NULL, 1, (const uint8_t *)"x", 1, &flag));
    EXPECT(NULL_POINTER, gt_server_owner_has_answered(server, NULL));
    EXPECT(OK, gt_server_owner_has_answered(server, &flag));

    EXPECT(NULL_POINTER, gt_server_set_epochs(NULL, 1, 2));
    EXPECT(OK, gt_server_set_epochs(server, 2, 1)); /* an empty range */

    EXPECT(NULL_POINTER, gt_server_tick(NULL, &input, &output, &error));
    EXPECT(NULL_POINTER, gt_server_tick(server, NULL, &output, NULL));
    EXPECT(NULL_POINTER, gt_server_tick(server, &input, NULL, &error));
    EXPECT(MISALIGNED, gt_server_tick((gt_server *)(memory.bytes + 1), &input, &output, &error));
    /* A field that was forgotten is zero, and refused; so is every other value without a meaning. */
    for (int wrong = 0; wrong <= UINT8_MAX; wrong++) {
        const uint8_t value = (uint8_t)wrong;
        if (value != GT_RELEASED && value != GT_PRESSED) {
            input.stop = value;
            EXPECT(TICK_INPUT, gt_server_tick(server, &input, &output, &error));
            ABOUT(-1, STOP, value);
            input.stop = GT_RELEASED;
            input.rearm = value;
            EXPECT(TICK_INPUT, gt_server_tick(server, &input, &output, &error));
            ABOUT(-1, REARM, value);
            input.rearm = GT_RELEASED;
        }
        if (value != GT_READING_DONE && value != GT_READING_FAILED) {
            input.reading = value;
            EXPECT(TICK_INPUT, gt_server_tick(server, &input, &output, &error));
            ABOUT(-1, READING, value);
            input.reading = GT_READING_DONE;
        }
        if (value != GT_SAMPLE_NONE && value != GT_SAMPLE_DONE && value != GT_SAMPLE_CUT) {
            input.sensor.status = value;
            EXPECT(TICK_INPUT, gt_server_tick(server, &input, &output, &error));
            ABOUT(-1, SENSOR, value);
            input.sensor.status = GT_SAMPLE_NONE;
        }
    }
    /* Nothing to poll before the first tick, and nothing to say. */
    EXPECT(NOT_PENDING, gt_server_written(server, GT_WRITE_ACCEPTED, NULL));
    EXPECT(DONE, gt_server_poll_transmit(server, &frame));
    EXPECT(DONE, gt_server_poll_close(server, &connection));
    EXPECT(OK, gt_server_feed(server, 1, (const uint8_t *)"not a frame", 11, &flag));
    EXPECT(OK, gt_server_tick(server, &input, &output, &error));
    REFUSE(output.state.tick != 1) /* the refused calls were not ticks */
    REFUSE(!output.write || output.state.phase != GT_PHASE_LISTENING)
    EXPECT(NULL_POINTER, gt_server_poll_transmit(NULL, &frame));
    EXPECT(NULL_POINTER, gt_server_poll_transmit(server, NULL));
    EXPECT(DONE, gt_server_poll_transmit(server, &frame));
    EXPECT(DONE, gt_server_poll_transmit(server, &frame));
    EXPECT(NULL_POINTER, gt_server_poll_close(NULL, &connection));
    EXPECT(NULL_POINTER, gt_server_poll_close(server, NULL));
    EXPECT(OK, gt_server_poll_close(server, &connection)); /* a refused call has consumed nothing */
    REFUSE(connection != 1)
    EXPECT(DONE, gt_server_poll_close(server, &connection));
    REFUSE(connection != 1) /* not written at the end */

    EXPECT(OK, gt_server_black_box(server, &box));
    REFUSE(box.ticks != 1 || box.parts != 3 || box.frozen)
    EXPECT(BUFFER_TOO_SMALL, gt_server_black_box_part(server, 0, NULL, 0, &length));
    REFUSE(length != 10)
    EXPECT(OK, gt_server_black_box_part(server, 0, part, 10, &length));
    REFUSE(length != 10 || memcmp(part, "GTBB\10\6\1\0\0\0", 10) != 0)
    EXPECT(OK, gt_server_black_box_part(server, 2, part, sizeof part, &whole));
    memcpy(beginning, part, 8);
    memset(part, 77, sizeof part);
    EXPECT(BUFFER_TOO_SMALL, gt_server_black_box_part(server, 2, part, 8, &length));
    REFUSE(length <= 10 || length != whole || memcmp(part, beginning, 8) != 0 || part[8] != 77)
    EXPECT(NULL_POINTER, gt_server_black_box_part(server, 0, NULL, 1, &length));
    EXPECT(LENGTH, gt_server_black_box_part(server, 0, part, SIZE_MAX, &length));
    EXPECT(INDEX, gt_server_black_box_part(server, 3, part, sizeof part, &length));
    EXPECT(INDEX, gt_server_black_box_part(server, UINT32_MAX, part, sizeof part, &length));
    EXPECT(NULL_POINTER, gt_server_black_box_part(server, 0, part, sizeof part, NULL));
    EXPECT(NULL_POINTER, gt_server_black_box(server, NULL));
    EXPECT(OK, gt_server_black_box_release(server));
    EXPECT(INDEX, gt_server_black_box_part(server, 0, part, sizeof part, &length));

    /* What became of the references is said once, and in time: these are unknown since their State was polled. */
    EXPECT(NOT_PENDING, gt_server_written(server, GT_WRITE_ACCEPTED, NULL));
    EXPECT(NULL_POINTER, gt_server_written(NULL, GT_WRITE_ACCEPTED, NULL));
    EXPECT(OK, gt_server_tick(server, &input, &output, &error));
    REFUSE(output.write || output.motor_count != 6 || output.motors[5].position_nm != 0)
    for (int wrong = 0; wrong <= UINT8_MAX; wrong++) {
        if (wrong < GT_WRITE_ACCEPTED || wrong > GT_WRITE_UNKNOWN) {
            EXPECT(WRITE, gt_server_written(server, (uint8_t)wrong, in_force));
        }
    }
    EXPECT(NULL_POINTER, gt_server_written(server, GT_WRITE_REFUSED, NULL));
    EXPECT(MISALIGNED, gt_server_written(server, GT_WRITE_REFUSED, (const gt_in_force *)((const uint8_t *)in_force + 1)));
    in_force[5].offsets.position_nm = -250;
    EXPECT(OK, gt_server_written(server, GT_WRITE_REFUSED, in_force)); /* still waited for */
    EXPECT(NOT_PENDING, gt_server_written(server, GT_WRITE_REFUSED, in_force));
    /* The server goes on from the values that were read back. */
    EXPECT(OK, gt_server_note_arrival(server, 321));
    EXPECT(NULL_POINTER, gt_server_note_arrival(NULL, 321));
    EXPECT(OK, gt_server_tick(server, &input, &output, &error));
    REFUSE(!output.write || output.state.phase != GT_PHASE_FAULT || output.motors[5].position_nm != -150)
    REFUSE(output.state.arrival_us != 321)
    /* Refused: the program must not end. */
    EXPECT(OK, gt_server_written(server, GT_WRITE_REFUSED, in_force));
    EXPECT(OK, gt_server_is_at_zero(server, &at_zero));
    REFUSE(at_zero)
    EXPECT(OK, gt_server_tick(server, &input, &output, &error));
    REFUSE(!output.write || output.motors[5].position_nm != -150 || output.state.arrival_us != 0)
    /* With values in force beyond their limits, or unknown, nothing may be written. */
    in_force[5].offsets.velocity_um_s = 1;
    EXPECT(OK, gt_server_written(server, GT_WRITE_REFUSED, in_force));
    EXPECT(OK, gt_server_tick(server, &input, &output, &error));
    REFUSE(output.write)
    EXPECT(OK, gt_server_written(server, GT_WRITE_UNKNOWN, NULL));
    EXPECT(OK, gt_server_tick(server, &input, &output, &error));
    REFUSE(output.write)
    /* Only a read-back ends that. */
    EXPECT(WITHHELD, gt_server_written(server, GT_WRITE_ACCEPTED, NULL));
    EXPECT(NOT_PENDING, gt_server_written(server, GT_WRITE_ACCEPTED, NULL));
    EXPECT(OK, gt_server_tick(server, &input, &output, &error));
    REFUSE(output.write)
    in_force[5].offsets.velocity_um_s = 0;
    EXPECT(OK, gt_server_written(server, GT_WRITE_REFUSED, in_force));
    EXPECT(OK, gt_server_tick(server, &input, &output, &error));
    REFUSE(!output.write)
    /* Nothing said is nothing known. */
    EXPECT(OK, gt_server_tick(server, &input, &output, &error));
    REFUSE(output.write)

    /* A server without a black box. */
    config.black_box_ticks = GT_BLACK_BOX_NONE;
    EXPECT(OK, gt_server_init(&memory, GT_SERVER_SIZE_6, &config, &start, &server, &error));
    EXPECT(OK, gt_server_tick(server, &input, &output, &error));
    EXPECT(OK, gt_server_black_box(server, &box));
    REFUSE(box.ticks != 0 || box.parts != 0 || box.frozen)
    EXPECT(OK, gt_server_black_box_release(server));

    /* What is said to be in force is compared with where the drives stand, until they agree. */
    start.in_force[2].nominal_nm = 1500000;
    start.in_force[2].offsets.position_nm = -2000;
    EXPECT(OK, gt_server_init(&memory, GT_SERVER_SIZE_6, &config, &start, &server, &error));
    EXPECT(START_DISAGREES, gt_server_tick(server, &input, &output, &error));
    ABOUT(2, NONE, 1498000);
    input.actual[2].position_nm = 2498001;
    EXPECT(START_DISAGREES, gt_server_tick(server, &input, &output, &error));
    ABOUT(2, NONE, 1000001);
    input.actual[2].position_nm = 2498000;
    input.actual[3].position_nm = INT64_MIN;
    EXPECT(START_DISAGREES, gt_server_tick(server, &input, &output, &error));
    ABOUT(3, NONE, UINT32_MAX);
    input.actual[3].position_nm = 0;
    input.reading = GT_READING_FAILED;
    EXPECT(START_DISAGREES, gt_server_tick(server, &input, &output, &error));
    ABOUT(-1, NONE, 0);
    EXPECT(DONE, gt_server_poll_transmit(server, &frame));
    {
        gt_held held;
        EXPECT(OK, gt_server_hold(server, &input, &held, &error));
        REFUSE(held.write || held.follows || held.motor_count != 6 || held.motors[2].position_nm != 0)
        EXPECT(NULL_POINTER, gt_server_hold(server, NULL, &held, NULL));
        EXPECT(NULL_POINTER, gt_server_hold(server, &input, NULL, NULL));
        EXPECT(NO_OBJECT, gt_server_hold((gt_server *)(memory.bytes + 64), &input, &held, NULL));
        input.reading = GT_READING_DONE;
        EXPECT(OK, gt_server_tick(server, &input, &output, &error));
        /* The path is elsewhere: what is in force stands. */
        REFUSE(output.state.tick != 1 || output.motors[2].position_nm != 1498100)
        EXPECT(OK, gt_server_written(server, GT_WRITE_ACCEPTED, NULL));
        /* Afterwards a measurement may be lost or far away. */
        input.actual[2].position_nm = 0;
        EXPECT(OK, gt_server_tick(server, &input, &output, &error));
        EXPECT(OK, gt_server_hold(server, &input, &held, &error));
        REFUSE(held.write || held.motors[2].position_nm != 0) /* nothing is said of them yet */
        EXPECT(OK, gt_server_written(server, GT_WRITE_ACCEPTED, NULL));
        input.elapsed_cycles = 1;
        input.nominal_nm[2] = 1500000;
        EXPECT(OK, gt_server_hold(server, &input, &held, &error));
        REFUSE(!held.write || !held.follows || held.motors[2].position_nm != output.motors[2].position_nm)
        input.nominal_nm[2] = 1500001; /* nominal_step_nm is 0 */
        EXPECT(OK, gt_server_hold(server, &input, &held, &error));
        REFUSE(!held.write || held.follows || held.motors[2].position_nm != output.motors[2].position_nm)
        memset(input.nominal_nm, 0, sizeof input.nominal_nm);
    }
    memset(&start, 0, sizeof start);

    /* A latched stop starts in Fault. */
    start.stop_latched = 1;
    EXPECT(OK, gt_server_init(&memory, GT_SERVER_SIZE_6, &config, &start, &server, &error));
    EXPECT(OK, gt_server_tick(server, &input, &output, &error));
    REFUSE(output.state.phase != GT_PHASE_FAULT || output.state.cause != GT_CAUSE_STOP)
}

static void machines(void)
{
    static GT_MEMORY(GT_L2_SIZE) l2_memory;
    static GT_MEMORY(GT_F1_SIZE) f1_memory;
    gt_error error;
    gt_l2_geometry geometry = l2_geometry;
    gt_f1_geometry six;
    gt_compensator_config config;
    gt_sensor_config mounting;
    gt_l2 *l2 = NULL;
    gt_f1 *f1 = NULL;
    gt_l2_compensator *compensator = NULL;
    gt_sensor *sensor = NULL;
    gt_correction correction;
    gt_wrench load, out;
    gt_pose pose = {.rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    double tcp_m[3] = {0, 0.5, 0.65};
    int64_t nm[3] = {7, 7, 7};
    int64_t position_nm;
    uint32_t taring;

    memset(&six, 0, sizeof six);
    memset(&config, 0, sizeof config);
    memset(&load, 0, sizeof load);
    memset(&mounting, 0, sizeof mounting);

    EXPECT(OK, gt_l2_init(&l2_memory, sizeof l2_memory, &geometry, &l2, &error));
    EXPECT(MEMORY_TOO_SMALL, gt_l2_init(&f1_memory, 8, &geometry, &l2, &error));
    geometry.inverse_branch[1] = 0;
    EXPECT(BRANCH, gt_l2_init(&f1_memory, sizeof f1_memory, &geometry, &l2, &error));
    ABOUT(1, NONE, 0);
    geometry.inverse_branch[1] = -1;
    geometry.forward_branch = 2;
    EXPECT(BRANCH, gt_l2_init(&f1_memory, sizeof f1_memory, &geometry, &l2, &error));
    ABOUT(3, NONE, 0);
    geometry.forward_branch = -1;
    geometry.lengths_m[2] = NAN;
    EXPECT(ROBOT_NOT_FINITE, gt_l2_init(&f1_memory, sizeof f1_memory, &geometry, &l2, &error));
    ABOUT(2, LENGTH, 0);
    geometry.lengths_m[2] = -1;
    EXPECT(ROBOT_OUT_OF_RANGE, gt_l2_init(&f1_memory, sizeof f1_memory, &geometry, &l2, &error));
    REFUSE(error.lower != 1e-6 || error.upper != 1e3)
    geometry.lengths_m[2] = 1;
    geometry.has_travel = 1;
    geometry.travel[1][0] = 1;
    EXPECT(ROBOT_REVERSED, gt_l2_init(&f1_memory, sizeof f1_memory, &geometry, &l2, &error));
    ABOUT(1, TRAVEL, 0);
    geometry.travel[1][0] = 0;
    geometry.rotation[0][0] = -1;
    EXPECT(ORIENTATION_NOT_ROTATION, gt_l2_init(&f1_memory, sizeof f1_memory, &geometry, &l2, &error));
    geometry.rotation[0][0] = 1;
    geometry.metres_per_q[1] = NAN;
    EXPECT(ROBOT_NOT_FINITE, gt_l2_init(&f1_memory, sizeof f1_memory, &geometry, &l2, &error));
    ABOUT(1, METRES_PER_Q, 0);
    geometry.metres_per_q[1] = 1000; /* in millimetres beside a guideway of one metre */
    EXPECT(ROBOT_OUT_OF_RANGE, gt_l2_init(&f1_memory, sizeof f1_memory, &geometry, &l2, &error));
    ABOUT(1, METRES_PER_Q, 0);
    geometry.metres_per_q[1] = 1.02; /* more than calibration finds */
    EXPECT(ROBOT_OUT_OF_RANGE, gt_l2_init(&f1_memory, sizeof f1_memory, &geometry, &l2, &error));
    geometry.metres_per_q[1] = 1;
    geometry.cart_joints_m[4][2] += 1e-3;
    EXPECT(ORIENTATION_NOT_TAU, gt_l2_init(&f1_memory, sizeof f1_memory, &geometry, &l2, &error));
    REFUSE(error.index != 4 || fabs(error.value - 1e-3) > 1e-12)

    EXPECT(NULL_POINTER, gt_l2_inverse(NULL, tcp_m, nm, &error));
    EXPECT(NULL_POINTER, gt_l2_inverse(l2, NULL, nm, &error));
    EXPECT(NULL_POINTER, gt_l2_inverse(l2, tcp_m, NULL, &error));
    tcp_m[0] = INFINITY;
    EXPECT(KINEMATICS_NOT_FINITE, gt_l2_inverse(l2, tcp_m, nm, &error));
    tcp_m[0] = 0;
    tcp_m[1] = 5;
    EXPECT(KINEMATICS_UNREACHABLE, gt_l2_inverse(l2, tcp_m, nm, &error));
    ABOUT(0, NONE, 0);
    REFUSE(nm[0] != 7 || nm[1] != 7 || nm[2] != 7) /* not written with an error */
    EXPECT(NO_OBJECT, gt_f1_checksum((const gt_f1 *)l2, &taring));
    EXPECT(ROBOT_OUT_OF_RANGE, gt_f1_init(&f1_memory, sizeof f1_memory, (six.inverse_branch[0] = six.inverse_branch[1] = six.inverse_branch[2] = 1, six.turn_signs[0] = six.turn_signs[1] = -1, &six), &f1, &error));
    ABOUT(0, GUIDEWAY, 0);
    six.turn_signs[1] = 5;
    EXPECT(BRANCH, gt_f1_init(&f1_memory, sizeof f1_memory, &six, &f1, &error));
    ABOUT(4, NONE, 0);

    EXPECT(ROBOT_OUT_OF_RANGE, gt_l2_compensator_init(&memory, sizeof memory, l2, &config, &compensator, &error));
    ABOUT(0, LINK_COMPLIANCE, 0);
    for (int i = 0; i < 6; i++) {
        config.link_m_per_n[i] = 5e-7;
        config.axis_per_n[i] = 5e-8;
        config.limits_nm[i] = 1000000;
    }
    config.gain = NAN;
    EXPECT(COMPENSATOR_GAIN, gt_l2_compensator_init(&memory, sizeof memory, l2, &config, &compensator, &error));
    config.gain = 1;
    config.limits_nm[2] = -1;
    EXPECT(COMPENSATOR_LIMIT, gt_l2_compensator_init(&memory, sizeof memory, l2, &config, &compensator, &error));
    ABOUT(2, NONE, 0);
    config.limits_nm[2] = 0;
    EXPECT(OK, gt_l2_compensator_init(&memory, sizeof memory, l2, &config, &compensator, &error));
    load.force_n[1] = NAN;
    tcp_m[1] = 0.5;
    EXPECT(OK, gt_l2_inverse(l2, tcp_m, nm, &error));
    EXPECT(KINEMATICS_NOT_FINITE, gt_l2_correction(compensator, nm, &load, &correction, &error));
    EXPECT(KINEMATICS_NOT_FINITE, gt_l2_exact_correction(compensator, nm, &load, &correction, &error));
    EXPECT(NULL_POINTER, gt_l2_correction(compensator, nm, NULL, &correction, NULL));

    EXPECT(SENSOR_OUT_OF_RANGE, gt_sensor_init(&memory, sizeof memory, &mounting, &sensor, &error));
    ABOUT(-1, ORDER, 0);
    mounting.order = 1;
    EXPECT(SENSOR_NOT_ROTATION, gt_sensor_init(&memory, sizeof memory, &mounting, &sensor, &error));
    mounting.rotation[0][0] = mounting.rotation[1][1] = mounting.rotation[2][2] = 1;
    mounting.cutoff_hz = 20;
    mounting.cycle_s = 1e-3;
    EXPECT(SENSOR_OUT_OF_RANGE, gt_sensor_init(&memory, sizeof memory, &mounting, &sensor, &error));
    ABOUT(-1, TARE_SAMPLES, 0);
    mounting.tare_samples = 1;
#define OUT_OF_RANGE(field, wrong, right, parameter)                                                                   \
    mounting.field = wrong;                                                                                            \
    EXPECT(SENSOR_OUT_OF_RANGE, gt_sensor_init(&memory, sizeof memory, &mounting, &sensor, &error));                  \
    ABOUT(-1, parameter, 0);                                                                                           \
    mounting.field = right
    OUT_OF_RANGE(lever_m[1], 11, 0, LEVER);
    OUT_OF_RANGE(tool_weight_n[2], -1.1e5, 0, TOOL_WEIGHT);
    OUT_OF_RANGE(tool_centre_m[0], NAN, 0, TOOL_CENTRE);
    OUT_OF_RANGE(cutoff_hz, 0, 20, CUTOFF);
    OUT_OF_RANGE(cycle_s, 0, 1e-3, CYCLE);
    OUT_OF_RANGE(order, 0, 1, ORDER);
    OUT_OF_RANGE(order, 3, 2, ORDER);
    OUT_OF_RANGE(cutoff_hz, 451, 20, CUTOFF);
    EXPECT(OK, gt_sensor_init(&memory, sizeof memory, &mounting, &sensor, &error));
    {
        double hz[3] = {20, 0, 451};

        EXPECT(SENSOR_OUT_OF_RANGE, gt_sensor_set_notches(sensor, hz, 0.7, &error));
        ABOUT(-1, NOTCH_FREQUENCY, 0);
        hz[2] = 47;
        EXPECT(SENSOR_OUT_OF_RANGE, gt_sensor_set_notches(sensor, hz, 0, &error));
        ABOUT(-1, NOTCH_Q, 0);
        EXPECT(NULL_POINTER, gt_sensor_set_notches(sensor, NULL, 0.7, &error));
        EXPECT(OK, gt_sensor_set_notches(sensor, hz, 0.7, &error));
    }
    EXPECT(SENSOR_BAD_READING, gt_sensor_update(sensor, &load, &pose, &out, &taring));
    load.force_n[1] = 0;
    pose.rotation[1][1] = -1; /* a mirror */
    EXPECT(SENSOR_PLATFORM_NOT_ROTATION, gt_sensor_update(sensor, &load, &pose, &out, &taring));
    EXPECT(NULL_POINTER, gt_sensor_update(sensor, &load, NULL, &out, &taring));
    load.force_n[1] = NAN;
    EXPECT(NO_OBJECT, gt_l2_correction(compensator, nm, &load, &correction, &error)); /* a sensor is there now */

    EXPECT(CROSSING_NOT_FINITE, gt_position_from_metres(NAN, &position_nm, &error));
    EXPECT(CROSSING_OUT_OF_RANGE, gt_position_from_metres(1e10, &position_nm, &error));
    REFUSE(error.upper != 9007199254740992.0)
}

/* A tracker keeps its last pose: after an error too, until it receives another one, or none. */
static void tracker(void)
{
    static GT_MEMORY(GT_F1_SIZE) f1_memory;
    static GT_MEMORY(GT_F1_TRACKER_SIZE) tracker_memory;
    static const gt_pose start = {.position_m = {0, 0, 0.3}, .rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    static const gt_wrench load = {.force_n = {0, 0, -200}};
    static const gt_compensator_config config = {
        .link_m_per_n = {5e-7, 5e-7, 5e-7, 5e-7, 5e-7, 5e-7},
        .axis_per_n = {5e-8, 5e-8, 5e-8, 2e-6, 2e-6, 2e-6},
        .limits_nm = {1000000, 1000000, 1000000, 1000000, 1000000, 1000000},
        .gain = 1,
    };
    gt_f1_compensator *compensator = NULL;
    gt_correction correction;
    gt_error error;
    gt_f1_geometry geometry = f1_geometry;
    gt_f1 *f1 = NULL;
    gt_f1_tracker *tracker = NULL;
    gt_pose pose = start;
    gt_solved solved;
    int64_t nm[6], far_nm[6];

    geometry.lengths_m[2] += 1e-3; /* without a synchronised form */
    EXPECT(NO_OBJECT, gt_f1_tracker_init(&tracker_memory, sizeof tracker_memory, (gt_f1 *)&f1_memory, &tracker, &error));
    EXPECT(OK, gt_f1_init(&f1_memory, sizeof f1_memory, &geometry, &f1, &error));
    EXPECT(MEMORY_TOO_SMALL, gt_f1_tracker_init(&tracker_memory, 64, f1, &tracker, &error));
    EXPECT(OK, gt_f1_tracker_init(&tracker_memory, sizeof tracker_memory, f1, &tracker, &error));
    EXPECT(NULL_POINTER, gt_f1_inverse(f1, NULL, NULL, nm, NULL, &error));
    EXPECT(OK, gt_f1_inverse(f1, &start, NULL, nm, NULL, &error));
    EXPECT(NULL_POINTER, gt_f1_tracker_pose(NULL, nm, &pose, NULL, &error));
    EXPECT(NULL_POINTER, gt_f1_tracker_pose(tracker, NULL, &pose, NULL, &error));
    EXPECT(NULL_POINTER, gt_f1_tracker_pose(tracker, nm, NULL, NULL, &error));
    EXPECT(NO_OBJECT, gt_f1_tracker_pose((gt_f1_tracker *)f1, nm, &pose, NULL, &error));
    EXPECT(KINEMATICS_SEED_REQUIRED, gt_f1_tracker_pose(tracker, nm, &pose, NULL, &error));
    EXPECT(OK, gt_f1_tracker_start_from(tracker, &start));
    EXPECT(OK, gt_f1_tracker_pose(tracker, nm, &pose, &solved, &error));
    REFUSE(fabs(pose.position_m[2] - 0.3) > 1e-8)
    memcpy(far_nm, nm, sizeof nm);
    far_nm[0] = INT64_MAX;
    solved.iterations = 77;
    REFUSE(gt_f1_tracker_pose(tracker, far_nm, &pose, &solved, &error) == GT_CODE_OK)
    REFUSE(solved.iterations != 77 || fabs(pose.position_m[2] - 0.3) > 1e-8) /* not written with an error */
    EXPECT(OK, gt_f1_tracker_pose(tracker, nm, &pose, &solved, &error));
    REFUSE(solved.iterations > 1)
    EXPECT(OK, gt_f1_tracker_start_from(tracker, NULL));
    EXPECT(KINEMATICS_SEED_REQUIRED, gt_f1_tracker_pose(tracker, nm, &pose, NULL, &error));
    EXPECT(NULL_POINTER, gt_f1_tracker_start_from(NULL, &start));

    /* A correction uses the tracker's last pose, and leaves its own there. */
    EXPECT(OK, gt_f1_compensator_init(&memory, sizeof memory, f1, &config, &compensator, &error));
    EXPECT(KINEMATICS_SEED_REQUIRED, gt_f1_correction(compensator, tracker, nm, &load, &correction, &error));
    EXPECT(OK, gt_f1_tracker_start_from(tracker, &start));
    EXPECT(NULL_POINTER, gt_f1_correction(compensator, NULL, nm, &load, &correction, &error));
    EXPECT(NULL_POINTER, gt_f1_exact_correction(compensator, tracker, NULL, &load, &correction, &error));
    EXPECT(NO_OBJECT, gt_f1_correction((gt_f1_compensator *)f1, tracker, nm, &load, &correction, &error));
    EXPECT(OK, gt_f1_correction(compensator, tracker, nm, &load, &correction, &error));
    REFUSE(correction.offsets_nm[0] <= 0) /* the carts lift the load */
    nm[0] += 1000000;
    EXPECT(OK, gt_f1_exact_correction(compensator, tracker, nm, &load, &correction, &error));
    EXPECT(OK, gt_f1_tracker_pose(tracker, nm, &pose, &solved, &error));
    REFUSE(solved.iterations > 1)
}

int main(void)
{
    configurations();
    greet();
    keys();
    samples();
    servers();
    machines();
    tracker();
    REFUSE(strcmp(gt_code_name(-1), "GT_CODE_UNKNOWN") != 0 || strcmp(gt_code_name(19), "GT_CODE_UNKNOWN") != 0)
    printf("%d refusals\n", refused);
    return 0;
}
