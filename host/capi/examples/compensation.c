/*
 * Kinematics and compensation of both machines: the offset of each axis for a pose and a load.
 *
 * Geometry, springs and sensor come from headers that `gantry-tau header --robot l2 --prefix l2` and `gantry-tau header --robot f1 --prefix f1` write.
 * Every number is printed as its 64 bits and rounded.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gantry_tau.h"
#include "f1.h"
#include "l2.h"

#if !L2_HAS_COMPENSATOR || !F1_HAS_COMPENSATOR || L2_WRIST_JOINTS || F1_WRIST_JOINTS
#error "needs machines with springs and without joints of a wrist"
#endif

static GT_MEMORY(GT_L2_SIZE) l2_memory;
static GT_MEMORY(GT_F1_SIZE) f1_memory;
static GT_MEMORY(GT_F1_TRACKER_SIZE) f1_tracker_memory;
static GT_MEMORY(GT_L2_COMPENSATOR_SIZE) l2_compensator_memory;
static GT_MEMORY(GT_F1_COMPENSATOR_SIZE) f1_compensator_memory;
static GT_MEMORY(GT_SENSOR_SIZE) sensor_memory;

/* 300 N along x and smaller components, applied by the environment to the platform. */
static const gt_wrench load = {.force_n = {300, -50, 100}, .moment_nm = {1, 2, -1}};

static void check(const char *what, gt_code code, const gt_error *error)
{
    if (code != GT_CODE_OK) {
        printf("FAILED: %s: %s (index %" PRId32 ", value %g)\n", what, gt_code_name(code), error->index, error->value);
        exit(1);
    }
}

static void print(const char *what, const double *numbers, int count)
{
    for (int i = 0; i < count; i++) {
        uint64_t bits;
        memcpy(&bits, &numbers[i], sizeof bits);
        printf("%-20s %d  %08lx%08lx  (%.9f)\n", what, i, (unsigned long)(bits >> 32), (unsigned long)(bits & 0xFFFFFFFFu), numbers[i]);
    }
}

static void print_positions(const char *what, const int64_t *positions_nm, int axes)
{
    for (int i = 0; i < axes; i++) {
        printf("%-20s %d  %lld nm\n", what, i, (long long)positions_nm[i]);
    }
}

static void print_correction(const char *what, const gt_correction *correction, int axes)
{
    for (int i = 0; i < axes; i++) {
        printf("%-20s %d  %" PRId32 " nm%s\n", what, i, correction->offsets_nm[i], correction->saturated[i] ? " (limit)" : "");
    }
}

static void three_axes(void)
{
    gt_compensator_config config = l2_compensator;
    const double tcp_m[3] = {0.0, 0.5, 0.65};
    int64_t positions_nm[3];
    double back_m[3], jacobian[9], forces_n[6], loads[3];
    gt_l2 *machine;
    gt_l2_compensator *compensator;
    gt_correction correction;
    gt_error error;

    config.limits_nm[1] = 150000; /* is reached */
    check("l2", gt_l2_init(&l2_memory, sizeof l2_memory, &l2_geometry, &machine, &error), &error);
    check("inverse", gt_l2_inverse(machine, tcp_m, positions_nm, &error), &error);
    check("forward", gt_l2_forward(machine, positions_nm, back_m, &error), &error);
    check("jacobian", gt_l2_jacobian(machine, tcp_m, jacobian, &error), &error);
    check("statics", gt_l2_statics(machine, tcp_m, positions_nm, &load, forces_n, loads, &error), &error);
    print_positions("l2 positions", positions_nm, 3);
    print("l2 tcp", back_m, 3);
    print("l2 jacobian", jacobian, 9);
    print("l2 link force", forces_n, 6);
    print("l2 cart load", loads, 3);

    check("l2 compensator", gt_l2_compensator_init(&l2_compensator_memory, sizeof l2_compensator_memory, machine, &config, &compensator, &error), &error);
    check("correction", gt_l2_correction(compensator, positions_nm, &load, &correction, &error), &error);
    print_correction("l2 correction", &correction, 3);
    check("exact", gt_l2_exact_correction(compensator, positions_nm, &load, &correction, &error), &error);
    print_correction("l2 exact", &correction, 3);
}

static void six_axes(void)
{
    /* Turned by 0.1 rad about z. */
    const gt_pose pose = {
        .position_m = {0.05, 0.02, 0.45},
        .rotation = {{0.99500416527802577, -0.09983341664682815, 0}, {0.09983341664682815, 0.99500416527802577, 0}, {0, 0, 1}},
    };
    int64_t positions_nm[6];
    double jacobian[36], forces_n[6], loads[6];
    gt_f1 *machine;
    gt_f1_tracker *tracker;
    gt_f1_compensator *compensator;
    gt_correction correction;
    gt_solved solved;
    gt_pose back;
    gt_error error;

    check("f1", gt_f1_init(&f1_memory, sizeof f1_memory, &f1_geometry, &machine, &error), &error);
    check("inverse", gt_f1_inverse(machine, &pose, NULL, positions_nm, &solved, &error), &error);
    printf("f1 iterations        0  %" PRId32 "\n", solved.iterations);
    print_positions("f1 positions", positions_nm, 6);
    /* The first pose is found from the synchronised form, every other one from the pose before it. */
    check("tracker", gt_f1_tracker_init(&f1_tracker_memory, sizeof f1_tracker_memory, machine, &tracker, &error), &error);
    for (int cycle = 0; cycle < 3; cycle++) {
        positions_nm[0] += 500000;
        check("pose", gt_f1_tracker_pose(tracker, positions_nm, &back, &solved, &error), &error);
        printf("f1 tracked           %d  %" PRId32 "\n", cycle, solved.iterations);
        print("f1 position", back.position_m, 3);
    }
    /* Back, seeded by the plates' positions. */
    check("inverse", gt_f1_inverse(machine, &back, positions_nm, positions_nm, &solved, &error), &error);
    print_positions("f1 positions", positions_nm, 6);

    check("jacobian", gt_f1_jacobian(machine, &back, positions_nm, jacobian, &error), &error);
    check("statics", gt_f1_statics(machine, &back, positions_nm, &load, forces_n, loads, &error), &error);
    print("f1 jacobian", jacobian, 36);
    print("f1 link force", forces_n, 6);
    print("f1 axis load", loads, 6);

    check("f1 compensator", gt_f1_compensator_init(&f1_compensator_memory, sizeof f1_compensator_memory, machine, &f1_compensator, &compensator, &error), &error);
    check("correction", gt_f1_correction(compensator, tracker, positions_nm, &load, &correction, &error), &error);
    print_correction("f1 correction", &correction, 6);
    check("exact", gt_f1_exact_correction(compensator, tracker, positions_nm, &load, &correction, &error), &error);
    print_correction("f1 exact", &correction, 6);
}

/* Two samples of tare, then the load settles through the low-pass. */
static void sensor(void)
{
    gt_sensor_config config = l2_sensor;
    const gt_pose upright = {.rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}; /* of an F1: gt_f1_tracker_pose */
    gt_wrench raw = {.force_n = {1, 2, 3}, .moment_nm = {0, 0, 0}}, out;
    gt_sensor *object;
    gt_error error;
    uint32_t taring = 0;

    config.tare_samples = 2;
    check("sensor", gt_sensor_init(&sensor_memory, sizeof sensor_memory, &config, &object, &error), &error);
    check("notches", gt_sensor_set_notches(object, l2_notches_hz, L2_NOTCH_Q, &error), &error);
    for (int sample = 0; sample < 50; sample++) {
        if (sample == 2) {
            raw.force_n[0] += 10;
        }
        error.index = -1;
        error.value = 0;
        check("sample", gt_sensor_update(object, &raw, &upright, &out, &taring), &error);
    }
    print("sensor force", out.force_n, 3);
    print("sensor moment", out.moment_nm, 3);
}

int main(void)
{
    int64_t position_nm;
    gt_error error;

    three_axes();
    six_axes();
    sensor();
    check("crossing", gt_position_from_metres(1.25e-3, &position_nm, &error), &error);
    printf("crossing             0  %lld nm\n", (long long)position_nm);
    return 0;
}
