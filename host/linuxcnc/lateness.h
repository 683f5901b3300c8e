/*
 * Lateness of a thread that never skips a period: after a delay LinuxCNC calls its functions in a burst until it has caught up.
 *
 * A call is due at anchor + calls x period. The anchor moves back at once when a call comes earlier, and forward by a thousandth of a
 * period per call: it follows a thread whose clock is corrected (rtapi_task_pll_set_correction), and cannot hide a burst.
 */
#ifndef GANTRY_TAU_LATENESS_H
#define GANTRY_TAU_LATENESS_H

#include <stdint.h>

struct lateness {
    int is_started;
    int64_t due_ns;
};

/* Takes note of a call at `now_ns`. Returns by how much it is late, ns, at least 0. */
static inline int64_t lateness_of_call(struct lateness *lateness, int64_t now_ns, int64_t period_ns)
{
    int64_t late_ns, leak_ns;
    if (!lateness->is_started) {
        lateness->is_started = 1;
        lateness->due_ns = now_ns;
    } else {
        lateness->due_ns += period_ns;
    }
    late_ns = now_ns - lateness->due_ns;
    if (late_ns < 0) {
        lateness->due_ns = now_ns;
        return 0;
    }
    leak_ns = period_ns / 1000;
    lateness->due_ns += late_ns < leak_ns ? late_ns : leak_ns;
    return late_ns;
}

#endif
