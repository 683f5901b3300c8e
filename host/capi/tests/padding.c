/* No byte of a result shows what was on the stack before: every call is made twice, over other bytes on the stack and in the result. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gantry_tau.h"
#include "../examples/f1.h"

static GT_MEMORY(GT_SERVER_SIZE_3_BLACK_BOX) memory;
static GT_MEMORY(GT_F1_SIZE) f1_memory;
static GT_MEMORY(GT_F1_TRACKER_SIZE) tracker_memory;
static gt_server_config config;
static gt_start start;
static gt_server *server;
static gt_tick_input input;
static int results;

/* A new server, after a tick. */
static void begin(void)
{
    gt_tick_output output;
    memset(&start, 0, sizeof start);
    memset(&input, 0, sizeof input);
    input.reading = GT_READING_DONE;
    input.stop = input.rearm = GT_RELEASED;
    if (gt_server_config_thesis(&config, 3) != GT_CODE_OK) {
        exit(1);
    }
    config.black_box_ticks = GT_BLACK_BOX_TICKS;
    if (gt_server_init(&memory, sizeof memory, &config, &start, &server, NULL) != GT_CODE_OK ||
        gt_server_tick(server, &input, &output, NULL) != GT_CODE_OK ||
        gt_server_written(server, GT_WRITE_ACCEPTED, NULL) != GT_CODE_OK) {
        exit(1);
    }
}

/* Leaves a pattern where the next call has its variables. */
static void soil(int pattern)
{
    volatile unsigned char stack[65536];
    memset((void *)(size_t)stack, pattern, sizeof stack);
}

/* Both results of a call that is to give the same one twice, over two patterns. */
#define TWICE(type, expected, call)                                                                                    \
    do {                                                                                                               \
        static type results_of[2];                                                                                     \
        for (int i = 0; i < 2; i++) {                                                                                  \
            type *const result = &results_of[i];                                                                       \
            begin();                                                                                                   \
            memset(result, i ? 0xFF : 0x55, sizeof *result);                                                           \
            soil(i ? 0xAA : 0x33);                                                                                     \
            if ((call) != GT_CODE_##expected) {                                                                        \
                printf("line %d: another code\n", __LINE__);                                                           \
                exit(1);                                                                                               \
            }                                                                                                          \
        }                                                                                                              \
        if (memcmp(&results_of[0], &results_of[1], sizeof(type)) != 0) {                                               \
            printf("line %d: the results of %s differ\n", __LINE__, #call);                                            \
            exit(1);                                                                                                   \
        }                                                                                                              \
        results++;                                                                                                     \
    } while (0)

int main(void)
{
    const gt_pose pose = {.position_m = {0.05, 0.02, 0.45}, .rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    gt_f1 *machine;
    gt_f1_tracker *tracker;
    int64_t positions_nm[6];

    TWICE(gt_tick_output, OK, gt_server_tick(server, &input, result, NULL));
    TWICE(gt_error, OK, gt_server_tick(server, &input, &(gt_tick_output){0}, result));
    TWICE(gt_error, TICK_INPUT, (input.stop = 0, gt_server_tick(server, &input, &(gt_tick_output){0}, result)));
    TWICE(gt_held, OK, gt_server_hold(server, &input, result, NULL));
    TWICE(gt_server_config, OK, gt_server_config_thesis(result, 6));
    TWICE(gt_frame, OK, gt_server_refusal(GT_TRANSPORT_STREAM, result));
    TWICE(gt_black_box, OK, gt_server_black_box(server, result));

    if (gt_f1_init(&f1_memory, sizeof f1_memory, &f1_geometry, &machine, NULL) != GT_CODE_OK ||
        gt_f1_inverse(machine, &pose, NULL, positions_nm, NULL, NULL) != GT_CODE_OK) {
        return 1;
    }
    TWICE(gt_solved, OK, gt_f1_inverse(machine, &pose, NULL, positions_nm, result, NULL));
    TWICE(gt_pose, OK,
          (gt_f1_tracker_init(&tracker_memory, sizeof tracker_memory, machine, &tracker, NULL), gt_f1_tracker_start_from(tracker, &pose),
           gt_f1_tracker_pose(tracker, positions_nm, result, NULL, NULL)));
    printf("%d results\n", results);
    return 0;
}
