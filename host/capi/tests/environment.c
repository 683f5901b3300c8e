/*
 * The floating-point environment: positions are equal to the nanometre in every one that C knows; NaN and unreachable poses are errors with
 * exceptions masked, and with them unmasked behind feholdexcept.
 */
#define _GNU_SOURCE
#include <fenv.h>
#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>
#ifdef __SSE__
#include <xmmintrin.h>
#endif

#include "gantry_tau.h"
#include "../examples/f1.h"
#include "../examples/l2.h"

static GT_MEMORY(GT_L2_SIZE) l2_memory;
static GT_MEMORY(GT_F1_SIZE) f1_memory;
static const gt_pose unturned = {.position_m = {0.05, 0.02, 0.45}, .rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

static void require(int line, int right)
{
    if (!right) {
        printf("line %d\n", line);
        exit(1);
    }
}
#define REQUIRE(right) require(__LINE__, right)

/* Positions of both machines at poses across their reach. */
static void positions(int64_t all[100][9])
{
    gt_l2 *l2;
    gt_f1 *f1;
    REQUIRE(gt_l2_init(&l2_memory, sizeof l2_memory, &l2_geometry, &l2, NULL) == GT_CODE_OK);
    REQUIRE(gt_f1_init(&f1_memory, sizeof f1_memory, &f1_geometry, &f1, NULL) == GT_CODE_OK);
    for (int i = 0; i < 100; i++) {
        const double along = i / 100.0 - 0.5;
        const double tcp_m[3] = {0.2 * along, 0.5 + 0.1 * along, 0.65 - 0.1 * along};
        gt_pose pose = unturned;
        pose.position_m[0] += 0.05 * along;
        pose.position_m[2] -= 0.03 * along;
        REQUIRE(gt_l2_inverse(l2, tcp_m, all[i], NULL) == GT_CODE_OK);
        REQUIRE(gt_f1_inverse(f1, &pose, NULL, all[i] + 3, NULL, NULL) == GT_CODE_OK);
    }
}

/* Errors, and not traps. */
static void refusals(void)
{
    const double nothing[3] = {NAN, 0.5, 0.65}, far[3] = {0.0, 100.0, 0.65}, endless[3] = {0.0, INFINITY, 0.65};
    int64_t positions_nm[6];
    gt_pose pose = unturned;
    gt_l2 *l2;
    gt_f1 *f1;
    REQUIRE(gt_l2_init(&l2_memory, sizeof l2_memory, &l2_geometry, &l2, NULL) == GT_CODE_OK);
    REQUIRE(gt_f1_init(&f1_memory, sizeof f1_memory, &f1_geometry, &f1, NULL) == GT_CODE_OK);
    REQUIRE(gt_l2_inverse(l2, nothing, positions_nm, NULL) != GT_CODE_OK);
    REQUIRE(gt_l2_inverse(l2, far, positions_nm, NULL) != GT_CODE_OK);
    REQUIRE(gt_l2_inverse(l2, endless, positions_nm, NULL) != GT_CODE_OK);
    pose.position_m[1] = NAN;
    REQUIRE(gt_f1_inverse(f1, &pose, NULL, positions_nm, NULL, NULL) != GT_CODE_OK);
    pose.position_m[1] = 50.0;
    REQUIRE(gt_f1_inverse(f1, &pose, NULL, positions_nm, NULL, NULL) != GT_CODE_OK);
}

int main(void)
{
    static int64_t as_c_starts[100][9], here[100][9];
    const int roundings[] = {FE_UPWARD, FE_DOWNWARD, FE_TOWARDZERO};
    int64_t largest = 0;
    int environments = 1, status;
    pid_t child;

    positions(as_c_starts);
    refusals();
    for (size_t i = 0; i < sizeof roundings / sizeof *roundings; i++, environments++) {
        REQUIRE(fesetround(roundings[i]) == 0);
        positions(here);
        refusals();
        REQUIRE(fesetround(FE_TONEAREST) == 0);
        for (int at = 0; at < 900; at++) {
            const int64_t difference = llabs(here[at / 9][at % 9] - as_c_starts[at / 9][at % 9]);
            largest = difference > largest ? difference : largest;
        }
    }
#ifdef __SSE__
    {
        const unsigned control = _mm_getcsr();
        _mm_setcsr(control | 0x8040); /* flush to zero, and denormals are zero */
        positions(here);
        refusals();
        _mm_setcsr(control);
        REQUIRE(memcmp(here, as_c_starts, sizeof here) == 0);
        environments++;
    }
#endif
    REQUIRE(largest <= 1); /* a half is rounded up or down */

    /* Unmasked: a trap, as the header says; held by feholdexcept, an error. */
    child = fork();
    REQUIRE(child >= 0);
    if (child == 0) {
        signal(SIGFPE, SIG_DFL); /* a sanitizer has a handler */
        feenableexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW);
        refusals();
        exit(0);
    }
    REQUIRE(waitpid(child, &status, 0) == child);
    REQUIRE((WIFSIGNALED(status) && WTERMSIG(status) == SIGFPE) || (WIFEXITED(status) && WEXITSTATUS(status) == 0));
    {
        fenv_t environment;
        feenableexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW);
        REQUIRE(feholdexcept(&environment) == 0);
        refusals();
        positions(here);
        REQUIRE(fesetenv(&environment) == 0);
        REQUIRE(memcmp(here, as_c_starts, sizeof here) == 0);
        REQUIRE(fegetexcept() == (FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW));
    }
    printf("%d environments, %" PRId64 " nm, unmasked: %s\n", environments, largest, WIFSIGNALED(status) ? "SIGFPE" : "errors");
    return 0;
}
