/* A copy goes on as the first object does: a server in a handshake, a sensor in its tare, a tracker; and so does one that was copied back. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gantry_tau.h"
#include "../examples/f1.h"

#define TICKS 100

/* With room for a copy that begins below the server. */
static struct {
    GT_MEMORY(GT_SERVER_SIZE_6) below;
    GT_MEMORY(GT_SERVER_SIZE_6_BLACK_BOX) server;
} room;
static GT_MEMORY(GT_SERVER_SIZE_6_BLACK_BOX) saved_memory;
static GT_MEMORY(GT_SENSOR_SIZE) sensor_memory, saved_sensor_memory;
static GT_MEMORY(GT_F1_SIZE) f1_memory;
static GT_MEMORY(GT_F1_TRACKER_SIZE) tracker_memory, saved_tracker_memory;
static int calls;

static void expect(int line, gt_code expected, gt_code code)
{
    if (code != expected) {
        printf("line %d: %s, not %s\n", line, gt_code_name(code), gt_code_name(expected));
        exit(1);
    }
    calls++;
}

#define EXPECT(code, call) expect(__LINE__, GT_CODE_##code, call)
#define REFUSE(wrong)                                                                                                  \
    if (wrong) {                                                                                                       \
        printf("line %d: %s\n", __LINE__, #wrong);                                                                     \
        exit(1);                                                                                                       \
    }

/* What a server says in its next ticks. */
struct said {
    gt_tick_output outputs[TICKS];
    gt_frame frames[4 * TICKS];
    size_t frame_count;
};

static void go_on(gt_server *server, struct said *said)
{
    gt_tick_input input;
    gt_code code;
    memset(said, 0, sizeof *said);
    memset(&input, 0, sizeof input);
    input.reading = GT_READING_DONE;
    input.stop = input.rearm = GT_RELEASED;
    for (int tick = 0; tick < TICKS; tick++) {
        input.stop = tick == TICKS / 2 ? GT_PRESSED : GT_RELEASED;
        EXPECT(OK, gt_server_tick(server, &input, &said->outputs[tick], NULL));
        EXPECT(OK, gt_server_written(server, GT_WRITE_ACCEPTED, NULL));
        while ((code = gt_server_poll_transmit(server, &said->frames[said->frame_count])) == GT_CODE_OK) {
            REFUSE(++said->frame_count == sizeof said->frames / sizeof said->frames[0])
        }
        expect(__LINE__, GT_CODE_DONE, code);
    }
}

static void servers(uint32_t axes, uint32_t black_box_ticks)
{
    static struct said first, again, restored;
    static const uint8_t hellos[2][16] = {
        {'G', 'T', 2, 1, 4, 0, 0, 0, 3, 0, 0, 0, 0xdc, 0x53, 0x38, 0x72},
        {'G', 'T', 2, 1, 4, 0, 0, 0, 6, 0, 0, 0, 0xee, 0xa3, 0xe6, 0x45},
    };
    const uint8_t *hello = hellos[axes == 6];
    gt_server_config config;
    gt_start start;
    gt_tick_input input;
    gt_tick_output output;
    gt_server *server, *saved = NULL, *none = NULL;
    gt_error error;
    uint64_t connection;
    memset(&start, 0, sizeof start);
    start.first_epoch = 1;
    start.last_epoch = 100;
    memset(&input, 0, sizeof input);
    input.reading = GT_READING_DONE;
    input.stop = input.rearm = GT_RELEASED;
    EXPECT(OK, gt_server_config_thesis(&config, axes));
    config.black_box_ticks = black_box_ticks;
    EXPECT(OK, gt_server_init(&room.server, sizeof room.server, &config, &start, &server, NULL));
    EXPECT(OK, gt_server_open(server, GT_TRANSPORT_STREAM, &connection));
    EXPECT(OK, gt_server_feed(server, connection, hello, sizeof hellos[0], NULL));
    EXPECT(OK, gt_server_tick(server, &input, &output, NULL));

    /* The references of the tick wait for their fate, in the copy, too. */
    EXPECT(OK, gt_server_copy(server, &saved_memory, sizeof saved_memory, &saved, &error));
    expect(__LINE__, GT_CODE_OK, error.code);
    EXPECT(OK, gt_server_written(saved, GT_WRITE_ACCEPTED, NULL));
    EXPECT(OK, gt_server_written(server, GT_WRITE_ACCEPTED, NULL));
    EXPECT(NOT_PENDING, gt_server_written(saved, GT_WRITE_ACCEPTED, NULL));

    EXPECT(OK, gt_server_copy(server, &saved_memory, sizeof saved_memory, &saved, NULL));
    go_on(server, &first);
    REFUSE(first.frame_count < TICKS / 2)
    EXPECT(OK, gt_server_copy(saved, &room.server, sizeof room.server, &server, NULL));
    go_on(server, &restored);
    REFUSE(memcmp(&first, &restored, sizeof first) != 0)
    go_on(saved, &again);
    REFUSE(memcmp(&first, &again, sizeof first) != 0)
    /* It is not where it began. */
    go_on(saved, &again);
    REFUSE(memcmp(&first, &again, sizeof first) == 0)

    EXPECT(NULL_POINTER, gt_server_copy(NULL, &saved_memory, sizeof saved_memory, &none, &error));
    EXPECT(NULL_POINTER, gt_server_copy(server, NULL, sizeof saved_memory, &none, &error));
    EXPECT(NULL_POINTER, gt_server_copy(server, &saved_memory, sizeof saved_memory, NULL, &error));
    EXPECT(MISALIGNED, gt_server_copy(server, saved_memory.bytes + 4, sizeof saved_memory - 4, &none, &error));
    EXPECT(MEMORY_TOO_SMALL, gt_server_copy(server, &saved_memory, GT_SERVER_SIZE_3 / 2, &none, &error));
    EXPECT(OVERLAP, gt_server_copy(server, &room.server, sizeof room.server, &none, &error));
    EXPECT(OVERLAP, gt_server_copy(server, room.server.bytes + 64, sizeof room.server - 64, &none, &error));
    EXPECT(OVERLAP, gt_server_copy(server, room.below.bytes + sizeof room.below - 64, sizeof room.server, &none, &error));
    EXPECT(NO_OBJECT, gt_server_copy((gt_server *)&sensor_memory, &saved_memory, sizeof saved_memory, &none, &error));
    REFUSE(none)
    /* The refusals have changed neither of them. */
    go_on(server, &first);
    go_on(saved, &again);
}

static void load_of(gt_sensor *sensor, double newtons, gt_wrench *load, uint32_t *taring)
{
    static const gt_pose pose = {.rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    const gt_wrench raw = {.force_n = {newtons, 0, 1}};
    EXPECT(OK, gt_sensor_update(sensor, &raw, &pose, load, taring));
}

static void sensors(void)
{
    static const gt_sensor_config config = {
        .rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
        .cutoff_hz = 2,
        .cycle_s = 1e-3,
        .tare_samples = 10,
        .order = 2,
    };
    gt_sensor *sensor, *saved, *none = NULL;
    gt_wrench load[2];
    uint32_t taring[2];
    EXPECT(OK, gt_sensor_init(&sensor_memory, sizeof sensor_memory, &config, &sensor, NULL));
    for (int sample = 0; sample < 40; sample++) {
        load_of(sensor, sample, &load[0], &taring[0]);
        if (sample == 5 || sample == 20) {
            EXPECT(OK, gt_sensor_copy(sensor, &saved_sensor_memory, sizeof saved_sensor_memory, &saved, NULL));
        } else if (sample > 5) {
            load_of(saved, sample, &load[1], &taring[1]);
            REFUSE(taring[0] != taring[1] || memcmp(&load[0], &load[1], sizeof load[0]) != 0)
        }
    }
    REFUSE(taring[0] || load[0].force_n[0] <= 0)
    EXPECT(OVERLAP, gt_sensor_copy(sensor, &sensor_memory, sizeof sensor_memory, &none, NULL));
    EXPECT(NO_OBJECT, gt_sensor_copy((gt_sensor *)&room.server, &saved_sensor_memory, sizeof saved_sensor_memory, &none, NULL));
    REFUSE(none)
}

static void trackers(void)
{
    static const gt_pose start = {.position_m = {0.05, 0.02, 0.45}, .rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    gt_f1 *f1;
    gt_f1_tracker *tracker, *saved, *none = NULL;
    gt_pose pose[2];
    gt_solved solved[2];
    int64_t nm[6];
    EXPECT(OK, gt_f1_init(&f1_memory, sizeof f1_memory, &f1_geometry, &f1, NULL));
    EXPECT(OK, gt_f1_inverse(f1, &start, NULL, nm, NULL, NULL));
    EXPECT(OK, gt_f1_tracker_init(&tracker_memory, sizeof tracker_memory, f1, &tracker, NULL));
    EXPECT(OK, gt_f1_tracker_pose(tracker, nm, &pose[0], NULL, NULL));
    EXPECT(OK, gt_f1_tracker_copy(tracker, &saved_tracker_memory, sizeof saved_tracker_memory, &saved, NULL));
    nm[0] += 100000;
    EXPECT(OK, gt_f1_tracker_pose(tracker, nm, &pose[0], &solved[0], NULL));
    EXPECT(OK, gt_f1_tracker_pose(saved, nm, &pose[1], &solved[1], NULL));
    REFUSE(memcmp(&pose[0], &pose[1], sizeof pose[0]) != 0 || memcmp(&solved[0], &solved[1], sizeof solved[0]) != 0)
    EXPECT(OVERLAP, gt_f1_tracker_copy(tracker, &tracker_memory, sizeof tracker_memory, &none, NULL));
    EXPECT(NO_OBJECT, gt_f1_tracker_copy((gt_f1_tracker *)f1, &saved_tracker_memory, sizeof saved_tracker_memory, &none, NULL));
    REFUSE(none)
}

int main(void)
{
    for (int axes = 3; axes <= 6; axes += 3) {
        servers((uint32_t)axes, GT_BLACK_BOX_NONE);
        servers((uint32_t)axes, GT_BLACK_BOX_TICKS);
    }
    sensors();
    trackers();
    printf("%d calls\n", calls);
    return 0;
}
