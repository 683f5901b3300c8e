/*
 * Lateness of a thread. LinuxCNC 2.9 never skips a period: after a delay it calls its functions in a burst until it has caught up. Later versions skip them.
 *
 * A call is due at anchor + calls x period. The anchor moves back at once when a call comes earlier, and forward by a thousandth of a
 * period per call. It moves to the call itself when a late thread has called a few times in a row with a full period between: that is no
 * burst, but a thread whose clock is moved (rtapi_task_pll_set_correction), or which has skipped what it missed.
 */
#ifndef GANTRY_TAU_LATENESS_H
#define GANTRY_TAU_LATENESS_H

#include <stdint.h>

/* Calls in a row with a full period between that are no burst. */
enum { PACED_CALLS = 3 };

struct lateness {
    int is_started;
    int64_t due_ns;
    int64_t last_ns;
    /* Calls in a row with a full period between, at most PACED_CALLS; a pause begins a row, unless it follows another one. */
    int paced;
    int was_pause;
};

/* Counts a call that comes `apart_ns` after the last one. */
static inline void lateness_pace(struct lateness *lateness, int64_t apart_ns, int64_t period_ns)
{
    const int is_pause = apart_ns > period_ns + period_ns / 2;
    if (apart_ns < period_ns - period_ns / 8) {
        lateness->paced = 0;
    } else if (is_pause && !lateness->was_pause) {
        lateness->paced = 1;
    } else if (lateness->paced < PACED_CALLS) {
        lateness->paced++;
    }
    lateness->was_pause = is_pause;
}

/* Takes note of a call at `now_ns`. Returns by how much it is late, ns, at least 0. More than a period: it belongs to a burst. */
static inline int64_t lateness_of_call(struct lateness *lateness, int64_t now_ns, int64_t period_ns)
{
    int64_t late_ns, leak_ns;
    if (!lateness->is_started) {
        *lateness = (struct lateness){.is_started = 1, .due_ns = now_ns, .last_ns = now_ns};
        return 0;
    }
    lateness->due_ns += period_ns;
    lateness_pace(lateness, now_ns - lateness->last_ns, period_ns);
    lateness->last_ns = now_ns;
    late_ns = now_ns - lateness->due_ns;
    if (late_ns < 0 || (late_ns > period_ns && lateness->paced == PACED_CALLS)) {
        lateness->due_ns = now_ns;
        return 0;
    }
    leak_ns = period_ns / 1000;
    lateness->due_ns += late_ns < leak_ns ? late_ns : leak_ns;
    return late_ns;
}

#endif
