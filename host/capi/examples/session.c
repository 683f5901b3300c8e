/*
 * A server in C: its tick loop, driven by a client in the same program.
 *
 * The client requests a session, answers every State with a Command (20 in Submit, then Obtain with targets of +30, -20 and +10 um), loses
 * one packet, and later sends nothing more. Expected: the offsets are held over the lost packet; two missed packets end the session;
 * then every reference returns to its nominal value by 0.1 um per tick; no tick changes an offset by more than 5 um.
 *
 *     session [TRACE [BLACK_BOX]]
 *
 * TRACE receives all bytes in and out, for comparison; BLACK_BOX a file for `gantry-tau replay`.
 * In a real program `read_client` and `write_frame` are sockets, `write_drives` is the fieldbus, and a timer starts each cycle.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "gantry_tau.h"
#include "wire.h"

enum { AXES = 3, MOTORS = 4, TICKS = 700, LOST_ONCE = 120, LOST_TWICE = 250 };
enum { STEP_NM = 5000, RAMP_NM = 100 };

static GT_MEMORY(GT_SERVER_SIZE_3_BLACK_BOX) memory;
static uint8_t part[GT_BLACK_BOX_PART];

/* State of the client. */
typedef struct {
    int connected, welcomed;
    uint64_t epoch, sequence, last_state;
    int has_state;
} client_state;

static void fail(const char *what, gt_code code)
{
    printf("FAILED: %s (%s)\n", what, gt_code_name(code));
    exit(1);
}

static void check(const char *what, gt_code code)
{
    if (code != GT_CODE_OK) {
        fail(what, code);
    }
}

static void require(int holds, const char *what)
{
    if (!holds) {
        fail(what, GT_CODE_OK);
    }
}

/* Reads the client's frame of this tick; empty if it is lost or there is none. */
static void read_client(client_state *client, uint64_t tick, wire_frame *frame)
{
    static const int32_t targets[AXES] = {30000, -20000, 10000};
    static const int32_t zeros[AXES] = {0, 0, 0};

    frame->length = 0;
    if (!client->connected) {
        client->connected = 1;
        wire_hello(frame, AXES);
    } else if (client->has_state) {
        const int obtain = client->sequence >= 20;
        client->has_state = 0;
        client->sequence++;
        wire_command(frame, client->epoch, client->sequence, client->last_state,
                     (uint8_t)(obtain ? OBTAIN : SUBMIT), AXES, obtain ? targets : zeros);
    }
    if (tick == LOST_ONCE || tick >= LOST_TWICE) {
        frame->length = 0;
    }
}

/* Sends a frame to the client. */
static void write_frame(client_state *client, const gt_frame *frame)
{
    const uint8_t *body = frame->bytes + WIRE_HEADER;
    if (frame->bytes[3] == WELCOME) {
        client->welcomed = 1;
        client->epoch = wire_get(body, 8);
    } else if (frame->bytes[3] == STATE && client->welcomed) {
        client->last_state = wire_get(body, 8);
        client->has_state = 1;
    }
}

static void trace_bytes(FILE *trace, const char *what, const uint8_t *bytes, size_t length)
{
    fprintf(trace, "%s ", what);
    for (size_t i = 0; i < length; i++) {
        fprintf(trace, "%02x", bytes[i]);
    }
    fprintf(trace, "\n");
}

/* Writes the references to the drives: here one line per motor. Returns what became of them. */
static uint8_t write_drives(FILE *trace, const gt_tick_output *output)
{
    for (uint32_t motor = 0; trace && motor < output->motor_count; motor++) {
        const gt_reference *reference = &output->motors[motor];
        fprintf(trace, "motor %lld %" PRId32 " %" PRId16 "\n", (long long)reference->position_nm,
                reference->velocity_offset_um_s, reference->torque_offset_permille);
    }
    return GT_WRITE_ACCEPTED; /* GT_WRITE_REFUSED with values that were read back, GT_WRITE_UNKNOWN if they cannot be */
}

/* Checks the bounds that the library guarantees. */
static void check_bounds(const gt_tick_output *output, const gt_tick_input *input, int64_t *last)
{
    require(output->motors[0].position_nm == output->motors[1].position_nm, "both motors of cart 1 have the same reference");
    for (int axis = 0; axis < AXES; axis++) {
        const int64_t offset = output->motors[axis + 1].position_nm - input->nominal_nm[axis];
        const int64_t change = llabs(offset - last[axis]);
        require(change <= STEP_NM, "no offset changes by more than its step");
        if (output->state.phase == GT_PHASE_SAFE_DISCONNECT) {
            require(llabs(last[axis]) - llabs(offset) == (llabs(last[axis]) < RAMP_NM ? llabs(last[axis]) : RAMP_NM),
                    "the ramp is exact");
        }
        last[axis] = offset;
    }
}

/* Writes the black box to a file, part by part. */
static void write_black_box(gt_server *server, const char *path)
{
    gt_black_box box;
    FILE *file;
    size_t length;

    check("black box", gt_server_black_box(server, &box));
    require(box.frozen, "the end of the session froze the black box");
    file = path ? fopen(path, "wb") : NULL;
    require(!path || file, "the black box can be written");
    for (uint32_t i = 0; i < box.parts; i++) {
        check("black box part", gt_server_black_box_part(server, i, part, sizeof part, &length));
        require(!file || fwrite(part, 1, length, file) == length, "the black box is written");
    }
    if (file) {
        fclose(file);
    }
    printf("black box: %" PRIu32 " ticks\n", box.ticks);
    check("release", gt_server_black_box_release(server));
}

int main(int argc, char **argv)
{
    static const char *const phases[] = {"Listening", "Handshake", "Submit", "Obtain", "SafeDisconnect", "Fault"};
    FILE *trace = argc > 1 ? fopen(argv[1], "wb") : NULL;
    gt_server_config config;
    gt_start start = {.first_epoch = 1, .last_epoch = 1}; /* reserved in storage that survives a restart */
    gt_tick_input input = {.elapsed_cycles = 1,
                           .reading = GT_READING_DONE,
                           .stop = GT_RELEASED,
                           .rearm = GT_RELEASED};
    gt_tick_output output;
    gt_frame frame;
    gt_error error;
    gt_server *server;
    client_state client = {0};
    uint64_t connection;
    int64_t last[AXES] = {0};
    int32_t phase = -1;

    require(gt_abi_version() == GT_ABI_VERSION, "header and library have the same version");
    require(argc <= 1 || trace, "the trace can be written");

    check("profile", gt_server_config_thesis(&config, AXES));
    config.motors = MOTORS; /* two motors on cart 1 */
    config.axis_of_motor[0] = 0;
    config.axis_of_motor[1] = 0;
    config.axis_of_motor[2] = 1;
    config.axis_of_motor[3] = 2;
    config.black_box_ticks = GT_BLACK_BOX_TICKS;
    for (int axis = 0; axis < AXES; axis++) {
        config.axis[axis].nominal_lower_nm = -1000000000;
        config.axis[axis].nominal_upper_nm = 1000000000;
        config.axis[axis].machine_lower_nm = -1002000000;
        config.axis[axis].machine_upper_nm = 1002000000;
        config.axis[axis].nominal_step_nm = 2000000;
    }
    if (gt_server_init(&memory, sizeof memory, &config, &start, &server, &error) != GT_CODE_OK) {
        printf("axis %" PRId32 ": %g\n", error.index, error.value);
        fail("init", error.code);
    }
    check("open", gt_server_open(server, GT_TRANSPORT_STREAM, &connection));

    printf("tick  phase           axis 1      axis 2      axis 3   [offsets in nm]\n");
    for (uint64_t tick = 1; tick <= TICKS; tick++) {
        wire_frame read;
        read_client(&client, tick, &read);
        check("feed", gt_server_feed(server, connection, read.bytes, read.length, NULL));

        for (int axis = 0; axis < AXES; axis++) {
            input.nominal_nm[axis] = (int64_t)tick * 1000 * (axis + 1);
            input.actual[axis].position_nm = input.nominal_nm[axis] - 50;
        }
        if (gt_server_tick(server, &input, &output, &error) != GT_CODE_OK) {
            printf("parameter %" PRId32 ": %g\n", error.parameter, error.value);
            fail("tick", error.code);
        }
        if (trace) {
            fprintf(trace, "tick %llu\n", (unsigned long long)tick);
            trace_bytes(trace, "in", read.bytes, read.length);
        }
        require(output.write, "the references may be written");
        check("written", gt_server_written(server, write_drives(trace, &output), NULL));
        while (gt_server_poll_transmit(server, &frame) == GT_CODE_OK) {
            write_frame(&client, &frame);
            if (trace) {
                trace_bytes(trace, "out", frame.bytes, frame.length);
            }
        }

        while (gt_server_poll_close(server, &connection) == GT_CODE_OK) {
            require(output.state.phase == GT_PHASE_LISTENING, "the connection is closed after the ramp"); /* close its socket */
        }

        check_bounds(&output, &input, last);
        if (output.state.phase != phase || tick % 100 == 0 || tick == LOST_ONCE) {
            phase = output.state.phase;
            printf("%4llu  %-14s %8lld    %8lld    %8lld\n", (unsigned long long)tick, phases[phase],
                   (long long)last[0], (long long)last[1], (long long)last[2]);
        }
        if (tick == LOST_ONCE) {
            require(phase == GT_PHASE_OBTAIN, "one lost packet is held");
        }
        if (tick == LOST_TWICE + 1) {
            require(output.ended == GT_CAUSE_CLIENT_LATE, "two lost packets in a row end the session");
        }
    }

    require(phase == GT_PHASE_LISTENING && last[0] == 0 && last[1] == 0 && last[2] == 0, "all offsets are back at zero");
    require(output.state.counters.missed == 3, "three packets were missed");
    write_black_box(server, argc > 2 ? argv[2] : NULL);
    if (trace) {
        fclose(trace);
    }
    printf("all bounds held over %d ticks\n", (int)TICKS);
    return 0;
}
